"""Checks of boxes, cell counts, names and cell data."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import (
    SAME,
    Bools,
    Floats,
    brief,
    call_function,
    is_real,
    is_whole,
    plain,
    read_only,
)
from vemcvx.base.errors import MeshError
from vemcvx.base.outline import coordinates

Count = int | tuple[int, int]
SpaceCount = int | tuple[int, int, int]
Corners = tuple[tuple[float, float], tuple[float, float]]
SpaceCorners = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
AXES = "xyz"
MOST_CELLS = 10**8  # a mesh with this many cells takes 10 GB before assembly
SHORTEST, LARGEST = 1e-60, 1e60  # areas and moments of cells must neither overflow nor underflow

UNIT_BOX: Corners = ((0.0, 1.0), (0.0, 1.0))
UNIT_CUBE: SpaceCorners = ((0.0, 1.0), (0.0, 1.0), (0.0, 1.0))


@dataclass(frozen=True)
class Box:
    """A box between two opposite corners, in the plane or in space."""

    low: tuple[float, ...]
    high: tuple[float, ...]

    @property
    def lengths(self) -> tuple[float, ...]:
        """Lengths of the sides along the axes."""
        return tuple(high - low for low, high in zip(self.low, self.high, strict=True))

    def ticks(self, *counts: int) -> list[Floats]:
        """Return the ends of equal intervals along the axes."""
        ends = zip(self.low, self.high, counts, strict=True)
        return [np.linspace(low, high, count + 1) for low, high, count in ends]


def check_box(box: Any, dimension: int = 2) -> Box:
    """Return the box between two corners, or raise MeshError."""
    given = plain(box)
    if given is None or given.shape != (dimension, 2) or given.dtype.kind not in "iuf":
        wanted = ", ".join(f"({axis}0, {axis}1)" for axis in AXES[:dimension])
        raise MeshError(f"box must be ({wanted}), {2 * dimension} real numbers; got {brief(box)}.")
    for axis, (low, high) in zip(AXES, given.tolist(), strict=False):
        if not low < high:
            raise MeshError(f"box must have {axis}0 < {axis}1; got {axis}0 = {low:g} and {axis}1 = {high:g}.")
        farthest = max(-low, high)
        if high - low < max(SHORTEST, SAME * farthest) or farthest > LARGEST:
            raise MeshError(
                f"box must have sides above {SHORTEST:g} and above {SAME:g} times its largest coordinate, and "
                f"coordinates below {LARGEST:g}; got {axis}0 = {low:g} and {axis}1 = {high:g}. Choose other units or a "
                "box nearer to the origin."
            )
    low, high = given.astype(float).T.tolist()
    return Box(tuple(low), tuple(high))


def check_whole(name: str, value: Any, least: int = 1) -> int:
    """Return the value as an int, or raise MeshError."""
    if not is_whole(value) or not least <= value <= 1e100:
        raise MeshError(f"{name} must be a whole number, at least {least}; got {brief(value)}.")
    return int(value)


def cell_counts(n: Any, box: Box, size: float | None = None, stretch: float = 1.0, each: int = 1) -> tuple[int, ...]:
    """Return the number of cells along each axis."""
    if (isinstance(n, (tuple, list)) or (isinstance(n, np.ndarray) and n.ndim > 0)) and size is None:
        names = [f"n{axis}" for axis in AXES[: len(box.low)]]
        if len(n) != len(names):
            raise MeshError(f"n must be a whole number or ({', '.join(names)}); got {brief(n)}.")
        counts = [check_whole(name, value) for name, value in zip(names, n, strict=True)]
    else:
        along_x, along_y, *above = _cells_along(n, box.lengths, size)
        counts = [max(1, round(along)) for along in (along_x / stretch, along_y * stretch, *above)]
    check_total(each * math.prod(counts))
    return tuple(counts)


def _cells_along(n: Any, lengths: tuple[float, ...], size: float | None) -> list[float]:
    if (n is None) == (size is None):
        both = "neither" if n is None else f"n = {brief(n)} and size = {brief(size)}"
        raise MeshError(f"give either n (cells along the shortest side) or size= (the width of a cell); got {both}.")
    if size is None:
        cells, shortest = check_whole("n", n), min(lengths)
        return [cells * (length / shortest) for length in lengths]
    if not is_real(size) or not SHORTEST <= size <= LARGEST:
        raise MeshError(f"size must be a length above {SHORTEST:g} and below {LARGEST:g}; got {brief(size)}.")
    check_total(math.prod(max(1.0, length / size) for length in lengths))
    return [length / size for length in lengths]


def check_total(cells: float) -> None:
    """Raise MeshError if there are more than `MOST_CELLS` cells."""
    if cells > MOST_CELLS:
        raise MeshError(f"the mesh would have {cells:.3g} cells; at most {MOST_CELLS:g} are allowed. Ask for fewer.")


def move_into_box(points: Floats, size: Floats, low: Floats, high: Floats) -> Floats:
    """Map points from the box [0, size] to the box [low, high]."""
    moved = np.clip(low + points * ((high - low) / size), low, high)
    moved = np.where(points == 0.0, low, moved)
    return np.where(points == size, high, moved)


WHOLE = "boundary"
SIDES = {2: (("left", "right"), ("bottom", "top")), 3: (("left", "right"), ("front", "back"), ("bottom", "top"))}
"""Dimension -> names of opposite sides, for each axis."""
T = TypeVar("T")


def check_name(name: object, what: str = "part of the boundary") -> str:
    """Return a valid name, or raise MeshError."""
    if not isinstance(name, str) or not name:
        raise MeshError(f"the name of a {what} must be a non-empty string; got {name!r}.")
    if name == WHOLE and what == "part of the boundary":
        raise MeshError(f"the name {WHOLE!r} is taken: it always means the whole boundary. Choose another name.")
    return name


def select_parts(name: object, predicate: Callable[[Floats], Bools], places: Floats, parts: str = "edges") -> Bools:
    """Return a mask of the edges or faces that a predicate selects."""
    name, m = check_name(name), len(places)
    middles = {"edges": "midpoints", "faces": "centroids"}[parts]
    wanted = f"take all {middles} {places.shape} at once and return a boolean for each, like lambda x: x[:, 0] < 0.5"
    failed = f"boundary {name!r}: the predicate failed for {middles} of shape {places.shape}"
    chosen = _array(call_function(predicate, (places,), failed, wanted))
    if chosen.shape != (m,) or chosen.dtype != bool:
        raise MeshError(
            f"boundary {name!r}: the predicate must {wanted}; it returned {chosen.dtype} of shape {chosen.shape}."
        )
    if not chosen.any():
        low, high = (coordinates(corner, 6) for corner in (places.min(axis=0), places.max(axis=0)))
        raise MeshError(
            f"boundary {name!r}: the predicate selects none of the {m} boundary {parts}; their {middles} lie between "
            f"{low} and {high}."
        )
    return chosen


def check_mapping(given: Mapping[str, T] | None, what: str, wanted: str) -> Mapping[str, T]:
    """Return the given mapping, or an empty mapping for None."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise MeshError(f"{what} must map names to {wanted}; got {type(given).__name__}.")
    return given


def check_cell_data(cell_data: Mapping[str, ArrayLike] | None, n_cells: int) -> dict[str, NDArray[Any]]:
    """Return read-only arrays with one row per cell, or raise MeshError."""
    checked = {}
    for name, values in check_mapping(cell_data, "cell_data", f"arrays of {n_cells} rows").items():
        check_name(name, "cell datum")
        array = _array(values).copy()
        if array.ndim == 0 or len(array) != n_cells or array.dtype.kind not in "biuf":
            raise MeshError(
                f"cell datum {name!r} must hold one number (or row of numbers) for each of the {n_cells} "
                f"cells; got {array.dtype} of shape {array.shape}."
            )
        checked[name] = read_only(array)
    return checked


def _array(values: ArrayLike) -> NDArray[Any]:
    array = plain(values)
    return np.empty(0, dtype=object) if array is None else array
