"""Real numbers out of what a user hands in: one clear error, never numpy's own and never a silent cast."""

from __future__ import annotations

import numbers
import reprlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.errors import SceneError

Floats = NDArray[np.float64]


def real(raw: Any, subject: str, wanted: str, copy: bool = True) -> Floats:
    """The array of floats, finite or not, that `raw` holds; with ``copy=False`` that array itself, if it is one.

    Numpy would read "1" as 1, None as NaN, and drop imaginary parts with a warning: all are refused.

    Raises
    ------
    SceneError
        It holds no real numbers, or rows of different lengths.
    """
    try:
        array = np.asarray(raw)
        if array.dtype.kind in "biuf" or all(isinstance(number, numbers.Real) for number in array.flat):
            return array.astype(float, copy=copy)
    except (TypeError, ValueError, OverflowError):
        pass
    raise SceneError(
        f"{subject}: found {brief(raw)}, which does not read as an array of real numbers; wanted {wanted}."
    )


def brief(raw: Any) -> str:
    """`raw` in at most a line."""
    return " ".join(reprlib.repr(raw).split())


def shape_in_words(array: Floats) -> str:
    """What was found where the shape is wrong."""
    return f"the single number {array:.6g}" if array.ndim == 0 else f"an array of shape {array.shape}"
