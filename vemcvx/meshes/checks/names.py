"""Named parts of the boundary, and named data on cells: checks of what the user hands in."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.arguments import called
from vemcvx.arrays import Bools, Floats, Ints, plain, read_only
from vemcvx.errors import MeshError
from vemcvx.meshes.box import Box
from vemcvx.meshes.polygons.topology import edge_keys

WHOLE = "boundary"
T = TypeVar("T")


def side_edges(points: Floats, boundary: Ints, box: Box, tolerance: float = 0.0) -> dict[str, Ints]:
    """Boundary edges on each side of the box; the families put points on its sides to the bit."""
    start, end = points[boundary[:, 0]], points[boundary[:, 1]]
    along = np.argmax(np.abs(end - start), axis=1)
    sides = {"left": (0, box.left), "right": (0, box.right), "bottom": (1, box.bottom), "top": (1, box.top)}
    named = {}
    for name, (axis, place) in sides.items():
        off = np.maximum(np.abs(start[:, axis] - place), np.abs(end[:, axis] - place))
        named[name] = read_only(boundary[(off <= tolerance) & (along != axis)])
    return named


def straight_sides(points: Floats, boundary: Ints) -> dict[str, Ints]:
    """Boundary edges that lie where x or y is extreme, by the names that families give them; those that there are."""
    (left, bottom), (right, top) = points[boundary].min(axis=(0, 1)), points[boundary].max(axis=(0, 1))
    # A mesh that was moved or scaled into place has straight sides to its digits.
    rounding = 1e-9 * max(right - left, top - bottom)
    sides = side_edges(points, boundary, Box(left, right, bottom, top), rounding)
    return {name: edges for name, edges in sides.items() if len(edges)}


def check_name(name: object) -> str:
    """Return a name that a part of the boundary may have, or raise MeshError."""
    if not isinstance(name, str) or not name:
        raise MeshError(f"the name of a part of the boundary must be a non-empty string; got {name!r}.")
    if name == WHOLE:
        raise MeshError(f"the name {WHOLE!r} is taken: it always means the whole boundary. Choose another name.")
    return name


def check_whole(given: Ints, boundary: Ints) -> None:
    """Raise MeshError where what is called the whole boundary, as meshes call it, is less; numbers or keys of parts."""
    if not np.array_equal(np.unique(given), np.unique(boundary)):
        raise MeshError(
            f"the name {WHOLE!r} is taken: it always means the whole boundary, and here it is given to "
            f"{len(np.unique(given))} of its {len(boundary)} parts. Choose another name, or leave it out."
        )


def chosen_parts(name: object, predicate: Callable[[Floats], Bools], places: Floats, parts: str = "edges") -> Bools:
    """Which parts of the boundary the predicate accepts by their middles (m, dim); see `with_boundary` of meshes."""
    name = check_name(name)
    m, dimension = places.shape
    middles = {"edges": "midpoints", "faces": "centroids"}[parts]
    if not callable(predicate):
        raise MeshError(
            f"boundary {name!r}: predicate must be a function of the {middles} (m, {dimension}); got {predicate!r}."
        )
    failed = f"boundary {name!r}: the predicate failed for {middles} of shape {places.shape}"
    chosen = _array(called(predicate, (places,), failed, f"take all {middles} at once and return a boolean for each"))
    if chosen.shape != (m,) or chosen.dtype != bool:
        raise MeshError(
            f"boundary {name!r}: the predicate gets {m} {middles}, shape ({m}, {dimension}), "
            f"and must return booleans of shape ({m},); it returned {chosen.dtype} of shape "
            f"{chosen.shape}. For example: lambda x: x[:, 0] < 0.5."
        )
    if not chosen.any():
        low, high = places.min(axis=0), places.max(axis=0)
        extent = " x ".join(f"[{a:g}, {b:g}]" for a, b in zip(low, high, strict=True))
        raise MeshError(
            f"boundary {name!r}: the predicate selects none of the {m} boundary {parts}; their {middles} lie in "
            f"{extent}."
        )
    return chosen


def check_mapping(given: Mapping[str, T] | None, what: str, wanted: str) -> Mapping[str, T]:
    """What is given by name, nothing for None; or MeshError."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise MeshError(f"{what} must map names to {wanted}; got {type(given).__name__}.")
    return given


