"""Local refinement of polygonal meshes: marked cells are split; neighbours keep their shape and get hanging nodes.

The midpoints of the n sides of a cell are joined to its centre, which gives n quadrilaterals. There are three
exceptions. The midpoints of a triangle are joined to each other (four similar triangles). A long thin convex cell with
two midpoints is cut across. A cell without a centre is first split into triangles between its vertices. Unrefined
neighbours get the new vertices as hanging nodes, which virtual elements treat like any vertex: no closure is needed.

Grading (`balance`): cells are marked, too, until no unmarked cell has a side with two hanging nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, eye_array, vstack

from vemcvx.base.arrays import SINGLE_EPS, Bools, Floats, Ints
from vemcvx.meshes.carrying import (
    Origins,
    Refinement,
    centre_values,
    check_lengths,
    inherit_parts,
    middle_places,
    middle_values,
)
from vemcvx.meshes.interfaces import pairs_of, places_of
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import (
    cell_of_corner,
    cross,
    first_in_row,
    least_of_each,
    next_corner,
    next_vertex,
    offsets_of,
    previous_corner,
    rotation,
    rounding,
    rows_in_order,
    sort_edges,
    spans,
    split_at_vertices,
)
from vemcvx.meshes.quality import largest_balls, walls_of

# The sides of polygonal cells, and the points at which refinement splits them.
#
# The outline of a cell is straight at hanging nodes; the other vertices are *bends*. Not every bend is a corner. If the
# midpoints on both sides of an angle of 175 degrees were joined to the centre, the part between them would keep this
# angle, and so would its parts in all further refinements. So a *corner* is a bend by more than `CORNER_ANGLE`. If a
# cell has fewer than three such bends, as a polygon with many sides, all bends are corners.
#
# A *side* of a cell is its outline from one corner to the next, nearly always straight. If it is at least `LONG_SIDE`
# times the diameter of the cell, it is split once: at a vertex near its midpoint if there is one, else at the midpoint
# of the edge that contains the midpoint of the side. So an edge is split at its midpoint or not at all.
#
# Shorter sides are not split; otherwise the short edges of Voronoi cells would lead to thinner and thinner cells. The
# length of a short side relative to the diameter doubles with each refinement until the side is long. Consecutive short
# sides count as one side, or as several if they are very long together. If their bends cancel, they become part of a
# longer side. Nearly every cell is split at two points at least, because its perimeter is at least twice its diameter.


CORNER_ANGLE = np.radians(20.0)
LONG_SIDE = 0.3
"""Least length, relative to the cell diameter, of sides that are split.

