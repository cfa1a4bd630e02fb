"""A mesh of the plane checked: from what a user hands in to arrays of cells that tile a domain, or to a MeshError.

Faults are told in the order in which they can be: numbers, places of nodes, single cells, how cells fit together.
Clockwise cells are turned and nodes that no cell uses dropped, each with a note for a warning. Shapely decides whether
a polygon is simple, and whether polygons are a coverage: none overlap, and where two meet they have the same vertices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import SINGLE, Floats, Ints, plain
from vemcvx.base.errors import MeshError
from vemcvx.meshes.box import LARGEST
from vemcvx.meshes.interfaces import Interface, check_interfaces, pairs_of, places_of
from vemcvx.meshes.polygons import (
    TOLERANCE,
    areas_and_centroids,
    cell_of_corner,
    close_pairs,
    cross,
    diameters,
    directed_edges,
    offsets_of,
    outlines,
    rounding,
    shared_edges,
    turned,
)


class Checked(NamedTuple):
    """Valid arrays made of a user's points and cells."""

    arrays: tuple[NDArray[Any], ...]  # as the class of the mesh names them
    interfaces: dict[str, Interface]  # as given
    node_map: Ints | None
    notes: list[str]  # on what was mended


def checked(points: ArrayLike, cells: Any, interfaces: Mapping[str, Interface] | None) -> Checked:
    """Points, offsets and vertices of a `PolygonMesh`, or MeshError; only at interfaces nodes may be in one place."""
    points = check_points(points)
    offsets, vertices = _flattened(cells)
    if len(offsets) < 2:
        raise MeshError("a mesh needs at least one cell; got none.")
    check_polygons(offsets, vertices, len(points), lambda cell: f"cell {cell}")
    interfaces = check_interfaces(interfaces, len(points))
    place = places_of(pairs_of(interfaces), points)
    check_coincident(points, np.unique(place[vertices]))
    polygons = outlines(points[place], offsets, vertices)
    areas = check_cells(points[place], offsets, vertices, polygons)
    notes, backwards = [], areas < 0.0
    if backwards.any():
        vertices = turned(offsets, vertices, backwards)
        notes.append(
            f"{backwards.sum()} of {len(backwards)} cells were listed clockwise (the first is cell "
            f"{np.flatnonzero(backwards)[0]}) and have been turned."
        )
    boundary = _check_sharing(offsets, place[vertices], len(points))
    ends, cells_of_ends = directed_edges(offsets, place[vertices])[boundary], cell_of_corner(offsets)[boundary]
    # Narrower slits are mistakes, not a geometry.
    width = SINGLE * lowest(np.abs(areas), diameters(points, offsets, vertices))
    misfit = misfit_of(points, ends, cells_of_ends, polygons, width=width)
    if misfit:
        _check_hanging(points, ends, cells_of_ends)
        (one, other), at = sorted(misfit.cells), f"({misfit.at[0]:.6g}, {misfit.at[1]:.6g})"
        if misfit.overlap:
            raise MeshError(
                f"cells {one} and {other} overlap near {at}. Remove or correct the vertices of one of them."
            )
        raise MeshError(
            f"there is a gap narrower than {width:.3g} between cells {one} and {other} near {at}, {SINGLE:g} of the "
            "lowest cell. Give both the same nodes there, or open the gap."
        )
    points, vertices, node_map, more = dropped(points, vertices)
    return Checked((points, offsets, vertices), interfaces, node_map, notes + more)


def dropped(points: Floats, vertices: Ints) -> tuple[Floats, Ints, Ints | None, list[str]]:
    """Points and vertices without nodes that no cell uses, the new numbers of all (-1 if dropped), and a note."""
    used = np.unique(vertices)
    if len(used) == len(points):
        return points, vertices, None, []
    node_map = np.full(len(points), -1)
    node_map[used] = np.arange(len(used))
    note = (
        f"{len(points) - len(used)} of {len(points)} nodes belong to no cell (the first is node "
        f"{np.flatnonzero(node_map < 0)[0]}) and have been dropped; mesh.node_map gives the new numbers."
    )
    return points[used], node_map[vertices], node_map, [note]


