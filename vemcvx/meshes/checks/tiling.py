"""Do the cells fit together without overlaps, gaps and one-sided hanging nodes? Checks of a user's mesh as a whole.

Let every cell be a simple counter-clockwise polygon, and every edge be used at most once in each direction. How
often a point is covered is then the winding number about it of the boundary (the edges used once). So the cells
tile a domain if and only if no two boundary edges meet but in common nodes, and the winding number just inside
each boundary edge is 1: no pair of inner edges needs a look.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.fitting import NARROW, Misfit, misfit_of, shortest_edges
from vemcvx.meshes.polygons.search import close_pairs
from vemcvx.meshes.polygons.segments import TOLERANCE, rounding
from vemcvx.meshes.polygons.topology import cell_of_corner, directed_edges, shared_edges


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