All sides of squares (0.71), hexagons (0.5), regular decagons (0.31) and rectangles up to 1 : 3.2 are split. Thinner
rectangles are only cut across, until their parts are wider. Zigzag cells with twelve sides of 0.26 are split into five
parts; with a limit of 0.25 there would be ten thin parts around one point.
"""


@dataclass(frozen=True, eq=False)
class Sides:
    """The sides of all cells, cell by cell and counter-clockwise; if a cell has long sides, its first side is long."""

    cell: Ints  # (n_sides,) cell of each side
    first: Ints  # (n_sides,) start of each side in `order`
    order: Ints  # (n_corners,) corners of the mesh, side after side
    lengths: Floats  # (n_sides,) divided by the diameter of the cell
    long: Bools  # (n_sides,) sides to split: those of at least `LONG_SIDE`, and all sides of triangles


@dataclass(frozen=True, eq=False)
class Splitting:
    """The points at which cells would be split."""

    sides: Ints  # (n_cells,) number of sides
    all_long: Bools  # (n_cells,) True if all sides of the cell are split
    convex: Bools  # (n_cells,)
    places: Ints  # (n_cells,) number of points at which the outline is split: at least 2 for all but extreme shapes
    bend: Bools  # (n_corners,) vertices at which the outline is not straight
    vertex: Bools  # (n_corners,) True if the outline is split at this vertex
    edge: Bools  # (n_corners,) True if it is split at the midpoint of the edge that starts at this vertex


def splitting_of(mesh: PolygonMesh) -> Splitting:
    """Find the sides of all cells, and the points at which sides would be split."""
    begin = mesh.offsets[:-1]
    length, turn, bend = _outlines(mesh)
    corner = _choose_flags(np.abs(turn) > CORNER_ANGLE, bend, mesh.offsets)
    fewer = _without_short_sides(_sides(mesh, length, corner), corner, turn)
    sides = _sides(mesh, length, _choose_flags(fewer, corner, mesh.offsets))
    vertex, edge = np.zeros((2, len(length)), dtype=bool)
    at, between = _middles(length[sides.order], sides)
    vertex[sides.order[at]] = edge[sides.order[between]] = True
    counts = np.bincount(sides.cell, minlength=mesh.n_cells)
    return Splitting(
        sides=counts,
        all_long=np.logical_and.reduceat(sides.long, offsets_of(counts)[:-1]),
        convex=np.minimum.reduceat(turn, begin) >= 0.0,
        places=np.add.reduceat(vertex + edge.astype(np.int64), begin),
        bend=bend,
        vertex=vertex,
        edge=edge,
    )


def _outlines(mesh: PolygonMesh) -> tuple[Floats, Floats, Bools]:
    """Return the lengths of edges, the angles of left turns at corners, and a mask of bends, (n_corners,) each."""
    x = mesh.points[mesh.vertices]
    edge = mesh.points[next_vertex(mesh.offsets, mesh.vertices)] - x
    length = np.hypot(edge[:, 0], edge[:, 1])
    before = previous_corner(mesh.offsets)
    sine, cosine = cross(edge[before], edge), np.einsum("ij,ij->i", edge[before], edge)
    # bound for |sine| (times both lengths) up to which the outline is straight, including the rounding of coordinates
    slack = SINGLE_EPS * length[before] * length + rounding(x) * (length[before] + length)
    bend = _choose_flags((np.abs(sine) > slack) | (cosine <= 0.0), np.ones(len(x), dtype=bool), mesh.offsets)
    return length, np.where(bend, np.arctan2(sine, cosine), 0.0), bend


def _choose_flags(flags: Bools, otherwise: Bools, offsets: Ints) -> Bools:
    """Return the flags, replaced by ``otherwise`` in cells with fewer than three of them."""
    few = np.add.reduceat(flags.astype(np.int64), offsets[:-1]) < 3
    return np.where(np.repeat(few, np.diff(offsets)), otherwise, flags)


def _sides(mesh: PolygonMesh, length: Floats, corner: Bools) -> Sides:
    """Return the sides between the given corners."""
    cell = cell_of_corner(mesh.offsets)
    order = rotation(mesh.offsets, first_in_row(corner, mesh.offsets))
    for _ in range(2):  # in the second pass, each cell begins with a long side
        first = np.flatnonzero(corner[order])
        lengths = np.add.reduceat(length[order], first) / mesh.diameters[cell[first]]
        triangle = np.bincount(cell[first], minlength=mesh.n_cells) == 3
        long = (lengths >= LONG_SIDE) | triangle[cell[first]]
        sides = Sides(cell[first], first, order, lengths, long)
        starts_long = np.zeros(len(order), dtype=bool)
        starts_long[first[long]] = True
        order = order[rotation(mesh.offsets, first_in_row(starts_long, mesh.offsets))]
    return sides


def _without_short_sides(sides: Sides, corner: Bools, turn: Floats) -> Bools:
    """Return the corners without corners between short sides, except some that divide long runs of short sides.

    If the turns of a short run, ends included, nearly cancel, the run becomes part of a longer side.
    """
    new = np.append(True, (np.diff(sides.cell) != 0) | sides.long[1:] | sides.long[:-1])
    run, begin = np.cumsum(new) - 1, np.flatnonzero(new)
    total = np.add.reduceat(sides.lengths, begin)[run]
    parts = np.maximum(1.0, np.rint(total / (2.0 * LONG_SIDE)))
    ahead = np.cumsum(sides.lengths) - sides.lengths
    place = (ahead - ahead[begin][run]) * parts / total
    nearest = np.clip(np.rint(place), 1.0, parts - 1.0)
    several = np.flatnonzero(~new & (parts > 1.0))
    keys = run[several] * len(corner) + nearest[several].astype(np.int64)
    kept = several[least_of_each(keys, np.abs(place - nearest)[several])]
    fewer = corner.copy()
    fewer[sides.order[sides.first[~new]]] = False
    fewer[sides.order[sides.first[kept]]] = True
    start, after = sides.order[sides.first[begin]], next_corner(offsets_of(np.bincount(sides.cell[begin])))
    turns = np.add.reduceat(turn[sides.order], sides.first[begin]) + turn[start[after]]
    smooth = np.flatnonzero(~sides.long[begin] & (total[begin] < LONG_SIDE) & (np.abs(turns) < CORNER_ANGLE))
    fewer[np.append(start[smooth], start[after[smooth]])] = False
    return fewer


def _middles(length: Floats, sides: Sides) -> tuple[Ints, Ints]:
    """Return the vertices and the edges at the midpoints of long sides, as positions in ``length``."""
    first, long = sides.first, sides.long
    side = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(length))))
    share = length / np.add.reduceat(length, first)[side]
    end = np.cumsum(share)  # lengths are relative to the side, so that short sides keep their digits
    begin = end - share
    base = begin[first][side]
    begin, end = begin - base, end - base
    inner = long[side]
    inner[first] = False
    away = np.where(inner, np.abs(begin - 0.5), np.inf)
    nearest = np.minimum.reduceat(away, first)
    is_nearest = first + first_in_row(away == nearest[side], np.append(first, len(side)))
    # A vertex within 0.2 side lengths of the midpoint is taken as the midpoint. Otherwise the edge there is at least
    # 0.4 side lengths long, and its midpoint is within 0.15 side lengths of the midpoint of the side.
    taken = nearest <= 0.2
    between = long[side] & ~taken[side] & (begin < 0.5) & (end >= 0.5)
    return is_nearest[taken], np.flatnonzero(between)


# The centre of a cell, to which the midpoints of its sides are joined:
#
#     four long sides    the intersection of the lines through opposite midpoints, (x_1 + x_2 + x_3 + x_4) / 4: under
#                        repeated refinement, parts tend to parallelograms, so no shape degenerates
#     an arrow           (four sides, right turn at x_1) the midpoint of the inner diagonal, (x_1 + x_3) / 2: two parts
#                        are arrows of the same shape, two are parallelograms
#     convex             the centroid, whose distance from every side is at least a third of the width
#     otherwise          the centroid if it is at least .1 diameters inside the lines of all sides; else the centre of
#                        the largest ball such that the cell is star-shaped about all its points (:mod:`.quality`)
#
# A cell has no centre if there is no such ball, or if the ball is so small that angles at its centre would be flat.
def centres_of(mesh: PolygonMesh, splitting: Splitting) -> tuple[Floats, Bools]:
    """Return the centres of all cells (n_cells, 2), and a mask (n_cells,) of the cells that have one."""
    centres, seen = mesh.centroids.copy(), np.ones(mesh.n_cells, dtype=bool)
    bends = np.flatnonzero(splitting.bend)
    counts = np.add.reduceat(splitting.bend.astype(np.int64), mesh.offsets[:-1])
    offsets = offsets_of(counts)

    four_long = splitting.all_long & (splitting.sides == 4)
    quads = np.flatnonzero((counts == 4) & (four_long | ~splitting.convex))
    centres[quads] = _middles_of_quads(mesh.points[mesh.vertices[bends[offsets[quads, None] + np.arange(4)]]])
    others = np.flatnonzero(~splitting.convex & (counts != 4))
    walls = walls_of(mesh)
    others = others[np.minimum.reduceat(walls.away, mesh.offsets[:-1])[others] < 0.1]
    if len(others):
        rows, sides = rows_in_order(mesh.offsets, np.arange(len(mesh.vertices)), others)
        inside, clear = largest_balls(rows, walls.normals[sides], walls.away[sides])
        centres[others] += inside * mesh.diameters[others, None]
        # a centre less than .03 diameters from the line of a side would make nearly flat angles
        seen[others] = clear >= 0.03
    return centres, seen


def _middles_of_quads(x: Floats) -> Floats:
    """Return the centres of convex quadrilaterals and arrows (c, 4, 2), exactly equal for every first corner."""
    even, odd = x[:, 0] + x[:, 2], x[:, 1] + x[:, 3]
    before, after = x - np.roll(x, 1, axis=1), np.roll(x, -1, axis=1) - x
    turn = cross(before, after)
    tip = np.argmin(turn, axis=1)
    arrow = turn.min(axis=1) < 0.0
    diagonal = np.where((tip % 2 == 0)[:, None], even, odd)
    return np.where(arrow[:, None], 0.5 * diagonal, 0.25 * (even + odd))


# The cells of a refined mesh: outlines of the old cells with the new midpoints, cut at the chosen points.
#
# One list has the nodes of all outlines, cell by cell, and then the new centres. The vertices of a new cell are a
# sequence of ranges of this list: a whole outline; or the outline from one midpoint to the next, the next midpoint, and
# the centre; or the three midpoints of a triangle; or sides and diagonals of a cell without a centre.


Ranges = tuple[Ints, Ints, Ints]
"""New cell, start of its range in the list, length of the range."""


@dataclass(frozen=True, eq=False)
class SplitKinds:
    """The way in which each cell is split, as masks (n_cells,)."""

    parted: Bools  # the sides are split at midpoints: the cell is `centred`, `medial` or cut across
    centred: Bools  # the midpoints are joined to a new centre
    medial: Bools  # a triangle, whose midpoints are joined to each other
    unseen: Bools  # the cell is split into triangles along diagonals, because there is no centre

    @classmethod
    def from_marks(cls, splitting: Splitting, marked: Bools, seen: Bools) -> SplitKinds:
        """Choose the split of each cell from masks of the marked cells and of the cells with a centre."""
        parted = marked & seen
        medial = parted & (splitting.sides == 3) & splitting.all_long & splitting.convex
        return cls(parted, parted & ~medial & ~((splitting.places == 2) & splitting.convex), medial, marked & ~seen)


@dataclass(frozen=True, eq=False)
class Outlines:
    """Old cells with the new midpoints as vertices; the outline of a cell to be split begins with a mark."""

    offsets: Ints
    nodes: Ints  # the outline of cell c is nodes[offsets[c]:offsets[c + 1]]
    marks: Ints  # (m,) positions where outlines are split: midpoints of parted cells, all bends of unseen cells
    cell: Ints  # (m,) cell of each mark
    stop: Ints  # (m,) end of the part of the outline that begins at a mark
    follower: Ints  # (m,) position of the next mark of the cell


def outlines_of(mesh: PolygonMesh, splitting: Splitting, kinds: SplitKinds, middle: Ints) -> Outlines:
    """Insert the nodes ``middle`` (n_corners,), -1 for none, after the corners of a mesh, and mark points to split."""
    cell = cell_of_corner(mesh.offsets)
    new = middle >= 0
    place = offsets_of(1 + new)
    offsets, old, inserted = place[mesh.offsets], place[:-1], place[:-1][new] + 1
    nodes, marked = np.empty(place[-1], dtype=np.int64), np.zeros(place[-1], dtype=bool)
    nodes[old], nodes[inserted] = mesh.vertices, middle[new]
    marked[old] = (kinds.parted[cell] & splitting.vertex) | (kinds.unseen[cell] & splitting.bend)
    marked[inserted] = (kinds.parted[cell] & splitting.edge)[new]
    order = rotation(offsets, first_in_row(marked, offsets))
    marks = np.flatnonzero(marked[order])
    owner = cell_of_corner(offsets)[marks]
    last = np.append(owner[1:] != owner[:-1], True)
    after = np.append(marks[1:], 0)
    stop, follower = np.where(last, offsets[owner + 1], after), np.where(last, offsets[owner], after)
    return Outlines(offsets=offsets, nodes=nodes[order], marks=marks, cell=owner, stop=stop, follower=follower)


def children_of(outlines: Outlines, kinds: SplitKinds, points: Floats, first_centre: int) -> tuple[Ints, Ints, Ints]:
    """Return offsets and vertices of the new cells, in the order of their parents, and the parents.

    ``points`` are the old nodes; new centres are numbered from ``first_centre`` on in the order of the cells.
    """
    n_cells = len(outlines.offsets) - 1
    marks = np.bincount(outlines.cell, minlength=n_cells)
    cut, whole = np.flatnonzero(kinds.unseen), np.flatnonzero(~kinds.parted & ~kinds.unseen)
    pieces = _triangles(outlines, cut, points)
    children = np.where(kinds.parted, marks + kinds.medial, 1)
    children[cut] = marks[cut] - 2
    first = offsets_of(children)
    centres = first_centre + np.arange(np.count_nonzero(kinds.centred))
    at_centre = len(outlines.nodes) + np.cumsum(kinds.centred) - 1
    # parts of parted cells: the outline from a midpoint to the next, the next midpoint, and the centre, if any
    part = np.flatnonzero(kinds.parted[outlines.cell])
    cell, start = outlines.cell[part], outlines.marks[part]
    child = first[cell] + part - offsets_of(marks)[cell]
    inner, medial = kinds.centred[cell], kinds.medial[cell]
    one = np.ones(len(part), dtype=np.int64)
    ranges: list[Ranges] = [
        (first[whole], outlines.offsets[whole], np.diff(outlines.offsets)[whole]),
        (child, start, outlines.stop[part] - start),
        (child, outlines.follower[part], one),
        (child[inner], at_centre[cell[inner]], one[inner]),
        (first[cell[medial]] + marks[cell[medial]], start[medial], one[medial]),
        *((first[c] + number, start, length) for c, (number, start, length) in zip(cut, pieces, strict=True)),
    ]
    cell, start, count = (np.concatenate(parts) for parts in zip(*ranges, strict=True))
    order = np.argsort(cell, kind="stable")
    vertices = np.concatenate([outlines.nodes, centres])[spans(start[order], count[order])]
    sizes = np.bincount(cell, weights=count, minlength=first[-1]).astype(np.int64)
    return offsets_of(sizes), vertices, np.repeat(np.arange(n_cells), children)


def _triangles(outlines: Outlines, cells: Ints, points: Floats) -> list[Ranges]:
    """Return, for each cell, the ranges of its triangles: each edge gives its first corner, or the whole side."""
    found = []
    begin = np.searchsorted(outlines.cell, cells)
    end = np.searchsorted(outlines.cell, cells, side="right")
    for k in range(len(cells)):  # cells without a centre are rare
        marks, stops = outlines.marks[begin[k] : end[k]], outlines.stop[begin[k] : end[k]]
        corners = points[outlines.nodes[marks]]
        triangles = split_at_vertices((corners - corners[0])[None])[0]
        start, after = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
        side = after == (start + 1) % len(marks)
        number = np.repeat(np.arange(len(triangles)), 3)
        found.append((number, marks[start], np.where(side, stops[start] - marks[start], 1)))
    return found


def refine_polygons(mesh: PolygonMesh, marked: Bools, balance: bool) -> Refinement[PolygonMesh]:
    """Split the marked cells (n_cells,), and the cells that `balance` adds."""
    splitting, shared, edge = splitting_of(mesh), mesh.shared_edges, mesh.shared_edges.number
    places = places_of(pairs_of(mesh.interfaces), mesh.points)
    if mesh.interfaces:  # edges of two bodies in one place have one number
        edge = sort_edges(mesh.offsets, places[mesh.vertices], mesh.n_nodes).number
    centres, seen = centres_of(mesh, splitting)
    seen &= splitting.places >= 2
    wanted = splitting.edge & seen[cell_of_corner(mesh.offsets)]
    if balance:
        marked = mark_crowded(marked, wanted, mesh, splitting.bend, edge)
    split = np.zeros(len(shared.first), dtype=bool)
    split[shared.number[_split(marked, wanted, mesh, edge)]] = True
    ends = shared.ends[split]
    check_lengths(mesh.points, ends)
    middle = np.full(len(split), -1)
    middle[split] = mesh.n_nodes + np.arange(len(ends))
    middle = middle[shared.number]
    kinds = SplitKinds.from_marks(splitting, marked, seen)
    outlines = outlines_of(mesh, splitting, kinds, middle)
    offsets, vertices, parents = children_of(outlines, kinds, mesh.points, mesh.n_nodes + len(ends))
    centred = np.flatnonzero(kinds.centred)
    points = np.concatenate([mesh.points, mesh.points[ends].mean(axis=1), centres[centred]])
    made = PolygonMesh.unchecked(points, offsets, vertices)
    (start, end), new = mesh._boundary.T, middle[shared.alone]
    cut = np.flatnonzero(new >= 0)
    halves = np.column_stack([np.insert(start, cut + 1, new[cut]), np.insert(end, cut, new[cut])])
    parts = np.empty(len(halves), dtype=np.int64)
    parts[made._places(halves)] = np.repeat(np.arange(len(new)), 1 + (new >= 0))
    places = np.concatenate([places, middle_places(places, ends), np.arange(len(points) - len(centred), len(points))])
    values = [
        eye_array(mesh.n_nodes),
        middle_values(ends, mesh.n_nodes),
        centre_values(mesh.points, rows_in_order(mesh.offsets, mesh.vertices, centred), centres[centred]),
    ]
    return inherit_parts(mesh, made, Origins(parents, parts, places, csr_array(vstack(values, format="csr"))))


def _split(marked: Bools, wanted: Bools, mesh: PolygonMesh, edge: Ints) -> Bools:
    """Return a mask of the corners whose edges are split in a marked cell; `edge` has the edge of each corner."""
    split = np.zeros(len(edge), dtype=bool)
    split[edge[wanted & marked[cell_of_corner(mesh.offsets)]]] = True
    return split[edge]


def mark_crowded(marked: Bools, wanted: Bools, mesh: PolygonMesh, bend: Bools, edge: Ints) -> Bools:
    """Mark further cells, until no unmarked cell would get a second node between two bends of its outline."""
    marked, cell = marked.copy(), cell_of_corner(mesh.offsets)
    order = rotation(mesh.offsets, first_in_row(bend, mesh.offsets))
    begin = np.flatnonzero(bend[order])
    hanging = np.diff(np.append(begin, len(order))) - 1
    while True:
        new = np.add.reduceat(_split(marked, wanted, mesh, edge)[order], begin, dtype=np.int64)
        crowded = (new > 0) & (new + hanging > 1)
        before = np.count_nonzero(marked)
        marked[cell[begin[crowded]]] = True
        if np.count_nonzero(marked) == before:
            return marked
