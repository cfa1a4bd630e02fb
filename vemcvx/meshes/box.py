"""The box and the cell counts that every family of meshes is asked for.

A family is called with n (cells across the shortest side), a count for each axis or the size of a cell, and with a box
((x0, x1), (y0, y1)), in space ((x0, x1), (y0, y1), (z0, z1)). Counts do not depend on the unit of length.
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
SpaceCount = int | tuple[int, int, int]
Number = TypeVar("Number", int, float)
Corners = tuple[tuple[float, float], tuple[float, float]]
SpaceCorners = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
AXES = "xyz"
# A mesh of that size takes 10 GB before anything is assembled.
MOST_CELLS = 10**8
# Areas and moments of cells must neither overflow nor vanish.
SHORTEST, LARGEST = 1e-60, 1e60

UNIT_BOX: Corners = ((0.0, 1.0), (0.0, 1.0))
UNIT_CUBE: SpaceCorners = ((0.0, 1.0), (0.0, 1.0), (0.0, 1.0))


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


@dataclass(frozen=True)
class SpaceBox:
    """The box between two opposite corners in space."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    @property
    def lengths(self) -> tuple[float, ...]:
        """Its edges along x, y and z."""
        return tuple(high - low for low, high in zip(self.low, self.high, strict=True))


def check_box(box: Corners) -> Box:
    """Return the rectangle as four finite numbers, or raise MeshError."""
    (left, right), (bottom, top) = _intervals(box, 2)
    return Box(left, right, bottom, top)


def check_space_box(box: SpaceCorners) -> SpaceBox:
    """Return the box in space as two corners of finite numbers, or raise MeshError."""
    low, high = zip(*_intervals(box, 3), strict=True)
    return SpaceBox(low, high)


def _intervals(box: Any, dimension: int) -> list[tuple[float, float]]:
    try:
        given = [(low, high) for low, high in box]
        values = [(float(low), float(high)) for low, high in given]
        if len(given) != dimension or not all(is_real(value) for pair in given for value in pair):
            raise TypeError
    except Exception:  # of whatever a user hands in
        wanted = ", ".join(f"({axis}0, {axis}1)" for axis in AXES[:dimension])
        count = {2: "four", 3: "six"}[dimension]
        raise MeshError(f"box must be ({wanted}), {count} numbers; got {box!r}.") from None
    if not all(math.isfinite(value) for pair in values for value in pair):
        raise MeshError(f"box must be finite; got {box!r}.")
    for axis, (low, high) in zip(AXES, values, strict=False):
        if not low < high:
            raise MeshError(f"box must have {axis}0 < {axis}1; got {axis}0 = {low:g} and {axis}1 = {high:g}.")
        if high - low < SHORTEST or max(-low, high) > LARGEST:
            raise MeshError(
                f"box must have sides above {SHORTEST:g} and coordinates below {LARGEST:g}, or areas underflow and "
                f"overflow; got {axis}0 = {low:g} and {axis}1 = {high:g}. Choose other units."
            )
    return values


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
    if listed(n) and size is None:
        nx, ny = _given_counts(n, 2)
    else:
        along_x, along_y = _cells_along(n, (box.width, box.height), size)
        nx, ny = max(1, round(along_x / stretch)), max(1, round(along_y * stretch))
    check_total(each * nx * ny)
    return nx, ny


def space_counts(n: SpaceCount | None, box: SpaceBox, size: float | None = None, each: int = 1) -> tuple[int, int, int]:
    """Cells along x, y and z, at least one: those given, or as many as cubes so wide fill the box."""
    if listed(n) and size is None:
        nx, ny, nz = _given_counts(n, 3)
    else:
        nx, ny, nz = (max(1, round(along)) for along in _cells_along(n, box.lengths, size))
    check_total(each * nx * ny * nz)
    return nx, ny, nz


def listed(n: object) -> bool:
    """Whether numbers of cells are given one an axis."""
    return isinstance(n, (tuple, list)) or (isinstance(n, np.ndarray) and n.ndim > 0)


def _given_counts(n: Any, dimension: int) -> list[int]:
    names = [f"n{axis}" for axis in AXES[:dimension]]
    if len(n) != dimension:
        several = {2: "pair", 3: "triple"}[dimension]
        raise MeshError(f"n must be a whole number or a {several} ({', '.join(names)}); got {brief(n)}.")
    return [check_whole(name, value) for name, value in zip(names, n, strict=True)]


def _cells_along(n: Any, lengths: tuple[float, ...], size: float | None) -> list[float]:
    """How many equal cells, no whole numbers, fit along each axis: n across the shortest side, or of the given size."""
    if (n is None) == (size is None):
        both = "neither" if n is None else f"n = {brief(n)} and size = {brief(size)}"
        raise MeshError(f"n must be given (cells across the shortest side) or size= (the width of a cell); got {both}.")
    if size is None:
        cells, shortest = check_whole("n", n), min(lengths)
        return [cells * (length / shortest) for length in lengths]
    if not is_real(size) or not SHORTEST <= size <= LARGEST:
        raise MeshError(f"size must be a length above {SHORTEST:g} and below {LARGEST:g}; got {brief(size)}.")
    check_total(math.prod(max(1.0, length / size) for length in lengths))
    return [length / size for length in lengths]


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


def placed(points: Floats, size: Floats, low: Floats, high: Floats) -> Floats:
    """Points of [0, size] in [low, high]; those on a side of the one lie on the side of the other to the bit."""
    moved = np.clip(low + points * ((high - low) / size), low, high)
    moved = np.where(points == 0.0, low, moved)
    return np.where(points == size, high, moved)
