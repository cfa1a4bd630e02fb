"""The box and the cell counts that every family of meshes is asked for.

A family is called with n (cells across the shortest side), a pair of counts or the size of a cell, and with a box
((x0, x1), (y0, y1)). Counts do not depend on the unit of length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from vemcvx.arguments import is_real, is_whole
from vemcvx.arrays import Floats, brief
from vemcvx.errors import MeshError

Count = int | tuple[int, int]
Number = TypeVar("Number", int, float)
Corners = tuple[tuple[float, float], tuple[float, float]]
# A mesh of that size takes 10 GB before anything is assembled.
MOST_CELLS = 10**8
# Areas and moments of cells must neither overflow nor vanish.
SHORTEST, LARGEST = 1e-60, 1e60

UNIT_BOX: Corners = ((0.0, 1.0), (0.0, 1.0))


@dataclass(frozen=True)
class Box:
    """The rectangle [left, right] x [bottom, top]."""

    left: float
    right: float
    bottom: float
    top: float

    @property
    def width(self) -> float:
        """Length of the bottom side."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Length of the left side."""
        return self.top - self.bottom


def check_box(box: Corners) -> Box:
    """Return the box as four finite numbers, or raise MeshError."""
    try:
        (left, right), (bottom, top) = box
        values = [float(left), float(right), float(bottom), float(top)]
        if not all(map(is_real, (left, right, bottom, top))):
            raise TypeError
    except Exception:  # of whatever a user hands in
        raise MeshError(f"box must be ((x0, x1), (y0, y1)), four numbers; got {box!r}.") from None
    if not all(map(math.isfinite, values)):
        raise MeshError(f"box must be finite; got {box!r}.")
    for axis, low, high in (("x", values[0], values[1]), ("y", values[2], values[3])):
        if not low < high:
            raise MeshError(f"box must have {axis}0 < {axis}1; got {axis}0 = {low:g} and {axis}1 = {high:g}.")
        if high - low < SHORTEST or max(-low, high) > LARGEST:
            raise MeshError(
                f"box must have sides above {SHORTEST:g} and coordinates below {LARGEST:g}, or areas underflow and "
                f"overflow; got {axis}0 = {low:g} and {axis}1 = {high:g}. Choose other units."
            )
    return Box(*values)


def check_whole(name: str, value: Any, least: int = 1, most: float = 1e100) -> int:
    """Return a whole number from ``least`` to ``most``, or raise MeshError."""
    if not is_whole(value):
        raise MeshError(f"{name} must be a whole number; got {value!r}.")
    if value < least:
        raise MeshError(f"{name} must be at least {least}; got {value!r}.")
    if value > most:
        raise MeshError(f"{name} must be at most {most:g}; got {brief(value)}.")
    return int(value)


def check_fraction(name: str, value: Any, high: float, *, closed: bool = False) -> float:
    """Return a number in [0, high), or [0, high] if ``closed``, or raise MeshError."""
    inside = is_real(value) and (0.0 <= value < high or (closed and value == high))
    if not inside:
        bracket = "]" if closed else ")"
        raise MeshError(f"{name} must be a number in [0, {high:g}{bracket}; got {value!r}.")
    return float(value)


def cell_counts(
    n: Count | None, box: Box, size: float | None = None, stretch: float = 1.0, each: int = 1
) -> tuple[int, int]:
    """Cells along x and y, at least one: the given pair, or as many as squares so wide fill the box.

    `stretch` is how much wider than squares, and lower, the cells of a family are; `each`, how many cells it may make
    of one of them.
    """
    if isinstance(n, (tuple, list, np.ndarray)) and size is None:
        if len(n) != 2:
            raise MeshError(f"n must be a whole number or a pair (nx, ny); got {n!r}.")
        nx, ny = check_whole("nx", n[0]), check_whole("ny", n[1])
    else:
        along_x, along_y = squares_along(n, box, size)
        nx, ny = max(1, round(along_x / stretch)), max(1, round(along_y * stretch))
    check_total(each * nx * ny)
    return nx, ny


def squares_along(n: Count | None, box: Box, size: float | None) -> tuple[float, float]:
    """How many squares, no whole numbers, fit along x and y: n across the shortest side, or of the given size."""
    if (n is None) == (size is None):
        both = "neither" if n is None else f"n = {brief(n)} and size = {brief(size)}"
        raise MeshError(f"n must be given (cells across the shortest side) or size= (the width of a cell); got {both}.")
    if size is None:
        cells, shortest = check_whole("n", n), min(box.width, box.height)
        return cells * (box.width / shortest), cells * (box.height / shortest)
    if not is_real(size) or not SHORTEST <= size <= LARGEST:
        raise MeshError(f"size must be a length above {SHORTEST:g} and below {LARGEST:g}; got {brief(size)}.")
    check_total(max(1.0, box.width / size) * max(1.0, box.height / size))
    return box.width / size, box.height / size


def check_total(cells: Number) -> Number:
    """Return the number of cells if a mesh of so many is no slip of the keyboard, or raise MeshError."""
    if cells > MOST_CELLS:
        raise MeshError(f"that would be {cells:.3g} cells; at most {MOST_CELLS:g} are made. Ask for fewer.")
    return cells


def ticks(low: float, high: float, count: int) -> Floats:
    """Return count + 1 equally spaced numbers, both ends exact, or raise MeshError if rounding makes them meet."""
    line = np.linspace(low, high, count + 1)
    if not np.all(np.diff(line) > 0.0):
        raise MeshError(
            f"{count} cells between {low!r} and {high!r} are narrower than the spacing of floating-point "
            "numbers there; use fewer cells or a box nearer to the origin."
        )
    return line
