"""Observed orders of convergence: e = C h^p between two runs gives p = log(e_1 / e_2) / log(h_1 / h_2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, as_real_array
from vemcvx.errors import HistoryError


@dataclass(frozen=True, eq=False)
class Orders:
    """Observed orders.

    Attributes
    ----------
    successive : (m - 1,) array
        Between every run and the next.
    slope : float
        Of the least-squares line through (log h, log e).
    """

    successive: Floats
    slope: float


def orders(h: ArrayLike, errors: ArrayLike) -> Orders:
    """Observed orders of errors in a mesh size or a step.

    Parameters
    ----------
    h : (m,) sequence of positive numbers, no two neighbours alike
        Mesh sizes or steps (any measure of them: orders do not see constants).
    errors : (m,) sequence of positive numbers

    Raises
    ------
    HistoryError
        There are fewer than two runs, the lengths differ, or a number is not positive.
    """
    x, y = (np.log(array) for array in checked(h, errors, "orders"))
    about = x - x.mean()
    return Orders(np.diff(y) / np.diff(x), float(about @ y / (about @ about)))


def checked(h: ArrayLike, errors: ArrayLike, subject: str, missing: bool = False) -> tuple[Floats, Floats]:
    """Sizes and errors that have logarithms; NaN among the errors where some may be missing."""
    sizes, values = (as_real_array(raw, subject, "a sequence of numbers") for raw in (h, errors))
    if sizes.ndim != 1 or sizes.shape != values.shape or len(sizes) < 2:
        raise HistoryError(
            f"{subject}: found {sizes.shape} sizes and {values.shape} errors; give equally many, two or more."
        )
    for name, array in (("size", sizes), ("error", values[~np.isnan(values)] if missing else values)):
        wrong = ~(np.isfinite(array) & (array > 0))
        if wrong.any():
            raise HistoryError(f"{subject}: found the {name} {array[wrong][0]:.6g}; logarithms want it finite and > 0.")
    twice = np.diff(np.log(sizes)) == 0
    if twice.any():
        raise HistoryError(f"{subject}: found the size {sizes[1:][twice][0]:.6g} twice in a row; refine.")
    return sizes, values
