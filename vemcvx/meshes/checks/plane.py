"""A mesh of the plane checked: from what a user hands in to arrays of cells that tile a domain, or to a MeshError."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.arrays import Bools, Floats, Ints, plain
from vemcvx.errors import MeshError
from vemcvx.meshes.box import LARGEST
from vemcvx.meshes.interfaces import Interface, check_interfaces, pairs_of, places_of
from vemcvx.meshes.polygons.geometry import (
    TOLERANCE,
    areas_and_centroids,
    beside,
    close_pairs,
    cross,
    crossing,
    diameters,
    overlapping_boxes,
    rounding,
)
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    directed_edges,
    next_vertex,
    previous_corner,
    shared_edges,
    smallest_linked,
    turned,
)

# Do the edges of a boundary fit together? They may meet in common nodes only, and wind once about what they bound.


# A slit below this part of the edges beside it is a mistake (single precision, printed digits), not a geometry.
NARROW = 1e-6
# Between bodies, which may have been drawn apart by programs of six digits or less, one below this part.
NARROW_BETWEEN_BODIES = 1e-3


@dataclass(frozen=True)
class Misfit:
    """A place where edges do not fit together.

    Attributes
    ----------
    kind : {"crossing", "touching", "gap", "covered"}
        Edges cross; a node lies on an edge; it lies hardly beside one; the plane beside an edge is covered twice.
    edge, other : int
        Numbers of the edges: the other one crosses the edge, or starts from the node; of "covered" both are the edge.
    distance : float
        Width of a gap.
    """

    kind: str
    edge: int
    other: int
    distance: float = 0.0


def misfit_of(points: Floats, ends: Ints, shortest: Floats, bodies: Ints | None = None) -> Misfit | None:
    """Find the first place where the edges of a boundary do not fit together.

    Parameters
    ----------
    points : (n_nodes, 2) array
    ends : (m, 2) array of int
        The edges, what they bound on their left.
    shortest : (n_nodes,) array
        The shortest edge at each node.
    bodies : (m,) array of int, optional
        The body of each edge.
    """
    return _intersection(points, ends, shortest, bodies) or _covered(points, ends)


def shortest_edges(points: Floats, ends: Ints) -> Floats:
    """The shortest of the edges (m, 2) at each node, (n_nodes,)."""
    shortest = np.full(len(points), np.inf)
    np.minimum.at(shortest, ends.ravel(), np.repeat(_lengths(points, ends), 2))
    return shortest


def _lengths(points: Floats, ends: Ints) -> Floats:
    lengths: Floats = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    return lengths


def _intersection(points: Floats, ends: Ints, shortest: Floats, bodies: Ints | None) -> Misfit | None:
    """Edges must not cross, nor a node lie on or hardly beside another edge."""
    corners, lengths = points[ends], _lengths(points, ends)
    widest = NARROW if bodies is None else NARROW_BETWEEN_BODIES
    margin = widest * lengths[:, None] + TOLERANCE * np.abs(corners).max(axis=(1, 2))[:, None]
    low, high = corners.min(axis=1) - margin, corners.max(axis=1) + margin
    one, other = overlapping_boxes(low, high, low, high)
    different = one != other
    one, other = one[different], other[different]
    bad = np.flatnonzero(crossing(points, ends[one], ends[other]))
    if len(bad):
        return Misfit("crossing", int(one[bad[0]]), int(other[bad[0]]))
    # Boundary nodes start as many boundary edges as they end: looking at the starts is enough.
    apart = np.flatnonzero((ends[one] != ends[other, :1]).all(axis=1))
    one, other = one[apart], other[apart]
    node, start, end = ends[other, 0], points[ends[one, 0]], points[ends[one, 1]]
    distance, side = beside(points[node], start, end)
    bad = np.flatnonzero(distance <= rounding(points[node], start, end))
    if len(bad):
        return Misfit("touching", int(one[bad[0]]), int(other[bad[0]]))
    narrow = NARROW if bodies is None else np.where(bodies[one] == bodies[other], NARROW, NARROW_BETWEEN_BODIES)
    bad = np.flatnonzero((side < 0.0) & (distance <= narrow * np.minimum(shortest[node], lengths[one])))
    return Misfit("gap", int(one[bad[0]]), int(other[bad[0]]), float(distance[bad[0]])) if len(bad) else None


def _covered(points: Floats, ends: Ints) -> Misfit | None:
    """The boundary must wind once about the inside of each of its edges; edges do not meet but in nodes."""
    probes = _one_edge_a_chain(ends)
    vector = points[ends[:, 1]] - points[ends[:, 0]]
    steep = np.abs(vector[probes, 1]) >= np.abs(vector[probes, 0])
    quarter_turned = points[:, ::-1] * [1.0, -1.0]
    for chosen, plane in ((probes[steep], points), (probes[~steep], quarter_turned)):
        bad = chosen[_winding_inside(plane, ends, chosen) != 1] if len(chosen) else chosen
        if len(bad):
            return Misfit("covered", int(bad[0]), int(bad[0]))
    return None


def _one_edge_a_chain(ends: Ints) -> Ints:
    """One boundary edge of each chain; chains end where a node starts more than one (two cells meet in a point)."""
    order = np.argsort(ends[:, 0], kind="stable")
    starts, counts = np.unique(ends[:, 0], return_counts=True)
    simple = counts[np.searchsorted(starts, ends[:, 1])] == 1
    follower = order[np.searchsorted(ends[order, 0], ends[simple, 1])]
    return np.unique(smallest_linked(np.column_stack([np.flatnonzero(simple), follower]), len(ends)))


def _winding_inside(points: Floats, ends: Ints, probes: Ints) -> Ints:
    """Winding number of all edges just left of the middle of the probing ones, by rays along +x."""
    start, end = points[ends[:, 0]], points[ends[:, 1]]
    middle = 0.5 * (start[probes] + end[probes])
    far = np.column_stack([np.full(len(probes), np.inf), middle[:, 1]])
    probe, edge = overlapping_boxes(middle, far, np.minimum(start, end), np.maximum(start, end))
    y, low, high = middle[probe, 1], start[edge, 1], end[edge, 1]
    upward, downward = (low <= y) & (y < high), (high <= y) & (y < low)
    left = cross(end[edge] - start[edge], middle[probe] - start[edge])
    own = edge == probes[probe]  # left of an upward edge the ray crosses it, left of a downward one it does not
    step = np.where(upward & ((left > 0.0) | own), 1, 0) - np.where(downward & (left < 0.0) & ~own, 1, 0)
    return np.bincount(probe, weights=step, minlength=len(probes)).round().astype(np.int64)


# Is every cell by itself a simple polygon with an area? Checks of a user's mesh, one cell at a time.
#
# A convex cell is told by its turns: none to the right, and once around in all. Only the others have their edges
# compared pair by pair.


PAIRS_AT_ONCE = 500_000  # about 100 MB of temporaries


@dataclass(frozen=True)
class Fault:
    """Why a polygon is none.

    Attributes
    ----------
    kind : {"crossing", "flat", "spike", "touching"}
        Two edges cross; there is no area; the outline turns back on itself; a vertex lies on an edge.
    cell : int
        Number of the polygon.
    edge, other : sequence of int
        Nodes of the edge, and of the one that crosses it.
    node : int
        The node at the tip of the spike, or on the edge.
    beside : int
        Of a spike: the node on the edge.
    """

    kind: str
    cell: int
    edge: Sequence[int] = ()
    other: Sequence[int] = ()
    node: int = -1
    beside: int = -1


def check_cells(points: Floats, offsets: Ints, vertices: Ints) -> Floats:
    """Signed areas (n_cells,), or MeshError at the first cell that is not a simple polygon with an area."""
    areas, fault = fault_of(points, offsets, vertices)
    if fault is None:
        return areas
    cell = fault.cell
    if fault.kind == "flat":
        size = diameters(points, offsets[cell : cell + 2] - offsets[cell], vertices[offsets[cell] :])[0]
        raise MeshError(
            f"cell {cell} has no area: its vertices {brief_row(vertices[offsets[cell] : offsets[cell + 1]])} lie on "
            f"one line (area {areas[cell]:.3g}, diameter {size:.3g}). Remove it or correct its vertices."
        )
    edge, other = brief_row(fault.edge), brief_row(fault.other)
    if fault.kind == "crossing":
        raise MeshError(
            f"cell {cell} crosses itself: its edges {edge} and {other} intersect. List its vertices in order around it."
        )
    if fault.kind == "spike":
        raise MeshError(
            f"cell {cell} has a spike: at node {fault.node} its outline turns back on itself (node {fault.beside} lies "
            f"on the edge {edge}). Remove the node at the tip from the cell."
        )
    raise MeshError(
        f"cell {cell} touches itself: its node {fault.node} lies on its edge {edge}. Split the cell there, or move the "
        "node."
    )


def fault_of(points: Floats, offsets: Ints, vertices: Ints) -> tuple[Floats, Fault | None]:
    """Signed areas (n_cells,), and what is wrong with the first cell that is not a simple polygon with an area."""
    areas = areas_and_centroids(points, offsets, vertices)[0]
    sizes = diameters(points, offsets, vertices)
    largest = np.maximum.reduceat(np.abs(points[vertices]).max(axis=1), offsets[:-1])
    thin = np.abs(areas) <= TOLERANCE * largest * sizes
    suspects = np.flatnonzero(thin | ~_convex(points, offsets, vertices, areas))
    ends = directed_edges(offsets, vertices)
    cells, first, second = _near_pairs(points, ends, offsets, suspects)
    fault = _crossing(points, cells, first, second)
    if fault is None and thin.any():
        fault = Fault("flat", int(np.flatnonzero(thin)[0]))
    return areas, fault or _touching(points, cells, first, second)


def _convex(points: Floats, offsets: Ints, vertices: Ints, areas: Floats) -> Bools:
    """Cells that turn one way only and once around, with no turn back by (nearly) half a circle."""
    edge = points[next_vertex(offsets, vertices)] - points[vertices]
    before = edge[previous_corner(offsets)]
    turn = np.arctan2(cross(before, edge), np.einsum("ij,ij->i", before, edge))
    turn *= np.repeat(np.sign(areas), np.diff(offsets))
    # A straight angle may turn back by rounding; 1e-9 keeps such cells here, and cannot hide a crossing: the turns
    # of a cell that winds twice add up to two full circles.
    one_way = np.minimum.reduceat(turn, offsets[:-1]) > -1e-9
    no_spike = np.maximum.reduceat(turn, offsets[:-1]) < np.pi - 1e-6
    once = np.abs(np.add.reduceat(turn, offsets[:-1]) - 2.0 * np.pi) < 1e-3
    return one_way & no_spike & once


def _pairs_of_edges(offsets: Ints, cells: Ints) -> Iterator[tuple[Ints, Ints, Ints]]:
    """Cell and two corners (edges start there) for every pair of edges of the given cells, in portions."""
    counts = np.diff(offsets)[cells]
    for count in np.unique(counts):
        here = cells[counts == count]
        for start in range(0, count * (count - 1) // 2, PAIRS_AT_ONCE):
            one, other = _pairs_of(count, start, min(start + PAIRS_AT_ONCE, count * (count - 1) // 2))
            portion = max(1, PAIRS_AT_ONCE // len(one))
            for begin in range(0, len(here), portion):
                some = here[begin : begin + portion]
                corner = offsets[some][:, None]
                yield np.repeat(some, len(one)), (corner + one).ravel(), (corner + other).ravel()


def _pairs_of(count: int, start: int, stop: int) -> tuple[Ints, Ints]:
    """Pairs (i, j), i < j < count, number start to stop, ordered by j and then i."""
    number = np.arange(start, stop)
    j = np.floor(0.5 + np.sqrt(2.0 * number + 0.25)).astype(np.int64)
    j += (j + 1) * j // 2 <= number
    j -= j * (j - 1) // 2 > number
    return number - j * (j - 1) // 2, j


def _near_pairs(points: Floats, ends: Ints, offsets: Ints, cells: Ints) -> tuple[Ints, Ints, Ints]:
    """Cell and two edges (m, 2), as node numbers, for the pairs of edges of a cell whose boxes meet up to rounding."""
    start, end = points[ends[:, 0]], points[ends[:, 1]]
    slack = rounding(start, end)[:, None]
    left, bottom = (np.minimum(start, end) - slack).T.copy()
    right, top = (np.maximum(start, end) + slack).T.copy()
    found = [(np.empty(0, dtype=np.int64),) * 3]
    for cell, i, j in _pairs_of_edges(offsets, cells):
        beside_x = (left[i] <= right[j]) & (left[j] <= right[i])
        near = np.flatnonzero(beside_x & (bottom[i] <= top[j]) & (bottom[j] <= top[i]))
        found.append((cell[near], i[near], j[near]))
    cell, i, j = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return cell, ends[i], ends[j]


def _crossing(points: Floats, cells: Ints, first: Ints, second: Ints) -> Fault | None:
    bad = np.flatnonzero(crossing(points, first, second))
    return Fault("crossing", int(cells[bad[0]]), first[bad[0]], second[bad[0]]) if len(bad) else None


def _touching(points: Floats, cells: Ints, first: Ints, second: Ints) -> Fault | None:
    edge = np.concatenate([first, first, second, second])
    other = np.concatenate([second, second, first, first])
    node = np.concatenate([second[:, 0], second[:, 1], first[:, 0], first[:, 1]])
    apart = np.flatnonzero((edge[:, 0] != node) & (edge[:, 1] != node))
    edge, other, node, cells = edge[apart], other[apart], node[apart], np.tile(cells, 4)[apart]
    at, start, end = points[node], points[edge[:, 0]], points[edge[:, 1]]
    bad = np.flatnonzero(beside(at, start, end)[0] <= rounding(at, start, end))
    if not len(bad):
        return None
    tips = (edge[bad, :, None] == other[bad, None]).any(axis=2)  # which end of the edge the other edge starts from
    k = bad[np.argmax(tips.any(axis=1))]  # a spike also makes edges farther on touch: name the spike
    if tips.any():
        tip = edge[k][np.isin(edge[k], other[k])][0]
        return Fault("spike", int(cells[k]), edge[k], node=int(tip), beside=int(node[k]))
    return Fault("touching", int(cells[k]), edge[k], node=int(node[k]))


def brief_row(nodes: Sequence[int] | Ints) -> str:
    """Node numbers in brackets, long lists cut."""
    shown = ", ".join(map(str, nodes[:6]))
    return f"({shown}{', ...' if len(nodes) > 6 else ''})"


# Do the cells fit together without overlaps, gaps and one-sided hanging nodes? Checks of a user's mesh as a whole.
#
# Let every cell be a simple counter-clockwise polygon, and every edge be used at most once in each direction. How
# often a point is covered is then the winding number about it of the boundary (the edges used once). So the cells
# tile a domain if and only if no two boundary edges meet but in common nodes, and the winding number just inside
# each boundary edge is 1: no pair of inner edges needs a look.


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


def check_tiling(points: Floats, offsets: Ints, vertices: Ints) -> None:
    """Raise MeshError if the counter-clockwise cells overlap, or leave slits or one-sided hanging nodes."""
    ends = directed_edges(offsets, vertices)
    cells = cell_of_corner(offsets)
    boundary = _check_sharing(offsets, vertices, ends, cells, len(points))
    if not len(boundary):
        raise MeshError("the cells have no boundary: they overlap.")
    misfit = misfit_of(points, ends[boundary], shortest_edges(points, ends))
    if misfit:
        raise MeshError(_sentence(misfit, ends[boundary], cells[boundary]))


def _check_sharing(offsets: Ints, vertices: Ints, ends: Ints, cells: Ints, n_nodes: int) -> Ints:
    """Corners on the boundary; MeshError if an edge belongs to three cells, or to two on the same side."""
    shared = shared_edges(offsets, vertices, n_nodes)
    crowded = np.flatnonzero(shared.counts > 2)
    if len(crowded):
        first = shared.first[crowded[0]]
        corners = shared.corners[first : first + shared.counts[crowded[0]]]
        a, b = ends[corners[0]]
        raise MeshError(
            f"the edge ({a}, {b}) belongs to {len(corners)} cells: {', '.join(map(str, cells[corners[:6]]))}. At most "
            "two cells can share an edge; remove or correct the others."
        )
    first = shared.first[shared.counts == 2]
    one, other = shared.corners[first], shared.corners[first + 1]
    bad = np.flatnonzero(ends[one, 0] == ends[other, 0])
    if len(bad):
        a, b = ends[one[bad[0]]]
        raise MeshError(
            f"cells {cells[one[bad[0]]]} and {cells[other[bad[0]]]} overlap: both lie on the same side of their edge "
            f"({a}, {b}). Remove or correct one of them."
        )
    return np.sort(shared.corners[shared.first[shared.counts == 1]])


def _sentence(misfit: Misfit, ends: Ints, cells: Ints) -> str:
    """A misfit of edges of the given cells in words."""
    edge, cell, node = _edge(ends[misfit.edge]), cells[misfit.edge], ends[misfit.other, 0]
    if misfit.kind == "crossing":
        (i, one), (j, other) = sorted((int(cells[k]), _edge(ends[k])) for k in (misfit.edge, misfit.other))
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
    if misfit.kind == "gap":
        return (
            f"there is a gap of {misfit.distance:.3g} between node {node} and the edge {edge} of cell {cell}, less "
            f"than {NARROW:g} of the edges there. Move the node onto the edge and make it a vertex of that cell, or "
            "open the gap."
        )
    return (
        f"cell {cell} overlaps another cell: beside its edge {edge} the plane is covered more than once. Remove or "
        "correct one of the cells."
    )


def _edge(edge: Ints) -> str:
    return f"({edge[0]}, {edge[1]})"


# From what a user hands in to the arrays of a valid mesh, or to a MeshError that names the fault.
#
# Mended, with a note for a warning: clockwise cells (turned) and nodes that no cell uses (dropped). The order of the
# checks is that in which faults can be told: numbers, places of nodes, single cells, how cells fit together.


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
