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
    sizes, values = (as_real_array(raw, "orders", "a sequence of numbers") for raw in (h, errors))
    if sizes.ndim != 1 or sizes.shape != values.shape or len(sizes) < 2:
        raise HistoryError(
            f"orders: found {sizes.shape} sizes and {values.shape} errors; give equally many, two or more."
        )
    for name, array in (("size", sizes), ("error", values)):
        wrong = ~(np.isfinite(array) & (array > 0))
        if wrong.any():
            raise HistoryError(f"orders: found the {name} {array[wrong][0]:.6g}; logarithms want it finite and > 0.")
    x, y = np.log(sizes), np.log(values)
    if (np.diff(x) == 0).any():
        raise HistoryError(f"orders: found the size {sizes[1:][np.diff(x) == 0][0]:.6g} twice in a row; refine.")
    about = x - x.mean()
    return Orders(np.diff(y) / np.diff(x), float(about @ y / (about @ about)))
