"""The sides of polygonal cells, and the places where refinement splits them.

A *side* of a cell is its outline from one corner to the next (see `corners`), nearly always straight. One that is at
least `SHORT` of the cell's diameter long is split once: at a vertex if there is one near its middle, else at the middle
of the edge in its middle. So an edge is split in its own middle or not at all, whichever of its two cells asks.

Shorter sides are not split, or the short edges of Voronoi cells would beget thinner and thinner cells; their share of
the diameter doubles from pass to pass until they are long. A run of them whose bends cancel is part of a longer side;
one that is long in sum is split at the corner nearest to its middle (several, if it is very long), right turns first.
The perimeter is at least twice the diameter: every cell has at least two such places.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.local_refinement.corners import SHARP, Outline, at_least_three, outline_of
from vemcvx.meshes.polygons.ragged import first_in_row, offsets_of, rotation
from vemcvx.meshes.polygons.topology import cell_of_corner
from vemcvx.meshes.tessellation import Tessellation

# Part of the diameter. The sides of squares (0.71), hexagons (0.5), regular decagons (0.31) and rectangles up to
# 1 : 3.2 are long; thinner rectangles are cut across only, which brings them back below. Zigzag cells of twelve sides
# of 0.26 get 5 children; if 0.25 were enough it would be 10, thin ones around a point.
SHORT = 0.3
# A vertex this near to the middle of its side, in parts of it, is its middle. Else the edge in the middle is
# at least 0.4 of the side long, and its own middle lies within 0.15 of the side's.
NEAR = 0.2
# In lengths of its share of a run: so much nearer to the middle a right turn seems to be.
RIGHT = 0.3


@dataclass(frozen=True, eq=False)
class Sides:
    """Sides of all cells, in the order of the cells; those of one cell counter-clockwise, the first long if any is.

    Attributes
    ----------
    cell : (n_sides,) int
        Cell of each side.
    first : (n_sides,) int
        Where in ``order`` each side begins.
    order : (n_corners,) int
        Corners of the mesh, side after side.
    lengths : (n_sides,) float
        Length of each side in diameters of its cell.
    long : (n_sides,) bool
        Sides that are split: of `SHORT` at least, and all of triangles (whose parts are similar).
    """

    cell: Ints
    first: Ints
    order: Ints
    lengths: Floats
    long: Bools


@dataclass(frozen=True, eq=False)
class Splitting:
    """Where cells are split.

    Attributes
    ----------
    start : (n_sides,) int
        Corner of the mesh at which each side begins, the sides in the order of the cells.
    offsets : (n_cells + 1,) int
        Cell c has the sides offsets[c] to offsets[c + 1].
    long : (n_sides,) bool
        Sides that are split in the middle.
    bend : (n_corners,) bool
        Vertices where the outline of a cell does not go straight on.
    convex : (n_cells,) bool
        Cells that turn right nowhere.
    places : (n_cells,) int
        Number of places to split at: 2 at least, for all but absurd shapes.
    vertex, edge : (n_corners,) bool
        Places to split at: the vertex at a corner of the mesh, and the middle of the edge that starts there.
    """

    start: Ints
    offsets: Ints
    long: Bools
    bend: Bools
    convex: Bools
    places: Ints
    vertex: Bools
    edge: Bools


def splitting_of(mesh: Tessellation) -> Splitting:
    """Find the sides of all cells and the places to split at."""
    outline = outline_of(mesh)
    sides = _sides(mesh, outline, outline.corner)
    smooth = _cancelling(sides, outline)
    if len(smooth):
        corner = outline.corner.copy()
        corner[smooth] = False
        sides = _sides(mesh, outline, at_least_three(corner, outline.corner, mesh.offsets))
    order, first = sides.order, sides.first
    vertex, edge = np.zeros((2, len(order)), dtype=bool)
    at, between = _middles(outline.length[order], sides)
    vertex[order[at]] = edge[order[between]] = True
    vertex[order[first[_split_runs(sides, outline.turn[order[first]] < 0.0)]]] = True
    convex = np.minimum.reduceat(outline.turn, mesh.offsets[:-1]) >= 0.0
    places = np.add.reduceat(vertex + edge.astype(np.int64), mesh.offsets[:-1])
    offsets = offsets_of(np.bincount(sides.cell, minlength=mesh.n_cells))
    return Splitting(
        start=order[first],
        offsets=offsets,
        long=sides.long,
        bend=outline.bend,
        convex=convex,
        places=places,
        vertex=vertex,
        edge=edge,
    )


def _sides(mesh: Tessellation, outline: Outline, corner: Bools) -> Sides:
    """Sides between the given corners."""
    cell = cell_of_corner(mesh.offsets)
    order = rotation(mesh.offsets, first_in_row(corner, mesh.offsets))
    for _ in range(2):  # once to know the long sides, once more to begin with one
        first = np.flatnonzero(corner[order])
        lengths = np.add.reduceat(outline.length[order], first) / mesh.diameters[cell[first]]
        triangle = np.bincount(cell[first], minlength=mesh.n_cells) == 3
        long = (lengths >= SHORT) | triangle[cell[first]]
        sides = Sides(cell[first], first, order, lengths, long)
        starts_long = np.zeros(len(order), dtype=bool)
        starts_long[first[long]] = True
        order = order[rotation(mesh.offsets, first_in_row(starts_long, mesh.offsets))]
    return sides


def _runs(sides: Sides) -> tuple[Bools, Ints, Floats]:
    """Which sides begin a run (of long, or of short sides of a cell), the run of each side, and lengths of runs."""
    new = np.append(True, (np.diff(sides.cell) != 0) | (sides.long[1:] != sides.long[:-1]))
    return new, np.cumsum(new) - 1, np.add.reduceat(sides.lengths, np.flatnonzero(new))


def _cancelling(sides: Sides, outline: Outline) -> Ints:
    """Corners of the mesh in runs of short sides that are short in sum and hardly turn in all."""
    new, run, total = _runs(sides)
    begin = np.flatnonzero(new)
    turn = outline.turn[sides.order[sides.first]]
    # The corner after a run is where the next side begins, in the same cell or (a cell begins with a long side) the
    # first of its cell.
    last = np.append(begin[1:], len(new)) - 1
    wraps = np.append(sides.cell[1:] != sides.cell[:-1], True)[last]
    first_side = np.searchsorted(sides.cell, sides.cell[last])
    end = np.where(wraps, first_side, np.minimum(last + 1, len(new) - 1))
    flat = np.abs(np.add.reduceat(turn, begin) + turn[end]) < SHARP
    smooth = ~sides.long[begin] & (total < SHORT) & flat
    chosen: Ints = np.concatenate([np.flatnonzero(smooth[run]), end[smooth]])
    return sides.order[sides.first[chosen]]


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
    taken = nearest <= NEAR
    between = long[side] & ~taken[side] & (begin < 0.5) & (end >= 0.5)
    return is_nearest[taken], np.flatnonzero(between)


def _split_runs(sides: Sides, right: Bools) -> Ints:
    """Sides at whose first corner a run of short sides is split; ``right`` where the outline turns right there."""
    new, run, total = _runs(sides)
    parts = np.maximum(1.0, np.rint(total / (2.0 * SHORT)))
    parts[sides.long[new] | (total < SHORT)] = 0.0
    share = sides.lengths / total[run]
    begin = np.cumsum(share) - share
    begin -= begin[new][run]
    inner = np.flatnonzero(~new & (parts[run] > 0.0))
    place = begin[inner] * parts[run[inner]]
    part = np.minimum(np.floor(place), parts[run[inner]] - 1.0)
    bins = (np.cumsum(parts) - parts)[run[inner]] + part
    order = np.lexsort((np.abs(place - part - 0.5) - RIGHT * right[inner], bins))
    best = np.append(True, np.diff(bins[order]) > 0)[: len(order)]
    chosen: Ints = order[best]
    return inner[chosen]
