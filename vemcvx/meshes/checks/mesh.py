"""From what a user hands in to the arrays of a valid mesh, or to a MeshError that names the fault.

Mended, with a note for a warning: clockwise cells (turned) and nodes that no cell uses (dropped). The order of the
checks is that in which faults can be told: numbers, places of nodes, single cells, how cells fit together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.arrays import Floats, Ints, plain
from vemcvx.errors import MeshError
from vemcvx.meshes.box import LARGEST
from vemcvx.meshes.checks.cells import check_cells
from vemcvx.meshes.checks.tiling import check_coincident, check_tiling
from vemcvx.meshes.interfaces import Interface, check_interfaces, pairs_of, places_of
from vemcvx.meshes.polygons.topology import cell_of_corner, turned


@dataclass(frozen=True, eq=False)
class Checked:
    """Arrays of a valid mesh (see `PolygonMesh`), its interfaces as given, and what was mended on the way."""

    points: Floats
    offsets: Ints
    vertices: Ints
    interfaces: Mapping[str, Interface]
    node_map: Ints | None
    notes: tuple[str, ...]


def checked(
    points: ArrayLike, cells: Sequence[ArrayLike] | NDArray[np.integer], interfaces: Mapping[str, Interface] | None
) -> Checked:
    """Return valid arrays made of a user's points and cells, or raise MeshError; only interfaces have double nodes."""
    points = check_points(points)
    offsets, vertices = check_cell_lists(cells, len(points))
    notes = []
    used = np.flatnonzero(np.bincount(vertices, minlength=len(points)))
    interfaces = check_interfaces(interfaces, len(points))
    place = places_of(pairs_of(interfaces), points)
    check_coincident(points, np.unique(place[used]))
    backwards = check_cells(points, offsets, vertices) < 0.0
    if backwards.any():
        vertices = turned(offsets, vertices, backwards)
        notes.append(
            f"{backwards.sum()} of {len(backwards)} cells were listed clockwise (the first is cell "
            f"{np.flatnonzero(backwards)[0]}) and have been turned."
        )
    check_tiling(points, offsets, place[vertices])
    node_map = None
    if len(used) < len(points):
        node_map, note = dropped(used, len(points))
        notes.append(note)
        points, vertices = points[used], node_map[vertices]
    return Checked(points, offsets, vertices, interfaces, node_map=node_map, notes=tuple(notes))


def dropped(used: Ints, n_nodes: int) -> tuple[Ints, str]:
    """New numbers of nodes of which some are used, -1 for the others, and a note on these."""
    node_map = np.full(n_nodes, -1)
    node_map[used] = np.arange(len(used))
    return node_map, (
        f"{n_nodes - len(used)} of {n_nodes} nodes belong to no cell (the first is node "
        f"{np.flatnonzero(node_map < 0)[0]}) and have been dropped; mesh.node_map gives the new numbers."
    )


def check_points(points: ArrayLike, dimension: int = 2) -> Floats:
    """A copy of the points as finite floats (n_nodes, dimension), or MeshError."""
    given = plain(points)
    shape = f"(n_nodes, {dimension})"
    if given is None or given.dtype.kind not in "biuf":
        raise MeshError(f"points must be real numbers of shape {shape}; what was given does not read as such.")
    array = np.array(given, dtype=float)
    if array.ndim != 2 or array.shape[1] != dimension:
        hints = {
            (2, 3): " Meshes are plane: leave out the third coordinate; in space there is PolyhedralMesh.",
            (3, 2): " In the plane there is PolygonMesh.",
        }
        raise MeshError(
            f"points must have the shape {shape}; got {array.shape}.{hints.get((dimension, *array.shape[1:]), '')}"
        )
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise MeshError(f"node {bad[0]} is at {tuple(array[bad[0]].tolist())}: coordinates must be finite.")
    largest = np.abs(array).max(initial=0.0)
    if largest > LARGEST:
        raise MeshError(f"coordinates reach {largest:.3g}; more than {LARGEST:g} overflows. Choose other units.")
    return array


def check_cell_lists(cells: Sequence[ArrayLike] | NDArray[np.integer], n_nodes: int) -> tuple[Ints, Ints]:
    """Offsets and vertices of cells of at least three different nodes that exist, or MeshError."""
    offsets, vertices = _flattened(cells)
    if len(offsets) < 2:
        raise MeshError("a mesh needs at least one cell; got none.")
    check_polygons(offsets, vertices, n_nodes, lambda cell: f"cell {cell}")
    return offsets, vertices


def check_polygons(offsets: Ints, vertices: Ints, n_nodes: int, named: Callable[[int], str]) -> None:
    """Raise MeshError unless polygons have at least three different nodes that exist; `named` tells which it is."""
    few = np.flatnonzero(np.diff(offsets) < 3)
    if len(few):
        count = offsets[few[0] + 1] - offsets[few[0]]
        raise MeshError(f"{named(few[0])} has {count} vertices; a polygon has at least 3.")
    owner = cell_of_corner(offsets)
    bad = np.flatnonzero((vertices < 0) | (vertices >= n_nodes))
    if len(bad):
        raise MeshError(
            f"{named(owner[bad[0]])} names node {vertices[bad[0]]}; the {n_nodes} nodes are numbered 0 to "
            f"{n_nodes - 1}."
        )
    keys = np.sort(owner * n_nodes + vertices)
    twice = keys[1:][np.diff(keys) == 0]
    if len(twice):
        polygon, node = divmod(int(twice[0]), n_nodes)
        raise MeshError(f"{named(polygon)} names node {node} twice; every vertex must appear once.")


def _flattened(cells: Sequence[ArrayLike] | NDArray[np.integer]) -> tuple[Ints, Ints]:
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "iu":
        if cells.ndim != 2:
            raise MeshError(f"cells as one array must have the shape (n_cells, k); got {cells.shape}.")
        return np.arange(len(cells) + 1) * cells.shape[1], cells.astype(np.int64).ravel()
    wanted = f"cells must be a sequence of sequences of node numbers; got {type(cells).__name__}."
    try:
        given = [cell if type(cell) is np.ndarray else plain(cell) for cell in cells]
    except Exception:  # of whatever a user hands in
        raise MeshError(wanted) from None
    rows = [row for row in given if row is not None]
    if len(rows) < len(given):
        raise MeshError(wanted)
    for number, row in enumerate(rows):
        if row.ndim != 1 or (row.dtype.kind not in "iu" and row.size):
            raise MeshError(f"cell {number} must be a list of node numbers; got {row.dtype} of shape {row.shape}.")
    offsets = np.zeros(len(rows) + 1, dtype=np.int64)
    np.cumsum([len(row) for row in rows], out=offsets[1:])
    flat = [row for row in rows if row.size]
    whole = np.concatenate(flat, dtype=np.int64, casting="unsafe") if flat else np.empty(0, dtype=np.int64)
    return offsets, whole
