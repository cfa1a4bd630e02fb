"""Local refinement of polygonal meshes: chosen cells are split, neighbours keep their shape and get hanging nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, eye_array, vstack

from vemcvx.base.arrays import SINGLE_EPS, Bools, Floats, Ints
from vemcvx.meshes.carrying import (
    Origins,
    Refinement,
    carried,
    centre_values,
    check_lengths,
    middle_places,
    middle_values,
)
from vemcvx.meshes.interfaces import pairs_of, places_of
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import (
    cell_of_corner,
    cross,
    diagonals_of,
    first_in_row,
    least_of_each,
    next_corner,
    next_vertex,
    offsets_of,
    previous_corner,
    rotation,
    rounding,
    rows_in_order,
    shared_edges,
    spans,
)
from vemcvx.meshes.quality import largest_balls, walls_of

# The sides of polygonal cells, and the places where refinement splits them.
#
# A vertex where the outline goes straight on hangs on a side; the others are *bends*. Not every bend is a corner: were
# the middles on both sides of a bend of 175 degrees joined to the centre, then a quarter with that angle would be left,
# whose quarters would have it again and again. So a corner is a bend by at least `SHARP`; if a cell has fewer than
# three, all bends are corners, like those of a many-sided polygon.
#
# A *side* of a cell is its outline from one corner to the next, nearly always straight. One that is at least `SHORT`
# of the cell's diameter long is split once: at a vertex if there is one near its middle, else at the middle of the
# edge in its middle. So an edge is split in its own middle or not at all, whichever of its two cells asks.
#
# Shorter sides are not split, or the short edges of Voronoi cells would beget thinner and thinner cells; their share
# of the diameter doubles from pass to pass until they are long. A run of them counts as one side, or, if it is very
# long, as several; one whose bends cancel is part of a longer side. The perimeter is at least twice the diameter: every
# cell has at least two such places.


SHARP = np.radians(20.0)
# Part of the diameter. The sides of squares (0.71), hexagons (0.5), regular decagons (0.31) and rectangles up to
# 1 : 3.2 are long; thinner rectangles are cut across only, which brings them back below. Zigzag cells of twelve sides
# of 0.26 get 5 children; if 0.25 were enough it would be 10, thin ones around a point.
SHORT = 0.3


@dataclass(frozen=True, eq=False)
class Sides:
    """Sides of all cells, in the order of the cells; those of one cell counter-clockwise, the first long if any is."""

    cell: Ints  # (n_sides,) cell of each side
    first: Ints  # (n_sides,) where in `order` each side begins
    order: Ints  # (n_corners,) corners of the mesh, side after side
    lengths: Floats  # (n_sides,) in diameters of the cell
    long: Bools  # (n_sides,) those that are split: of `SHORT` at least, and all of triangles (whose parts are similar)


@dataclass(frozen=True, eq=False)
class Splitting:
    """The points and edges at which cells are split: masks of cells and of their corners."""

    sides: Ints  # (n_cells,) how many sides a cell has
    all_long: Bools  # (n_cells,) cells all of whose sides are split in the middle
    convex: Bools  # (n_cells,) cells that turn right nowhere
    places: Ints  # (n_cells,) number of places to split at: 2 at least, for all but absurd shapes
    bend: Bools  # (n_corners,) vertices where the outline of a cell does not go straight on
    vertex: Bools  # (n_corners,) places to split at: the vertex at a corner of the mesh
    edge: Bools  # (n_corners,) and the middle of the edge that starts there


def splitting_of(mesh: PolygonMesh) -> Splitting:
    """Find the sides of all cells and the places to split at."""
    begin = mesh.offsets[:-1]
    length, turn, bend = _outlines(mesh)
    corner = _at_least_three(np.abs(turn) > SHARP, bend, mesh.offsets)
    fewer = _without_short_sides(_sides(mesh, length, corner), corner, turn)
    sides = _sides(mesh, length, _at_least_three(fewer, corner, mesh.offsets))
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
    """At each corner: the length of the edge that starts there, by how much the outline turns left, whether it does."""
    x = mesh.points[mesh.vertices]
    edge = mesh.points[next_vertex(mesh.offsets, mesh.vertices)] - x
    length = np.hypot(edge[:, 0], edge[:, 1])
    before = previous_corner(mesh.offsets)
    sine, cosine = cross(edge[before], edge), np.einsum("ij,ij->i", edge[before], edge)
    # Sine of the angle below which an edge goes straight on; beyond the rounding of the coordinates it means nothing.
    slack = SINGLE_EPS * length[before] * length + rounding(x) * (length[before] + length)
    bend = _at_least_three((np.abs(sine) > slack) | (cosine <= 0.0), np.ones(len(x), dtype=bool), mesh.offsets)
    return length, np.where(bend, np.arctan2(sine, cosine), 0.0), bend


def _at_least_three(flags: Bools, otherwise: Bools, offsets: Ints) -> Bools:
    """The flags, but those of ``otherwise`` in cells with less than three of them."""
    few = np.add.reduceat(flags.astype(np.int64), offsets[:-1]) < 3
    return np.where(np.repeat(few, np.diff(offsets)), otherwise, flags)


def _sides(mesh: PolygonMesh, length: Floats, corner: Bools) -> Sides:
    """Sides between the given corners."""
    cell = cell_of_corner(mesh.offsets)
    order = rotation(mesh.offsets, first_in_row(corner, mesh.offsets))
    for _ in range(2):  # once to know the long sides, once more to begin with one
        first = np.flatnonzero(corner[order])
        lengths = np.add.reduceat(length[order], first) / mesh.diameters[cell[first]]
        triangle = np.bincount(cell[first], minlength=mesh.n_cells) == 3
        long = (lengths >= SHORT) | triangle[cell[first]]
        sides = Sides(cell[first], first, order, lengths, long)
        starts_long = np.zeros(len(order), dtype=bool)
        starts_long[first[long]] = True
        order = order[rotation(mesh.offsets, first_in_row(starts_long, mesh.offsets))]
    return sides


def _without_short_sides(sides: Sides, corner: Bools, turn: Floats) -> Bools:
    """The corners without those inside runs of short sides, but for some that part runs which are long in sum.

    A run that is short in sum and hardly turns in all, ends included, is part of a longer side.
    """
    new = np.append(True, (np.diff(sides.cell) != 0) | sides.long[1:] | sides.long[:-1])
    run, begin = np.cumsum(new) - 1, np.flatnonzero(new)
    total = np.add.reduceat(sides.lengths, begin)[run]
    parts = np.maximum(1.0, np.rint(total / (2.0 * SHORT)))
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
    smooth = np.flatnonzero(~sides.long[begin] & (total[begin] < SHORT) & (np.abs(turns) < SHARP))
    fewer[np.append(start[smooth], start[after[smooth]])] = False
    return fewer


def _middles(length: Floats, sides: Sides) -> tuple[Ints, Ints]:
    """Vertices, and edges, in the middle of long sides, as positions in the order of ``length``."""
    first, long = sides.first, sides.long
    side = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(length))))
    share = length / np.add.reduceat(length, first)[side]
    end = np.cumsum(share)  # every side counts one, so that short ones keep their digits
    begin = end - share
    base = begin[first][side]
    begin, end = begin - base, end - base
    inner = long[side]
    inner[first] = False
    away = np.where(inner, np.abs(begin - 0.5), np.inf)
    nearest = np.minimum.reduceat(away, first)
    is_nearest = first + first_in_row(away == nearest[side], np.append(first, len(side)))
    # A vertex this near to the middle of its side, in parts of it, is its middle. Else the edge in the middle is at
    # least 0.4 of the side long, and its own middle lies within 0.15 of the side's.
    taken = nearest <= 0.2
    between = long[side] & ~taken[side] & (begin < 0.5) & (end >= 0.5)
    return is_nearest[taken], np.flatnonzero(between)


# The inner point that the middles of a cell's sides are joined to.
#
#     four long sides    the crossing of the lines through opposite middles, (x_1 + x_2 + x_3 + x_4) / 4: the quarters
#                        of quarters ... tend to parallelograms, so no shape degenerates
#     an arrow           (four sides, right turn at x_1) the middle of its inner diagonal, (x_1 + x_3) / 2: two children
#                        are arrows of the same shape, two are parallelograms
#     convex             the centroid, from which every side is at least a third of the width away
#     else               the centroid if it is .1 of the diameter in front of the lines of all sides, else the centre of
#                        the largest ball from which all of the cell is seen (:mod:`.quality`)
#
# A cell without such a ball, or with one so small that it would be seen under flat angles, has no such point.
def centres_of(mesh: PolygonMesh, splitting: Splitting) -> tuple[Floats, Bools]:
    """Centres of all cells (n_cells, 2), and which cells have one, (n_cells,)."""
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
        # The centre is .03 diameters away from the line of every side: a side of a quarter of the diameter is then seen
        # under an angle of six degrees at least.
        seen[others] = clear >= 0.03
    return centres, seen


def _middles_of_quads(x: Floats) -> Floats:
    """Crossings of the middle lines of convex quadrilaterals (c, 4, 2), middles of the inner diagonals of arrows."""
    # The sums of opposite corners do not depend on where the list begins, to the bit.
    even, odd = x[:, 0] + x[:, 2], x[:, 1] + x[:, 3]
    before, after = x - np.roll(x, 1, axis=1), np.roll(x, -1, axis=1) - x
    turn = cross(before, after)
    tip = np.argmin(turn, axis=1)
    arrow = turn.min(axis=1) < 0.0
    diagonal = np.where((tip % 2 == 0)[:, None], even, odd)
    return np.where(arrow[:, None], 0.5 * diagonal, 0.25 * (even + odd))


# The cells of a refined mesh: outlines of the old cells with the new middles in them, cut at the chosen places.
#
# All nodes of the outlines, cell after cell, and the new centres form one pool; every new cell is a few ranges of it,
# one after the other: a whole outline; or a part of it from middle to middle, the next middle, and the centre; or the
# three middles of a triangle; or sides and diagonals of a cell without centre.


Ranges = tuple[Ints, Ints, Ints]  # new cell, where in the pool its range begins, and how long that is


@dataclass(frozen=True, eq=False)
class Kinds:
    """The fate of each cell, as masks (n_cells,)."""

    parted: Bools  # at the middles of its sides
    centred: Bools  # of these, with the middles joined to a new centre
    medial: Bools  # or to each other, being a triangle; the others are cut across
    unseen: Bools  # into triangles along diagonals, having no centre

    @classmethod
    def of(cls, splitting: Splitting, marked: Bools, seen: Bools) -> Kinds:
        """Tell what becomes of each cell from which are marked, and which have a centre that sees all of them."""
        parted = marked & seen
        medial = parted & (splitting.sides == 3) & splitting.all_long & splitting.convex
        return cls(parted, parted & ~medial & ~((splitting.places == 2) & splitting.convex), medial, marked & ~seen)


@dataclass(frozen=True, eq=False)
class Outlines:
    """Old cells with the new middles among their vertices, those to be cut turned so that they begin with a mark."""

    offsets: Ints
    nodes: Ints  # cell c has the outline nodes[offsets[c]:offsets[c + 1]]
    marks: Ints  # (m,) positions where cells are cut: middles of sides of parted cells, all bends of unseen ones
    cell: Ints  # (m,) cell of each mark
    stop: Ints  # (m,) where the part of the outline that begins at a mark ends
    follower: Ints  # (m,) the position of the next mark of the cell


def outlines_of(mesh: PolygonMesh, splitting: Splitting, kinds: Kinds, middle: Ints) -> Outlines:
    """Insert the nodes ``middle`` (n_corners,), -1 for none, after the corners of a mesh, and mark where to cut."""
    cell = cell_of_corner(mesh.offsets)
    new = middle >= 0
    place = offsets_of(1 + new)
    offsets, old, inserted = place[mesh.offsets], place[:-1], place[:-1][new] + 1
    nodes, marked = np.empty(place[-1], dtype=np.int64), np.zeros(place[-1], dtype=bool)
    nodes[old], nodes[inserted] = mesh.vertices, middle[new]
    marked[old] = (kinds.parted[cell] & splitting.vertex) | (kinds.unseen[cell] & splitting.bend)
    marked[inserted] = (kinds.parted[cell] & splitting.edge)[new]
    turned = rotation(offsets, first_in_row(marked, offsets))
    marks = np.flatnonzero(marked[turned])
    owner = cell_of_corner(offsets)[marks]
    last = np.append(owner[1:] != owner[:-1], True)
    after = np.append(marks[1:], 0)
    stop, follower = np.where(last, offsets[owner + 1], after), np.where(last, offsets[owner], after)
    return Outlines(offsets=offsets, nodes=nodes[turned], marks=marks, cell=owner, stop=stop, follower=follower)


def children_of(outlines: Outlines, kinds: Kinds, points: Floats, first_centre: int) -> tuple[Ints, Ints, Ints]:
    """Offsets and vertices of the new cells, in the order of their parents, and the parents.

    ``points`` are the nodes of the old mesh; the centres are numbered from ``first_centre`` in the order of the cells.
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
    # Of parted cells, from each middle: the outline to the next one, that one, and the centre if there is one.
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
    """Of the triangles of each of the cells: the triangle, and for each edge its first corner, or the whole side."""
    found = []
    begin = np.searchsorted(outlines.cell, cells)
    end = np.searchsorted(outlines.cell, cells, side="right")
    for k in range(len(cells)):  # cells that no point sees all of are rare
        marks, stops = outlines.marks[begin[k] : end[k]], outlines.stop[begin[k] : end[k]]
        corners = points[outlines.nodes[marks]]
        triangles = diagonals_of((corners - corners[0])[None])[0]
        start, after = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
        side = after == (start + 1) % len(marks)
        number = np.repeat(np.arange(len(triangles)), 3)
        found.append((number, marks[start], np.where(side, stops[start] - marks[start], 1)))
    return found


