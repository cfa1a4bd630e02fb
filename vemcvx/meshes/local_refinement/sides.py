"""The sides of polygonal cells, and the places where refinement splits them.

A vertex where the outline goes straight on hangs on a side; the others are *bends*. Not every bend is a corner: were
the middles on both sides of a bend of 175 degrees joined to the centre, then a quarter with that angle would be
left, whose quarters would have it again and again. So a corner is a bend by at least `SHARP`, or one in a row of
gentler bends, like those of a many-sided polygon, by which the outline has turned another `TURN`.

A *side* of a cell is its outline from one corner to the next, nearly always straight. One that is at least `SHORT` of
the cell's diameter long is split once: at a vertex if there is one near its middle, else at the middle of the edge in
its middle. So an edge is split in its own middle or not at all, whichever of its two cells asks.

Shorter sides are not split, or the short edges of Voronoi cells would beget thinner and thinner cells; their share of
the diameter doubles from pass to pass until they are long. A run of them whose bends cancel is part of a longer side;
one that is long in sum is split at the corner nearest to its middle (several, if it is very long), right turns first.
The perimeter is at least twice the diameter: every cell has at least two such places.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.polygons.segments import cross, rounding
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    first_in_row,
    next_vertex,
    offsets_of,
    previous_corner,
    rotation,
)
from vemcvx.meshes.tessellation import Tessellation

# Sine of the angle below which an edge goes straight on; beyond the rounding of the coordinates it means nothing.
STRAIGHT = 1e-6
SHARP, TURN = np.radians(20.0), np.radians(40.0)
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
class Outline:
    """Edges and angles of all cells, (n_corners,) each, at the corners of the mesh."""

    length: Floats
    """of the edge that starts there"""
    turn: Floats
    """angle by which the outline turns left there; zero where it goes straight on"""
    bend: Bools
    """whether it turns at all"""
    corner: Bools
    """whether that makes a corner"""


@dataclass(frozen=True, eq=False)
class Sides:
    """Sides of all cells, in the order of the cells; those of one cell counter-clockwise, the first long if any is."""

    cell: Ints
    """(n_sides,) cell of each side"""
    first: Ints
    """(n_sides,) where in `order` each side begins"""
    order: Ints
    """(n_corners,) corners of the mesh, side after side"""
    lengths: Floats
    """(n_sides,) in diameters of the cell"""
    long: Bools
    """(n_sides,) those that are split: of `SHORT` at least, and all of triangles (whose parts are similar)"""


@dataclass(frozen=True, eq=False)
class Splitting:
    """Where cells are split."""

    start: Ints
    """(n_sides,) corner of the mesh at which each side begins, the sides in the order of the cells"""
    offsets: Ints
    """(n_cells + 1,) cell c has the sides offsets[c] to offsets[c + 1]"""
    long: Bools
    """(n_sides,) those that are split in the middle"""
    bend: Bools
    """(n_corners,) vertices where the outline of a cell does not go straight on"""
    convex: Bools
    """(n_cells,) cells that turn right nowhere"""
    places: Ints
    """(n_cells,) number of places to split at: 2 at least, for all but absurd shapes"""
    vertex: Bools
    """(n_corners,) places to split at: the vertex at a corner of the mesh"""
    edge: Bools
    """(n_corners,) and the middle of the edge that starts there"""


def splitting_of(mesh: Tessellation) -> Splitting:
    """Find the sides of all cells and the places to split at."""
    outline = _outline_of(mesh)
    sides = _sides(mesh, outline, outline.corner)
    smooth = _cancelling(sides, outline)
    if len(smooth):
        corner = outline.corner.copy()
        corner[smooth] = False
        sides = _sides(mesh, outline, _at_least_three(corner, outline.corner, mesh.offsets))
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


def _outline_of(mesh: Tessellation) -> Outline:
    """Measure the outlines of all cells and find their corners."""
    x = mesh.points[mesh.vertices]
    edge = mesh.points[next_vertex(mesh.offsets, mesh.vertices)] - x
    length = np.hypot(edge[:, 0], edge[:, 1])
    before = previous_corner(mesh.offsets)
    sine, cosine = cross(edge[before], edge), np.einsum("ij,ij->i", edge[before], edge)
    slack = STRAIGHT * length[before] * length + rounding(x) * (length[before] + length)
    bend = _at_least_three((np.abs(sine) > slack) | (cosine <= 0.0), np.ones(len(x), dtype=bool), mesh.offsets)
    turn = np.where(bend, np.arctan2(sine, cosine), 0.0)
    return Outline(length, turn, bend, _at_least_three(_corners(turn, mesh.offsets), bend, mesh.offsets))


def _at_least_three(flags: Bools, otherwise: Bools, offsets: Ints) -> Bools:
    """The flags, but those of ``otherwise`` in cells with less than three of them."""
    few = np.add.reduceat(flags.astype(np.int64), offsets[:-1]) < 3
    return np.where(np.repeat(few, np.diff(offsets)), otherwise, flags)


def _corners(turn: Floats, offsets: Ints) -> Bools:
    """Sharp bends, and those of the others where the turn since the last sharp one passes 20, 60, 100 ... degrees."""
    sharp: Bools = np.abs(turn) > SHARP
    gentle = np.flatnonzero(np.logical_or.reduceat((turn != 0.0) & ~sharp, offsets[:-1]))
    if not len(gentle):
        return sharp
    order = rotation(offsets, first_in_row(sharp, offsets))
    fresh = sharp[order]
    fresh[offsets[:-1]] = True
    step = np.where(sharp, 0.0, turn)[order]
    total = np.cumsum(step)
    since = np.maximum.accumulate(np.where(fresh, np.arange(len(order)), 0))
    turned = np.rint((total - (total - step)[since]) / TURN)
    passed = np.concatenate([[False], turned[1:] != turned[:-1]]) & ~fresh & (step != 0.0)
    corner = sharp.copy()
    corner[order[passed]] = True
    return corner


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
