"""A mesh of the plane checked: from what a user hands in to arrays of cells that tile a domain, or to a MeshError.

Faults are told in the order in which they can be: numbers, places of nodes, single cells, how cells fit together.
Mended, with a note for a warning, are clockwise cells (turned) and nodes that no cell uses (dropped).

Let every cell be a simple counter-clockwise polygon, and every edge be used at most once in each direction. How often a
point is covered is then the winding number about it of the boundary (the edges used once). So the cells tile a domain
if and only if no two boundary edges meet but in common nodes, and no cell holds the middle of a boundary edge of
another: no pair of inner edges needs a look. Bodies side by side are checked by the same two searches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.arrays import Floats, Ints, plain
from vemcvx.errors import MeshError
from vemcvx.meshes.box import LARGEST
from vemcvx.meshes.interfaces import Interface, check_interfaces, pairs_of, places_of
from vemcvx.meshes.polygons.geometry import (
    TOLERANCE,
    areas_and_centroids,
    beside,
    clearances,
    close_pairs,
    crossing,
    diameters,
    holding,
    outlines,
    overlapping_boxes,
    rounding,
)
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    directed_edges,
    offsets_of,
    rows_in_order,
    shared_edges,
    turned,
)

# A slit below this part of the edges beside it is a mistake (single precision, printed digits), not a geometry.
NARROW = 1e-6
# Between bodies, which may have been drawn apart by programs of six digits or less, one below this part.
NARROW_BETWEEN_BODIES = 1e-3


def checked(
    points: ArrayLike, cells: Sequence[ArrayLike] | NDArray[np.integer], interfaces: Mapping[str, Interface] | None
) -> tuple[Floats, Ints, Ints, dict[str, Interface], Ints | None, list[str]]:
    """Valid arrays made of a user's points and cells (see `PolygonMesh`), or MeshError; only interfaces double nodes.

    Points, offsets, vertices, interfaces as given, the map of nodes, and notes on what was mended.
    """
    points = check_points(points)
    offsets, vertices = _flattened(cells)
    if len(offsets) < 2:
        raise MeshError("a mesh needs at least one cell; got none.")
    check_polygons(offsets, vertices, len(points), lambda cell: f"cell {cell}")
    notes = []
    used = np.flatnonzero(np.bincount(vertices, minlength=len(points)))
    interfaces = check_interfaces(interfaces, len(points))
    place = places_of(pairs_of(interfaces), points)
    check_coincident(points, np.unique(place[used]))
    polygons = outlines(points, offsets, vertices)
    backwards = check_cells(points, offsets, vertices, polygons) < 0.0
    if backwards.any():
        vertices = turned(offsets, vertices, backwards)
        notes.append(
            f"{backwards.sum()} of {len(backwards)} cells were listed clockwise (the first is cell "
            f"{np.flatnonzero(backwards)[0]}) and have been turned."
        )
    _check_tiling(points, offsets, place[vertices], polygons)
    node_map = None
    if len(used) < len(points):
        node_map, note = dropped(used, len(points))
        notes.append(note)
        points, vertices = points[used], node_map[vertices]
    return points, offsets, vertices, interfaces, node_map, notes


def dropped(used: Ints, n_nodes: int) -> tuple[Ints, str]:
    """New numbers of nodes of which some are used, -1 for the others, and a note on these."""
    node_map = np.full(n_nodes, -1)
    node_map[used] = np.arange(len(used))
    return node_map, (
        f"{n_nodes - len(used)} of {n_nodes} nodes belong to no cell (the first is node "
        f"{np.flatnonzero(node_map < 0)[0]}) and have been dropped; mesh.node_map gives the new numbers."
    )


# Numbers.


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


def _flattened(cells: Sequence[ArrayLike] | NDArray[np.integer]) -> tuple[Ints, Ints]:
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "iu":
        if cells.ndim != 2:
            raise MeshError(f"cells as one array must have the shape (n_cells, k); got {cells.shape}.")
        return np.arange(len(cells) + 1) * cells.shape[1], cells.astype(np.int64).ravel()
    wanted = f"cells must be a sequence of sequences of node numbers; got {type(cells).__name__}."

    def fault(number: int, row: NDArray[Any] | None) -> str:
        if row is None:
            return wanted
        return f"cell {number} must be a list of node numbers; got {row.dtype} of shape {row.shape}."

    try:
        rows = list(cells)
    except Exception:  # of whatever a user hands in
        raise MeshError(wanted) from None
    return laid_flat(rows, fault)


def laid_flat(rows: list[Any], fault: Callable[[int, NDArray[Any] | None], str]) -> tuple[Ints, Ints]:
    """Offsets and entries of rows of whole numbers, or MeshError.

    `fault` tells what is wrong with a row by its number, and the array that it makes, None if it makes none.
    """
    flat = _all_at_once(rows)
    if flat is None:
        made = [plain(row) for row in rows]
        for number, row in enumerate(made):
            if row is None or row.ndim != 1 or (row.dtype.kind not in "iu" and row.size):
                raise MeshError(fault(number, row))
        rows = [row for row in made if row is not None]
        flat = np.concatenate([np.empty(0, dtype=np.int64), *rows], dtype=np.int64, casting="unsafe")
    return offsets_of(np.array([len(row) for row in rows], dtype=np.int64)), flat


def _all_at_once(rows: list[Any]) -> Ints | None:
    """The entries of arrays, or of plain lists, of whole numbers; None if something else is among them."""
    kinds = set(map(type, rows))
    if kinds == {np.ndarray}:
        whole = {row.ndim for row in rows} == {1} and {row.dtype.kind for row in rows} <= {"i", "u"}
        return np.concatenate(rows, dtype=np.int64, casting="unsafe") if whole else None
    if not kinds <= {list, tuple, np.ndarray}:
        return None
    try:
        entries = list(chain.from_iterable(rows))
        flat: NDArray[Any] = np.array(entries)
    except Exception:  # ragged, or no numbers
        return None
    whole = flat.ndim == 1 and flat.dtype.kind in "iu" and not {bool, np.bool_} & set(map(type, entries))
    return flat.astype(np.int64) if whole else None


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


def brief_row(nodes: Iterable[int] | Ints) -> str:
    """Node numbers in brackets, long lists cut."""
    shown = list(map(str, nodes))
    return f"({', '.join(shown[:6])}{', ...' if len(shown) > 6 else ''})"


def check_coincident(points: Floats, used: Ints) -> None:
    """Raise MeshError if two of the used nodes are in the same place, up to rounding."""
    place = points[used]
    order = np.lexsort(place.T)
    same = np.flatnonzero((np.diff(place[order], axis=0) == 0.0).all(axis=1))
    pairs = np.column_stack([order[same], order[same + 1]])
    if not len(pairs):
        pairs = close_pairs(place, TOLERANCE * np.abs(place).max())
        apart = np.abs(place[pairs[:, 0]] - place[pairs[:, 1]]).max(axis=1)
        pairs = pairs[apart <= rounding(place[pairs[:, 0]], place[pairs[:, 1]])]
    if len(pairs):
        a, b = sorted(used[pairs[0]])
        at = ", ".join(f"{x:.9g}" for x in points[a])
        bodies = (
            "; or, if two bodies meet there, make a mesh (a file) of each and put them together with vx.meshes.bodies, "
            "which keeps the nodes of each and names the interface"
        )
        raise MeshError(
            f"nodes {a} and {b} are in the same place, ({at}). Give them one number, so that the cells around them are "
            f"joined{bodies if points.shape[1] == 2 else ''}."
        )


# Edges that meet where they must not.


@dataclass(frozen=True)
class Misfit:
    """A place where edges meet as they must not.

    Attributes
    ----------
    kind : {"crossing", "touching", "gap"}
        Edges cross; a node lies on an edge; it lies hardly beside one.
    edge, other : int
        Numbers of the edges: the other one crosses the edge, or has the node.
    node : int
        The node on or beside the edge, else -1.
    distance : float
        Width of a gap.
    """

    kind: str
    edge: int
    other: int
    node: int = -1
    distance: float = 0.0


def misfit_of(
    points: Floats, ends: Ints, shortest: Floats | None = None, *, bodies: Ints | None = None, cells: Ints | None = None
) -> Misfit | None:
    """Find the first place where edges meet but in common nodes.

    Parameters
    ----------
    points : (n_nodes, 2) array
    ends : (m, 2) array of int
        The edges, what they bound on their left.
    shortest : (n_nodes,) array, optional
        The shortest edge at each node, if gaps are looked for as well.
    bodies, cells : (m,) array of int, optional
        The body of each edge: gaps between bodies may be wider. The cell of each edge: only edges of one are compared.
    """
    corners = points[ends]
    lengths = np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)
    widest = 0.0 if shortest is None else NARROW if bodies is None else NARROW_BETWEEN_BODIES
    margin = (widest * lengths + TOLERANCE * np.abs(corners).max(axis=(1, 2)))[:, None]
    low, high = corners.min(axis=1) - margin, corners.max(axis=1) + margin
    one, other = overlapping_boxes(low, high, low, high)
    compared = one != other if cells is None else (one != other) & (cells[one] == cells[other])
    one, other = one[compared], other[compared]
    bad = np.flatnonzero(crossing(points, ends[one], ends[other]))
    if len(bad):
        return Misfit("crossing", int(one[bad[0]]), int(other[bad[0]]))
    node = ends[other].T.ravel()
    one, other = np.tile(one, 2), np.tile(other, 2)
    apart = (ends[one] != node[:, None]).all(axis=1)
    one, other, node = one[apart], other[apart], node[apart]
    start, end = points[ends[one, 0]], points[ends[one, 1]]
    distance, side = beside(points[node], start, end)
    bad = np.flatnonzero(distance <= rounding(points[node], start, end))
    if len(bad):
        # A spike also makes edges farther on touch: it comes first.
        k = bad[np.argmax((ends[one[bad], :, None] == ends[other[bad], None]).any(axis=(1, 2)))]
        return Misfit("touching", int(one[k]), int(other[k]), int(node[k]))
    if shortest is None:
        return None
    narrow = NARROW if bodies is None else np.where(bodies[one] == bodies[other], NARROW, NARROW_BETWEEN_BODIES)
    bad = np.flatnonzero((side < 0.0) & (distance <= narrow * np.minimum(shortest[node], lengths[one])))
    if not len(bad):
        return None
    k = bad[0]
    return Misfit("gap", int(one[k]), int(other[k]), int(node[k]), float(distance[k]))


def shortest_edges(points: Floats, ends: Ints) -> Floats:
    """The shortest of the edges (m, 2) at each node, (n_nodes,)."""
    shortest = np.full(len(points), np.inf)
    lengths = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    np.minimum.at(shortest, ends.ravel(), np.repeat(lengths, 2))
    return shortest


# Single cells.


def check_cells(points: Floats, offsets: Ints, vertices: Ints, polygons: NDArray[Any]) -> Floats:
    """Signed areas (n_cells,), or MeshError at the first cell that is not a simple polygon with an area."""
    areas, sizes = areas_and_centroids(points, offsets, vertices)[0], diameters(points, offsets, vertices)
    largest = np.maximum.reduceat(np.abs(points[vertices]).max(axis=1), offsets[:-1])
    flat = np.flatnonzero(np.abs(areas) <= TOLERANCE * largest * sizes)
    found = fault_of(points, offsets, vertices, polygons)
    if found and (found[0].kind == "crossing" or not len(flat)):
        raise MeshError(f"cell {found[1]}{fault_in_words(found[0], *found[2:])}")
    if len(flat):
        cell = flat[0]
        raise MeshError(
            f"cell {cell} has no area: its vertices {brief_row(vertices[offsets[cell] : offsets[cell + 1]])} lie on "
            f"one line (area {areas[cell]:.3g}, diameter {sizes[cell]:.3g}). Remove it or correct its vertices."
        )
    return areas


Fault = tuple[Misfit, int, Ints, Ints]


def fault_of(points: Floats, offsets: Ints, vertices: Ints, polygons: NDArray[Any]) -> Fault | None:
    """Find where the first polygon that is not simple meets itself, its number, and the nodes of the two edges."""
    largest = np.maximum.reduceat(np.abs(points[vertices]).max(axis=1), offsets[:-1])
    suspects = np.flatnonzero(clearances(polygons) <= TOLERANCE * largest)
    rows = rows_in_order(offsets, vertices, suspects)
    ends, cells = directed_edges(*rows), cell_of_corner(rows[0])
    misfit = misfit_of(points, ends, cells=cells) if len(suspects) else None
    if misfit is None:
        return None
    return misfit, int(suspects[cells[misfit.edge]]), ends[misfit.edge], ends[misfit.other]


def fault_in_words(misfit: Misfit, edge: Ints, other: Ints) -> str:
    """The fault of a polygon in words that follow its name."""
    if misfit.kind == "crossing":
        return (
            f" crosses itself: its edges {brief_row(edge)} and {brief_row(other)} intersect. List its vertices in "
            "order around it."
        )
    tip = np.intersect1d(edge, other)
    if len(tip):
        return (
            f" has a spike: at node {tip[0]} its outline turns back on itself (node {misfit.node} lies on the edge "
            f"{brief_row(edge)}). Remove the node at the tip from the cell."
        )
    return (
        f" touches itself: its node {misfit.node} lies on its edge {brief_row(edge)}. Split the cell there, or move "
        "the node."
    )


# How cells fit together.


def _check_tiling(points: Floats, offsets: Ints, vertices: Ints, polygons: NDArray[Any]) -> None:
    """Raise MeshError if the counter-clockwise cells overlap, or leave slits or one-sided hanging nodes."""
    ends, cells = directed_edges(offsets, vertices), cell_of_corner(offsets)
    boundary = _check_sharing(offsets, vertices, ends, cells, len(points))
    if not len(boundary):
        raise MeshError("the cells have no boundary: they overlap.")
    shortest, ends, cells = shortest_edges(points, ends), ends[boundary], cells[boundary]
    misfit = misfit_of(points, ends, shortest)
    if misfit:
        raise MeshError(_sentence(misfit, ends, cells))
    covered = covering(points, ends, cells, polygons)
    if covered:
        raise MeshError(
            f"cell {cells[covered[0]]} overlaps another cell: beside its edge {brief_row(ends[covered[0]])} the plane "
            f"is covered more than once, by cell {covered[1]}. Remove or correct one of the cells."
        )


def covering(points: Floats, ends: Ints, cells: Ints, polygons: NDArray[Any]) -> tuple[int, int] | None:
    """The first of some edges of cells whose middle another cell holds, and that cell."""
    edge, cell = holding(polygons, points[ends].mean(axis=1))
    bad = np.flatnonzero(cell != cells[edge])
    return (int(edge[bad[0]]), int(cell[bad[0]])) if len(bad) else None


def _check_sharing(offsets: Ints, vertices: Ints, ends: Ints, cells: Ints, n_nodes: int) -> Ints:
    """Corners on the boundary; MeshError if an edge belongs to three cells, or to two on the same side."""
    shared = shared_edges(offsets, vertices, n_nodes)
    crowded = np.flatnonzero(shared.counts > 2)
    if len(crowded):
        first = shared.first[crowded[0]]
        corners = shared.corners[first : first + shared.counts[crowded[0]]]
        raise MeshError(
            f"the edge {brief_row(ends[corners[0]])} belongs to {len(corners)} cells: "
            f"{', '.join(map(str, cells[corners[:6]]))}. At most two cells can share an edge; remove or correct the "
            "others."
        )
    first = shared.first[shared.counts == 2]
    one, other = shared.corners[first], shared.corners[first + 1]
    bad = np.flatnonzero(ends[one, 0] == ends[other, 0])
    if len(bad):
        raise MeshError(
            f"cells {cells[one[bad[0]]]} and {cells[other[bad[0]]]} overlap: both lie on the same side of their edge "
            f"{brief_row(ends[one[bad[0]]])}. Remove or correct one of them."
        )
    return shared.alone


def _sentence(misfit: Misfit, ends: Ints, cells: Ints) -> str:
    """A misfit of edges of the given cells in words."""
    edge, cell, node = brief_row(ends[misfit.edge]), cells[misfit.edge], misfit.node
    if misfit.kind == "crossing":
        (i, one), (j, other) = sorted((int(cells[k]), brief_row(ends[k])) for k in (misfit.edge, misfit.other))
        return (
            f"cells {i} and {j} overlap: the edge {one} of the one crosses the edge {other} of the other. Correct the "
            "vertices of one of them."
        )
    if misfit.kind == "touching":
        a, b = ends[misfit.edge]
        return (
            f"node {node} lies on the edge {edge} of cell {cell} without being one of its vertices. A hanging node "
            f"must be a vertex of the cells on both sides: insert {node} between {a} and {b} in cell {cell}."
        )
    return (
        f"there is a gap of {misfit.distance:.3g} between node {node} and the edge {edge} of cell {cell}, less than "
        f"{NARROW:g} of the edges there. Move the node onto the edge and make it a vertex of that cell, or open the "
        "gap."
    )