# Local refinement of polygonal meshes: chosen cells are split, their neighbours get the new vertices and stay.
#
# The middles of the sides of a cell (`sides`) are joined to its centre (`centres`): n sides, n quadrilaterals. A
# triangle has its middles joined to each other instead (four similar triangles), a long thin convex cell with two
# middles is cut across, and a cell without a centre is first cut into triangles between its own vertices. New
# vertices hang on the straight sides of unrefined neighbours; virtual elements take them as any vertex, so no closure
# is needed.
#
# Grading: an unrefined cell of which a side would get a new hanging node beside another one is refined too, and so
# on.


def refined_in_plane(mesh: PolygonMesh, marked: Bools, balance: bool) -> Refinement[PolygonMesh]:
    """Split the marked cells (n_cells,), and those that `balance` adds."""
    splitting, shared, edge = splitting_of(mesh), mesh.shared_edges, mesh.shared_edges.number
    places = places_of(pairs_of(mesh.interfaces), mesh.points)
    if mesh.interfaces:  # Edges of two bodies in one place have one number.
        edge = shared_edges(mesh.offsets, places[mesh.vertices], mesh.n_nodes).number
    centres, seen = centres_of(mesh, splitting)
    seen &= splitting.places >= 2
    wanted = splitting.edge & seen[cell_of_corner(mesh.offsets)]
    if balance:
        marked = closed(marked, wanted, mesh, splitting.bend, edge)
    split = np.zeros(len(shared.first), dtype=bool)
    split[shared.number[_split(marked, wanted, mesh, edge)]] = True
    ends = shared.ends[split]
    check_lengths(mesh.points, ends)
    middle = np.full(len(split), -1)
    middle[split] = mesh.n_nodes + np.arange(len(ends))
    middle = middle[shared.number]
    kinds = Kinds.of(splitting, marked, seen)
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
    return carried(mesh, made, Origins(parents, parts, places, csr_array(vstack(values, format="csr"))))


def _split(marked: Bools, wanted: Bools, mesh: PolygonMesh, edge: Ints) -> Bools:
    """A mask of the corners at which edges start that marked cells want split, by the numbers of their edges."""
    split = np.zeros(len(edge), dtype=bool)
    split[edge[wanted & marked[cell_of_corner(mesh.offsets)]]] = True
    return split[edge]


def closed(marked: Bools, wanted: Bools, mesh: PolygonMesh, bend: Bools, edge: Ints) -> Bools:
    """Cells marked, and those that would get a new node beside another one between two bends of their outline."""
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
