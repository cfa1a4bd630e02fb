"""Local refinement of polygonal meshes: marked cells are split, and neighbours get hanging nodes.

A *bend* is a vertex at which the outline of a cell is not straight. A *corner* is a bend by more than `CORNER_ANGLE`.
If a cell has fewer than three corners by this rule, all bends are corners. A *side* is the outline between neighbouring
corners.

A side is *long* if the cell is a triangle, or if the side is at least `LONG_SIDE` cell diameters long. A long side is
split at a vertex near the midpoint of the side. If no vertex is near, the edge around the midpoint is halved. Short
sides stay whole. Splitting short sides would make Voronoi cells thinner in each refinement.

Split points are joined to the centre of the cell. In a triangle, the three split points are joined to each other. A
convex cell with two split points is cut between the two points. Further cells are split until unsplit cells get at most
one hanging node between neighbouring bends.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from vemcvx.base.arrays import SINGLE_EPS, Bools, Floats, Ints
from vemcvx.base.errors import MeshError
from vemcvx.base.outline import coordinates
from vemcvx.meshes.carrying import check_lengths, inherit_parts, middle_places
from vemcvx.meshes.interfaces import pairs_of, places_of
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import (
    cell_of_corner,
    cross,
    least_of_each,
    next_corner,
    next_vertex,
    offsets_of,
    previous_corner,
    right_of,
    rotation,
    rounding,
    rows_in_order,
    sort_edges,
)

CORNER_ANGLE = np.radians(20.0)
LONG_SIDE = 0.3
"""Least length of a long side, relative to the cell diameter. In a regular decagon, sides have the ratio 0.31."""


class Splitting(NamedTuple):
    """The split points of all cells."""

    sides: Ints  # (n_cells,) number of sides
    all_long: Bools  # (n_cells,) True if all sides are long
    convex: Bools  # (n_cells,)
    places: Ints  # (n_cells,) number of split points
    bend: Bools  # (m,) True if the vertex is a bend, for the m entries of `mesh.vertices`
    vertex: Bools  # (m,) True if the vertex is a split point
    edge: Bools  # (m,) True if the midpoint of the next edge is a split point


def splitting_of(mesh: PolygonMesh) -> Splitting:
    """Return the split points of all cells."""
    length, turn, bend = _outlines(mesh)
    corner = _choose_flags(np.abs(turn) > CORNER_ANGLE, bend, mesh.offsets)
    order = rotation(corner, mesh.offsets)  # each outline begins at a corner
    first = np.flatnonzero(corner[order])
    cell = cell_of_corner(mesh.offsets)[first]
    counts = np.bincount(cell, minlength=mesh.n_cells)
    long = (np.add.reduceat(length[order], first) / mesh.diameters[cell] >= LONG_SIDE) | (counts[cell] == 3)
    vertex, edge = np.zeros((2, len(length)), dtype=bool)
    at, between = _middles(length[order], first, long)
    vertex[order[at]] = edge[order[between]] = True
    return Splitting(
        sides=counts,
        all_long=np.logical_and.reduceat(long, offsets_of(counts)[:-1]),
        convex=np.minimum.reduceat(turn, mesh.offsets[:-1]) >= 0.0,
        places=np.add.reduceat(vertex + edge.astype(np.int64), mesh.offsets[:-1]),
        bend=bend,
        vertex=vertex,
        edge=edge,
    )


def _outlines(mesh: PolygonMesh) -> tuple[Floats, Floats, Bools]:
    """Return the lengths of edges, turning angles, and a mask of bends."""
    x = mesh.points[mesh.vertices]
    edge = mesh.points[next_vertex(mesh.offsets, mesh.vertices)] - x
    length = np.hypot(edge[:, 0], edge[:, 1])
    before = previous_corner(mesh.offsets)
    sine, cosine = cross(edge[before], edge), np.einsum("ij,ij->i", edge[before], edge)
    slack = SINGLE_EPS * length[before] * length + rounding(x) * (length[before] + length)
    bend = _choose_flags((np.abs(sine) > slack) | (cosine <= 0.0), np.ones(len(x), dtype=bool), mesh.offsets)
    return length, np.where(bend, np.arctan2(sine, cosine), 0.0), bend


def _choose_flags(flags: Bools, otherwise: Bools, offsets: Ints) -> Bools:
    few = np.add.reduceat(flags.astype(np.int64), offsets[:-1]) < 3
    return np.where(np.repeat(few, np.diff(offsets)), otherwise, flags)


def _middles(length: Floats, first: Ints, long: Bools) -> tuple[Ints, Ints]:
    """Return the vertices and edges at which long sides are split."""
    side = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(length))))
    share = length / np.add.reduceat(length, first)[side]
    end = np.cumsum(share)
    begin = end - share
    base = begin[first][side]
    begin, end = begin - base, end - base
    inner = long[side]
    inner[first] = False
    away = np.where(inner, np.abs(begin - 0.5), np.inf)
    nearest = least_of_each(side, away)
    # A vertex within 0.2 side lengths of the midpoint is a split point.
    taken = away[nearest] <= 0.2
    between = long[side] & ~taken[side] & (begin < 0.5) & (end >= 0.5)
    return nearest[taken], np.flatnonzero(between)


def centres_of(mesh: PolygonMesh, splitting: Splitting, marked: Bools) -> Floats:
    """Return the centres (n_cells, 2) of cells; raise MeshError if a marked cell is not star-shaped.

    cell                            centre
    convex, four bends, long sides  the mean of the four bends
    not convex, bends x_0 ... x_3   (x_1 + x_3) / 2 if the outline turns right at x_1
    other convex cells              the centroid
    other cells                     the centroid if it is at least 0.1 diameters to the left of all edges, else the
                                    centre of the largest disc to the left of all edges
    """
    centres = mesh.centroids.copy()
    bends = np.flatnonzero(splitting.bend)
    counts = np.add.reduceat(splitting.bend.astype(np.int64), mesh.offsets[:-1])
    offsets = offsets_of(counts)
    four_long = splitting.all_long & (splitting.sides == 4)
    quads = np.flatnonzero((counts == 4) & (four_long | ~splitting.convex))
    centres[quads] = _middles_of_quads(mesh.points[mesh.vertices[bends[offsets[quads, None] + np.arange(4)]]])
    outward = right_of(mesh.points[next_vertex(mesh.offsets, mesh.vertices)] - mesh.points[mesh.vertices])
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    owner = cell_of_corner(mesh.offsets)
    arms = mesh.points[mesh.vertices] - mesh.centroids[owner]
    away = np.einsum("ki,ki->k", outward, arms) / mesh.diameters[owner]
    inside = np.minimum.reduceat(away, mesh.offsets[:-1])
    others = np.flatnonzero(marked & ~splitting.convex & (counts != 4) & (inside < 0.1))
    if len(others):
        rows, sides = rows_in_order(mesh.offsets, np.arange(len(mesh.vertices)), others)
        shift, clear = largest_balls(rows, outward[sides], away[sides])
        if clear.min() <= SINGLE_EPS:
            k = others[np.argmin(clear)]
            raise MeshError(
                f"refine: cell {k} near {coordinates(mesh.centroids[k], 6)} is not star-shaped, so its parts cannot "
                "meet in one point. Split it in the program that made it."
            )
        centres[others] += shift * mesh.diameters[others, None]
    return centres


def largest_balls(offsets: Ints, normals: Floats, away: Floats) -> tuple[Floats, Floats]:
    """Return centres x and largest radii r with n . x + r <= away for all normals n."""
    from scipy.optimize import linprog

    count = len(offsets) - 1
    rows = np.column_stack([normals, np.ones(len(normals))])
    columns = cell_of_corner(offsets)[:, None] * 3 + np.arange(3)
    matrix: Any = csr_array((rows.ravel(), columns.ravel(), 3 * np.arange(len(rows) + 1)), shape=(len(rows), 3 * count))
    solved: Any = linprog(np.tile([0.0, 0.0, -1.0], count), A_ub=matrix, b_ub=away, bounds=(None, None))
    found = solved.x.reshape(-1, 3)
    return found[:, :2], found[:, 2]


def _middles_of_quads(x: Floats) -> Floats:
    """Return the centres (q, 2) of quadrilaterals."""
    even, odd = x[:, 0] + x[:, 2], x[:, 1] + x[:, 3]
    before, after = x - np.roll(x, 1, axis=1), np.roll(x, -1, axis=1) - x
    turn = cross(before, after)
    tip = np.argmin(turn, axis=1)
    arrow = turn.min(axis=1) < 0.0
    diagonal = np.where((tip % 2 == 0)[:, None], even, odd)
    return np.where(arrow[:, None], 0.5 * diagonal, 0.25 * (even + odd))


def _children(
    outlines: tuple[Ints, Ints], begin: Bools, split: Bools, medial: Bools, centre: Ints
) -> tuple[Ints, Ints, Ints]:
    """Return the offsets, vertices and parents of the new cells."""
    nodes, owner = outlines[1], cell_of_corner(outlines[0])
    start = np.flatnonzero(begin)
    cell, stop = owner[start], np.append(start[1:], len(nodes))
    after, inner = nodes[start[next_corner(offsets_of(np.bincount(cell)))]], centre[cell] >= 0
    ends = np.append(stop[split[cell]], stop[inner])
    vertices = np.insert(nodes, ends, np.append(after[split[cell]], centre[cell[inner]]))
    middles = start[medial[cell]]
    counts = np.append(stop - start + split[cell] + inner, np.full(len(middles) // 3, 3))
    parents = np.append(cell, owner[middles[::3]])
    order = np.argsort(parents, kind="stable")
    return *rows_in_order(offsets_of(counts), np.append(vertices, nodes[middles]), order), parents[order]


def refine_polygons(mesh: PolygonMesh, marked: Bools) -> PolygonMesh:
    """Split marked cells, and further cells as in `mark_crowded`."""
    splitting, shared, edge = splitting_of(mesh), mesh.shared_edges, mesh.shared_edges.number
    places = places_of(pairs_of(mesh.interfaces), mesh.points)
    if mesh.interfaces:  # coinciding edges of two bodies are split together
        edge = sort_edges(mesh.offsets, places[mesh.vertices], mesh.n_nodes).number
    marked = mark_crowded(marked, mesh, splitting, edge)
    centres, cell = centres_of(mesh, splitting, marked), cell_of_corner(mesh.offsets)
    single = np.flatnonzero(marked & (splitting.places < 2))
    if len(single):
        raise MeshError(f"refine: cell {single[0]} has no two sides that are long enough to be split. Remesh there.")
    split = np.zeros(len(shared.first), dtype=bool)
    split[shared.number[_split(marked, splitting, mesh, edge)]] = True
    ends = shared.ends[split]
    check_lengths(mesh.points, ends)
    middle = np.full(len(split), -1)
    middle[split] = mesh.n_nodes + np.arange(len(ends))
    middle = middle[shared.number]
    medial = marked & (splitting.sides == 3) & splitting.convex
    centred = np.flatnonzero(marked & ~medial & ~((splitting.places == 2) & splitting.convex))
    centre = np.full(mesh.n_cells, -1)
    centre[centred] = mesh.n_nodes + len(ends) + np.arange(len(centred))
    # Insert the midpoints, and let each outline begin at a split point.
    after = np.flatnonzero(middle >= 0) + 1
    nodes = np.insert(mesh.vertices, after, middle[after - 1])
    begin = np.insert(splitting.vertex & marked[cell], after, (splitting.edge & marked[cell])[after - 1])
    offsets = offsets_of(np.diff(mesh.offsets) + np.bincount(cell[after - 1], minlength=mesh.n_cells))
    order = rotation(begin, offsets)
    begin = begin[order]
    begin[offsets[:-1]] = True
    offsets, vertices, parents = _children((offsets, nodes[order]), begin, marked, medial, centre)
    points = np.concatenate([mesh.points, mesh.points[ends].mean(axis=1), centres[centred]])
    made = PolygonMesh.unchecked(points, offsets, vertices)
    (start, end), new = mesh._boundary.T, middle[shared.alone]
    cut = np.flatnonzero(new >= 0)
    halves = np.column_stack([np.insert(start, cut + 1, new[cut]), np.insert(end, cut, new[cut])])
    parts = np.empty(len(halves), dtype=np.int64)
    parts[made._places(halves)] = np.repeat(np.arange(len(new)), 1 + (new >= 0))
    places = np.concatenate([places, middle_places(places, ends), np.arange(len(points) - len(centred), len(points))])
    return inherit_parts(mesh, made, parents, parts, places)


def _split(marked: Bools, splitting: Splitting, mesh: PolygonMesh, edge: Ints) -> Bools:
    """Return a mask (m,) of the edges that marked cells split."""
    split = np.zeros(len(edge), dtype=bool)
    split[edge[splitting.edge & marked[cell_of_corner(mesh.offsets)]]] = True
    return split[edge]


def mark_crowded(marked: Bools, mesh: PolygonMesh, splitting: Splitting, edge: Ints) -> Bools:
    """Mark further cells until unmarked cells get at most one hanging node between neighbouring bends."""
    marked, cell, bend = marked.copy(), cell_of_corner(mesh.offsets), splitting.bend
    order = rotation(bend, mesh.offsets)
    begin = np.flatnonzero(bend[order])
    hanging = np.diff(np.append(begin, len(order))) - 1
    while True:
        new = np.add.reduceat(_split(marked, splitting, mesh, edge)[order], begin, dtype=np.int64)
        crowded = (new > 0) & (new + hanging > 1)
        before = np.count_nonzero(marked)
        marked[cell[begin[crowded]]] = True
        if np.count_nonzero(marked) == before:
            return marked