def check_points(points: ArrayLike, dimension: int = 2) -> Floats:
    """Return a copy of the points as finite floats (n_nodes, dimension), or raise MeshError."""
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


def _flattened(cells: Any) -> tuple[Ints, Ints]:
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
    """Return offsets and entries of rows of whole numbers, or raise MeshError.

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
    if not kinds <= {list, tuple}:
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
            f"joined{bodies}."
        )


def check_cells(points: Floats, offsets: Ints, vertices: Ints, polygons: NDArray[Any]) -> Floats:
    """Return signed areas (n_cells,), or raise MeshError at the first cell that is no simple polygon with an area."""
    check_simple(points, offsets, vertices, polygons, lambda cell: f"cell {cell}")
    areas, sizes = areas_and_centroids(points, offsets, vertices)[0], diameters(points, offsets, vertices)
    largest = np.maximum.reduceat(np.abs(points[vertices]).max(axis=1), offsets[:-1])
    flat = np.flatnonzero(np.abs(areas) <= TOLERANCE * largest * sizes)
    if len(flat):
        cell = flat[0]
        raise MeshError(
            f"cell {cell} has no area: its vertices {brief_row(vertices[offsets[cell] : offsets[cell + 1]])} lie on "
            f"one line (area {areas[cell]:.3g}, diameter {sizes[cell]:.3g}). Remove it or correct its vertices."
        )
    return areas


def check_simple(
    points: Floats,
    offsets: Ints,
    vertices: Ints,
    polygons: NDArray[Any],
    named: Callable[[int], str],
    nodes: Ints | None = None,
) -> None:
    """Raise MeshError at the first polygon whose outline meets itself up to rounding; `nodes` are called so."""
    import shapely

    largest = np.maximum.reduceat(np.abs(points[vertices]).max(axis=1), offsets[:-1])
    # The distance by which a vertex can move before the outline meets itself.
    clearance = np.where(shapely.is_valid(polygons), np.inf, 0.0)
    several = np.diff(offsets) > 3
    clearance[several] = np.minimum(clearance[several], shapely.minimum_clearance(polygons[several]))
    for number in np.flatnonzero(clearance <= TOLERANCE * largest).tolist():
        row = vertices[offsets[number] : offsets[number + 1]]
        fault = _fault(points[row], (row if nodes is None else nodes[row]).tolist(), TOLERANCE * largest[number])
        if fault:
            raise MeshError(named(number) + fault)


def _fault(x: Floats, name: list[int], tolerance: float) -> str:
    """The place, in words, where an outline x (n, 2) with nodes of given names meets itself; "" if it is a line."""
    import shapely

    after = np.roll(np.arange(len(x)), -1)
    edges = shapely.linestrings(np.stack([x, x[after]], axis=1))

    def edge(k: int) -> str:
        return brief_row((name[k], name[after[k]]))

    one, other = shapely.STRtree(edges).query(edges, predicate="crosses")
    if len(one):
        return (
            f" crosses itself: its edges {edge(one[0])} and {edge(other[0])} intersect. List its vertices in order "
            "around it."
        )
    arms = x - x[0]
    if abs(cross(arms, arms[after]).sum()) <= tolerance * np.ptp(x, axis=0).max():
        return ""
    found = shapely.STRtree(shapely.points(x)).query(edges, predicate="dwithin", distance=tolerance)
    touching = [(k, node) for k, node in found.T.tolist() if node not in (k, after[k])]
    for k, node in touching:  # a spike also makes edges farther on touch: it comes first
        if k == after[node] or node == after[after[k]]:
            tip = k if k == after[node] else after[k]
            return (
                f" has a spike: at node {name[tip]} its outline turns back on itself (node {name[node]} lies on the "
                f"edge {edge(k)}). Remove the node at the tip from the cell."
            )
    k, node = touching[0]
    return f" touches itself: its node {name[node]} lies on its edge {edge(k)}. Split the cell there, or move the node."


def _check_sharing(offsets: Ints, vertices: Ints, n_nodes: int) -> Ints:
    """Corners on the boundary; MeshError if an edge belongs to three cells, or to two on the same side."""
    ends, cells = directed_edges(offsets, vertices), cell_of_corner(offsets)
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
    one, other = shared.twice
    bad = np.flatnonzero(ends[one, 0] == ends[other, 0])
    if len(bad):
        raise MeshError(
            f"cells {cells[one[bad[0]]]} and {cells[other[bad[0]]]} overlap: both lie on the same side of their edge "
            f"{brief_row(ends[one[bad[0]]])}. Remove or correct one of them."
        )
    if not len(shared.alone):
        raise MeshError("the cells have no boundary: they overlap.")
    return shared.alone


def lowest(areas: Floats, sizes: Floats) -> float:
    """The least area of a cell over its diameter: slits are narrow by its measure, however flat all cells are."""
    return float((areas / sizes).min())


class Misfit(NamedTuple):
    """Two cells that are no coverage."""

    cells: tuple[int, int]
    overlap: bool  # else they are apart by a distance that is not zero and below the width of slits
    at: Floats  # (2,) a point of the overlap or beside the slit
    distance: float


def misfit_of(
    points: Floats, ends: Ints, cells: Ints, polygons: NDArray[Any], *, width: float, body: Ints | None = None
) -> Misfit | None:
    """Return the first two cells, of different bodies if these are given, that overlap or leave a slit.

    How often counter-clockwise cells that fit along inner edges cover a point is the winding number about it of the
    boundary, whose edges (m, 2) of cells (m,) are `ends`. So none overlap if those on the boundary do not, and none
    holds the middle of an edge of another.
    """
    import shapely

    holding = shapely.STRtree(polygons).query(shapely.points(points[ends].mean(axis=1)), predicate="within")[1]
    outer = np.unique(np.append(cells, holding))
    edges = shapely.coverage_invalid_edges(polygons[outer], gap_width=width)
    bad = np.flatnonzero(~shapely.is_empty(edges))
    one, other = shapely.STRtree(polygons[outer]).query(polygons[outer[bad]], predicate="dwithin", distance=width)
    one = bad[one]
    pairs = one != other if body is None else body[outer[one]] != body[outer[other]]
    edges, one, other = (edges[one[pairs]], edges[other[pairs]]), outer[one[pairs]], outer[other[pairs]]
    common = shapely.intersection(polygons[one], polygons[other])
    over = np.flatnonzero(shapely.area(common) > 0.0)
    if len(over):
        k = over[0]
        at = shapely.get_coordinates(shapely.point_on_surface(common[k]))[0]
        return Misfit((int(one[k]), int(other[k])), True, at, 0.0)
    apart = shapely.distance(*edges)
    near = np.flatnonzero(apart <= width)
    if not len(near):
        return None
    k = near[np.argmax(apart[near])]  # cells of one side meet, those across the slit are apart
    at = shapely.get_coordinates(shapely.shortest_line(edges[0][k], edges[1][k]))[0]
    return Misfit((int(one[k]), int(other[k])), False, at, float(apart[k]))


def _check_hanging(points: Floats, ends: Ints, cells: Ints) -> None:
    """Raise MeshError where a node lies on an edge (m, 2) of the boundary of a cell (m,), but is no vertex of it."""
    import shapely

    nodes = np.unique(ends)
    edge, node = shapely.STRtree(shapely.points(points[nodes])).query(
        shapely.linestrings(points[ends]),
        predicate="dwithin",
        distance=TOLERANCE * np.abs(points[ends]).max(axis=(1, 2)),
    )
    inner = np.flatnonzero((ends[edge] != nodes[node][:, None]).all(axis=1))
    if len(inner):
        (a, b), node = ends[edge[inner[0]]], nodes[node[inner[0]]]
        cell = cells[edge[inner[0]]]
        raise MeshError(
            f"node {node} lies on the edge {brief_row((a, b))} of cell {cell} without being one of its vertices. A "
            f"hanging node must be a vertex of the cells on both sides: insert {node} between {a} and {b} in cell "
            f"{cell}."
        )
