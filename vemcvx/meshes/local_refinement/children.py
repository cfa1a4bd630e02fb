"""The cells of a refined mesh: outlines of the old cells with the new middles in them, cut at the chosen places.

All nodes of the outlines, cell after cell, and the new centres form one pool; every new cell is a few ranges of it, one
after the other: a whole outline; or a part of it from middle to middle, the next middle, and the centre; or the three
middles of a triangle; or sides and diagonals of a cell without centre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.local_refinement.sides import Splitting
from vemcvx.meshes.polygons.convex_pieces import convex_pieces
from vemcvx.meshes.polygons.topology import cell_of_corner, first_in_row, offsets_of, rotation, spans
from vemcvx.meshes.tessellation import Tessellation

Ranges = tuple[Ints, Ints, Ints]  # new cell, where in the pool its range begins, and how long that is


@dataclass(frozen=True, eq=False)
class Kinds:
    """What becomes of each cell, (n_cells,) bool each."""

    parted: Bools
    """at the middles of its sides"""
    centred: Bools
    """of these, with the middles joined to a new centre"""
    medial: Bools
    """or to each other, being a triangle; the others are cut across"""
    unseen: Bools
    """into convex pieces along diagonals, having no centre"""


def kinds_of(splitting: Splitting, marked: Bools, seen: Bools) -> Kinds:
    """Tell what becomes of each cell from which are marked, and which have a centre that sees all of them."""
    parted = marked & seen
    medial = parted & (np.diff(splitting.offsets) == 3) & splitting.convex
    centred = parted & ~medial & ~((splitting.places == 2) & splitting.convex)
    return Kinds(parted, centred, medial, marked & ~seen)


@dataclass(frozen=True, eq=False)
class Outlines:
    """Old cells with the new middles among their vertices, those to be cut turned so that they begin with a mark."""

    offsets: Ints
    nodes: Ints
    """cell c has the outline nodes[offsets[c]:offsets[c + 1]]"""
    marks: Ints
    """(m,) positions where cells are cut: middles of sides of parted cells, all bends of unseen ones"""
    cell: Ints
    """(m,) cell of each mark"""
    stop: Ints
    """(m,) where the part of the outline that begins at a mark ends"""
    follower: Ints
    """(m,) the position of the next mark of the cell"""


def outlines_of(mesh: Tessellation, splitting: Splitting, kinds: Kinds, middle: Ints) -> Outlines:
    """Insert the nodes ``middle`` (n_corners,), -1 for none, after the corners of a mesh, and mark where to cut."""
    cell = cell_of_corner(mesh.offsets)
    new = middle >= 0
    place = offsets_of(1 + new)
    offsets = place[mesh.offsets]
    nodes, marked = np.empty(place[-1], dtype=np.int64), np.zeros(place[-1], dtype=bool)
    nodes[place[:-1]], nodes[place[:-1][new] + 1] = mesh.vertices, middle[new]
    marked[place[:-1]] = (kinds.parted[cell] & splitting.vertex) | (kinds.unseen[cell] & splitting.bend)
    marked[place[:-1][new] + 1] = (kinds.parted[cell] & splitting.edge)[new]
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
    counts, pieces = _pieces(outlines, cut, points)
    children = np.where(kinds.parted, marks + kinds.medial, 1)
    children[cut] = counts
    first = offsets_of(children)
    ranges = [
        (first[whole], outlines.offsets[whole], np.diff(outlines.offsets)[whole]),
        *_between_middles(outlines, kinds, first, marks),
        _middle_triangles(outlines, kinds, first, marks),
        *((first[c] + number, start, length) for c, (number, start, length) in zip(cut, pieces, strict=True)),
    ]
    cell, start, count = (np.concatenate(parts) for parts in zip(*ranges, strict=True))
    order = np.argsort(cell, kind="stable")
    centres = first_centre + np.arange(np.count_nonzero(kinds.centred))
    pool = np.concatenate([outlines.nodes, centres])
    sizes = np.bincount(cell, weights=count, minlength=first[-1]).astype(np.int64)
    vertices = pool[spans(start[order], count[order])]
    return offsets_of(sizes), vertices, np.repeat(np.arange(n_cells), children)


def _between_middles(outlines: Outlines, kinds: Kinds, first: Ints, marks: Ints) -> list[Ranges]:
    """The outline from each middle to the next one, that one, and the centre if there is one."""
    here = np.flatnonzero(kinds.parted[outlines.cell])
    cell, start = outlines.cell[here], outlines.marks[here]
    child = first[cell] + here - offsets_of(marks)[cell]
    single = np.ones(len(here), dtype=np.int64)
    with_centre = kinds.centred[cell]
    centre = len(outlines.nodes) + np.cumsum(kinds.centred) - 1
    return [
        (child, start, outlines.stop[here] - start),
        (child, outlines.follower[here], single),
        (child[with_centre], centre[cell[with_centre]], single[with_centre]),
    ]


def _middle_triangles(outlines: Outlines, kinds: Kinds, first: Ints, marks: Ints) -> Ranges:
    """The three middles of each triangle."""
    here = np.flatnonzero(kinds.medial[outlines.cell])
    return first[outlines.cell[here]] + marks[outlines.cell[here]], outlines.marks[here], np.ones_like(here)


def _pieces(outlines: Outlines, cells: Ints, points: Floats) -> tuple[Ints, list[Ranges]]:
    """Numbers of convex pieces of the given cells; for each edge of a piece its first corner, or the whole side."""
    counts, found = np.zeros(len(cells), dtype=np.int64), []
    begin = np.searchsorted(outlines.cell, cells)
    end = np.searchsorted(outlines.cell, cells, side="right")
    for k in range(len(cells)):  # cells that no point sees all of are rare
        marks, stops = outlines.marks[begin[k] : end[k]], outlines.stop[begin[k] : end[k]]
        corners = points[outlines.nodes[marks]]
        pieces = convex_pieces(corners - corners[0])
        counts[k] = len(pieces)
        start = np.concatenate(pieces)
        side = np.concatenate([np.roll(piece, -1) for piece in pieces]) == (start + 1) % len(marks)
        number = np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces])
        found.append((number, marks[start], np.where(side, stops[start] - marks[start], 1)))
    return counts, found