def check_boundaries(
    boundaries: Mapping[str, ArrayLike] | None, boundary: Ints, n_nodes: int, node_map: Ints | None
) -> dict[str, Ints]:
    """Named edges as their cells run them, in the order of the boundary; MeshError if one is not on it."""
    keys = edge_keys(boundary, n_nodes)
    named = {}
    for name, given in check_mapping(boundaries, "boundaries", "edges (m, 2)").items():
        name = name if name == WHOLE else check_name(name)
        given = check_edges(name, given, n_nodes if node_map is None else len(node_map))
        edges = given if node_map is None else node_map[given]
        wanted = edge_keys(edges, n_nodes)
        strange = np.flatnonzero(~np.isin(wanted, keys) | (edges < 0).any(axis=1))
        if len(strange):
            a, b = given[strange[0]]
            raise MeshError(
                f"boundary {name!r}: ({a}, {b}) is not an edge of the boundary ({len(strange)} of "
                f"{len(given)} are not). Name only edges that belong to exactly one cell."
            )
        if name == WHOLE:
            check_whole(wanted, keys)
        else:
            named[name] = read_only(boundary[np.isin(keys, wanted)])
    return named


def check_edges(name: str, edges: ArrayLike, n_nodes: int) -> Ints:
    """Edges as pairs of node numbers that exist, (m, 2), or MeshError."""
    edges = _array(edges)
    if edges.ndim != 2 or edges.shape[1] != 2 or not len(edges) or edges.dtype.kind not in "iu":
        raise MeshError(
            f"boundary {name!r}: edges must be pairs of node numbers, shape (m, 2), at least one; got "
            f"{edges.dtype} of shape {edges.shape}."
        )
    if edges.min() < 0 or edges.max() >= n_nodes:
        raise MeshError(
            f"boundary {name!r}: node numbers run from 0 to {n_nodes - 1}; got {edges.min()} to {edges.max()}."
        )
    return edges.astype(np.int64)


def check_datum_name(name: object) -> str:
    """Return a name that a cell datum may have, or raise MeshError."""
    if not isinstance(name, str) or not name:
        raise MeshError(f"the name of a cell datum must be a non-empty string; got {name!r}.")
    return name


def check_cell_data(cell_data: Mapping[str, ArrayLike] | None, n_cells: int) -> dict[str, NDArray[Any]]:
    """Read-only copies of arrays with one row a cell, or MeshError."""
    checked = {}
    for name, values in check_mapping(cell_data, "cell_data", f"arrays of {n_cells} rows").items():
        check_datum_name(name)
        array = _array(values).copy()
        if array.ndim == 0 or len(array) != n_cells or array.dtype.kind not in "biuf":
            raise MeshError(
                f"cell datum {name!r} must hold one number (or row of numbers) for each of the {n_cells} "
                f"cells; got {array.dtype} of shape {array.shape}."
            )
        checked[name] = read_only(array)
    return checked


def plotted_values(values: str | ArrayLike, cell_data: Mapping[str, NDArray[Any]], n_cells: int) -> Floats:
    """One number a cell to colour it by: an array, or the name of a cell datum."""
    if isinstance(values, str):
        if values not in cell_data:
            raise MeshError(f"there is no cell datum {values!r}; this mesh has {', '.join(cell_data) or 'none'}.")
        values = cell_data[values]
    array = check_cell_data({"values": values}, n_cells)["values"]
    if array.ndim != 1:
        raise MeshError(f"values to plot must be one number a cell, shape ({n_cells},); got shape {array.shape}.")
    return array.astype(float)


def plotted_points(points: Floats, displacement: ArrayLike | None) -> Floats:
    """Points moved by the displacement, if there is one."""
    if displacement is None:
        return points
    array = _array(displacement)
    if array.shape != points.shape or array.dtype.kind not in "biuf":
        raise MeshError(
            f"displacement must be numbers of the shape {points.shape} of the points; got {array.dtype} of "
            f"shape {array.shape}."
        )
    moved: Floats = points + array
    return moved


def _array(values: ArrayLike) -> NDArray[Any]:
    """Values as an array; what makes none as an array of objects, which every check refuses."""
    array = plain(values)
    return np.empty(0, dtype=object) if array is None else array
