"""Do the cells fit together without overlaps, gaps and one-sided hanging nodes? Checks of a user's mesh as a whole.

Let every cell be a simple counter-clockwise polygon, and every edge be used at most once in each direction. How
often a point is covered is then the winding number about it of the boundary (the edges used once). So the cells
tile a domain if and only if no two boundary edges meet but in common nodes, and the winding number just inside
each boundary edge is 1: no pair of inner edges needs a look.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.polygons.search import close_pairs
from vemcvx.meshes.polygons.segments import TOLERANCE, beside, cross, crossing, overlapping_boxes, rounding
from vemcvx.meshes.polygons.topology import cell_of_corner, directed_edges, shared_edges

# A slit below this part of the edges beside it is a mistake (single precision, printed digits), not a geometry.
NARROW = 1e-6


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
        raise MeshError(
            f"nodes {a} and {b} are in the same place, ({points[a, 0]:.9g}, {points[a, 1]:.9g}). Give them one number, "
            "so that the cells around them are joined; or, if two bodies meet there, make a mesh (a file) of each and "
            "put them together with vx.meshes.bodies, which keeps the nodes of each and names the interface."
        )


def check_tiling(points: Floats, offsets: Ints, vertices: Ints) -> None:
    """Raise MeshError if the counter-clockwise cells overlap, or leave slits or one-sided hanging nodes."""
    ends = directed_edges(offsets, vertices)
    cells = cell_of_corner(offsets)
    boundary = _check_sharing(offsets, vertices, ends, cells, len(points))
    if not len(boundary):
        raise MeshError("the cells have no boundary: they overlap.")
    shortest = np.full(len(points), np.inf)
    lengths = np.hypot(*(points[ends[:, 1]] - points[ends[:, 0]]).T)
    np.minimum.at(shortest, ends.ravel(), np.repeat(lengths, 2))
    ends, cells, lengths = ends[boundary], cells[boundary], lengths[boundary]
    _check_contacts(points, ends, cells, lengths, shortest)
    _check_winding(points, ends, cells)


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


def _check_contacts(points: Floats, ends: Ints, cells: Ints, lengths: Floats, shortest: Floats) -> None:
    """Boundary edges must not cross, nor a boundary node lie on or hardly beside another boundary edge."""
    corners = points[ends]
    margin = NARROW * lengths[:, None] + TOLERANCE * np.abs(corners).max(axis=(1, 2))[:, None]
    low, high = corners.min(axis=1) - margin, corners.max(axis=1) + margin
    one, other = overlapping_boxes(low, high, low, high)
    different = one != other
    one, other = one[different], other[different]
    bad = np.flatnonzero(crossing(points, ends[one], ends[other]))
    if len(bad):
        i, j = sorted((one[bad[0]], other[bad[0]]), key=lambda edge: cells[edge])
        raise MeshError(
            f"cells {cells[i]} and {cells[j]} overlap: the edge {_edge(ends[i])} of the one crosses the edge "
            f"{_edge(ends[j])} of the other. Correct the vertices of one of them."
        )
    # Boundary nodes start as many boundary edges as they end: looking at the starts is enough.
    node, edge = ends[other, 0], ends[one]
    apart = np.flatnonzero((edge != node[:, None]).all(axis=1))
    node, edge, cell, length = node[apart], edge[apart], cells[one[apart]], lengths[one[apart]]
    distance, side = beside(points[node], points[edge[:, 0]], points[edge[:, 1]])
    bad = np.flatnonzero(distance <= rounding(points[node], points[edge[:, 0]], points[edge[:, 1]]))
    if len(bad):
        k = bad[0]
        a, b = edge[k]
        raise MeshError(
            f"node {node[k]} lies on the edge ({a}, {b}) of cell {cell[k]} without being one of its vertices. A "
            f"hanging node must be a vertex of the cells on both sides: insert {node[k]} between {a} and {b} in cell "
            f"{cell[k]}."
        )
    narrow = (side < 0.0) & (distance <= NARROW * np.minimum(shortest[node], length))
    bad = np.flatnonzero(narrow)
    if len(bad):
        k = bad[0]
        raise MeshError(
            f"there is a gap of {distance[k]:.3g} between node {node[k]} and the edge {_edge(edge[k])} of cell "
            f"{cell[k]}, less than {NARROW:g} of the edges there. Move the node onto the edge and make it a vertex "
            "of that cell, or open the gap."
        )


def _check_winding(points: Floats, ends: Ints, cells: Ints) -> None:
    """The boundary must wind once about the inside of each of its edges; edges do not meet but in nodes."""
    probes = _one_edge_a_chain(ends)
    vector = points[ends[:, 1]] - points[ends[:, 0]]
    steep = np.abs(vector[probes, 1]) >= np.abs(vector[probes, 0])
    quarter_turned = points[:, ::-1] * [1.0, -1.0]
    for chosen, plane in ((probes[steep], points), (probes[~steep], quarter_turned)):
        if not len(chosen):
            continue
        bad = np.flatnonzero(_winding_inside(plane, ends, chosen) != 1)
        if len(bad):
            cell, edge = cells[chosen[bad[0]]], ends[chosen[bad[0]]]
            raise MeshError(
                f"cell {cell} overlaps another cell: beside its edge {_edge(edge)} the plane is covered more than "
                "once. Remove or correct one of the cells."
            )


def _one_edge_a_chain(ends: Ints) -> Ints:
    """One boundary edge of each chain; chains end where a node starts more than one (two cells meet in a point)."""
    order = np.argsort(ends[:, 0], kind="stable")
    starts, counts = np.unique(ends[:, 0], return_counts=True)
    simple = counts[np.searchsorted(starts, ends[:, 1])] == 1
    follower = order[np.searchsorted(ends[order, 0], ends[simple, 1])]
    links = (np.ones(len(follower)), (np.flatnonzero(simple), follower))
    _, chain = connected_components(csr_array(links, shape=(len(ends), len(ends))), directed=False)
    return np.unique(chain, return_index=True)[1]


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


def _edge(edge: Ints) -> str:
    return f"({edge[0]}, {edge[1]})"
