"""Children of polyhedral cells, by kinds: their faces on the skin of the cell, and those between each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vemcvx.arrays import Ints
from vemcvx.meshes.cell_kinds import CONES, OCTA, PYRAMID, TETRA, VERTICES, WEDGE, Cut, Solids
from vemcvx.meshes.cell_sides import Asked
from vemcvx.meshes.polygons import (
    cell_of_corner,
    directed_edges,
    edge_keys,
    first_in_row,
    offsets_of,
    rotation,
    rows_in_order,
    spans,
)

# Of its diameter, how far the centroid of a cell joined of several cones is at least behind the planes of its faces.
CLEAR = 0.02


# Children.


class Outer(NamedTuple):
    """New faces on the skin of old cells, for children by keys that are unique within their parent."""

    key: Ints
    listed: Ints
    row: Ints
    rows: Ints


class Inner(NamedTuple):
    """New faces between children."""

    cell: Ints
    key: Ints
    offsets: Ints
    vertices: Ints

    @classmethod
    def of(cls, cell: Ints, key: Ints, columns: Sequence[Ints]) -> Inner:
        """Faces with the same number of vertices, column by column."""
        vertices = np.column_stack(columns)
        return cls(cell, key, np.arange(len(cell) + 1) * len(columns), vertices.ravel())


def joined(parts: list[Inner]) -> Inner:
    """All of several lots."""
    counts = [np.diff(part.offsets) for part in parts]
    cell, key, vertices = (np.concatenate([getattr(p, name) for p in parts]) for name in ("cell", "key", "vertices"))
    return Inner(cell, key, offsets_of(np.concatenate(counts)), vertices)


class Keys(NamedTuple):
    """Keys of children, at each of the corners of solids."""

    vertex: Ints
    """of the child at the vertex"""
    side: Ints
    """of the child on the side"""
    inner: Ints
    """of the one child that touches no more than the middles of edges"""


def regular_children(asked: Asked, cut: Cut, solids: Solids, about: Ints) -> tuple[Outer, Inner]:
    """Children of all cells but those that stay or fall into cones; about (n_cells,) are the nodes in their centres."""
    corners, kind = solids.corners, solids.kind[solids.cell]
    many, n_listed = int(solids.vertex.max(initial=0)) + 1, len(asked.skin.cell)
    keys = Keys(solids.vertex, many + solids.side, np.full(len(kind), many + n_listed))
    parts = [
        *_about_centres(solids, keys, about),
        *_of_tetrahedra(solids, keys),
        *_of_pyramids(solids, keys),
        *_of_wedges(solids, keys),
    ]
    middle = _middle_parts(asked, cut, solids)
    tetra = solids.kind[asked.skin.cell[middle.listed]] == TETRA
    middle = middle._replace(key=many + np.where(tetra, n_listed, asked.sides.side[middle.listed]))
    outer = zip((keys.vertex, corners.listed, corners.row, corners.rows), middle, strict=True)
    both = Outer(*(np.concatenate(pair) for pair in outer))
    kept = solids.kind[asked.skin.cell[both.listed]] != CONES
    return Outer(*(values[kept] for values in both)), _with_hanging(asked, cut, joined(parts))


def _about_centres(solids: Solids, keys: Keys, about: Ints) -> list[Inner]:
    """A cell at each vertex, between its edges, halved, and the centres; of octahedra one on each side, too."""
    cell, corners, kind = solids.cell, solids.corners, solids.kind[solids.cell]
    i = np.flatnonzero(kind == VERTICES)
    quads = corners.centre[i], corners.after[i], corners.centre[solids.follower[i]], about[cell[i]]
    j = np.flatnonzero(kind == OCTA)
    ends = corners.before[j], corners.after[j]
    return [
        Inner.of(cell[i], keys.vertex[i], quads),
        Inner.of(cell[j], keys.vertex[j], (*ends, about[cell[j]])),
        Inner.of(cell[j], keys.side[j], (*ends[::-1], about[cell[j]])),
    ]


def _of_tetrahedra(solids: Solids, keys: Keys) -> list[Inner]:
    """A tetrahedron at each vertex and an octahedron between them."""
    i = solids.first[solids.kind[solids.cell[solids.first]] == TETRA]
    return _caps(solids, keys, i, 3)


def _caps(solids: Solids, keys: Keys, i: Ints, degree: int) -> list[Inner]:
    """The polygons between the middles of edges about vertices, one of whose corners are i; on both sides."""
    around = [i]
    for _ in range(degree - 1):
        around.append(solids.follower[around[-1]])
    cap, cell = [solids.corners.after[k] for k in around], solids.cell[i]
    return [Inner.of(cell, keys.vertex[i], cap), Inner.of(cell, keys.inner[i], cap[::-1])]


def _of_pyramids(solids: Solids, keys: Keys) -> list[Inner]:
    """A pyramid at each vertex, one upside down on the centre of the base, a tetrahedron on each other side."""
    cell, corners = solids.cell, solids.corners
    pyramid, triangle = solids.kind[cell] == PYRAMID, corners.centre < 0
    base, on_base = np.zeros(len(solids.kind), dtype=np.int64), np.zeros(len(cell) + 1, dtype=bool)
    quads = np.flatnonzero(pyramid & ~triangle)
    base[cell[quads]] = corners.centre[quads]
    on_base[solids.vertex[quads]] = True
    i = np.flatnonzero(pyramid & triangle)
    ends = corners.before[i], corners.after[i]
    key = np.where(on_base[solids.vertex], keys.vertex, keys.inner)
    tops = solids.first[pyramid[solids.first] & ~on_base[solids.vertex[solids.first]]]
    return [
        Inner.of(cell[i], keys.side[i], (*ends[::-1], base[cell[i]])),
        Inner.of(cell[i], key[i], (*ends, base[cell[i]])),
        *_caps(solids, keys, tops, 4),
    ]


def _of_wedges(solids: Solids, keys: Keys) -> list[Inner]:
    """Wedges below and above the middle of a wedge: at each vertex, and one between these."""
    cell, corners, side = solids.cell, solids.corners, solids.side
    i = np.flatnonzero((solids.kind[cell] == WEDGE) & (corners.centre < 0))
    to = solids.follower[i]
    one, other = corners.centre[to], corners.centre[solids.follower[to]]
    before, after = corners.before[i], corners.after[i]
    total = np.bincount(side[i], one, minlength=int(side.max(initial=0)) + 1).astype(np.int64)
    k = np.unique(side[i], return_index=True)[1]
    third = total[side[i[k]]] - one[k] - other[k]
    return [
        Inner.of(cell[i], keys.vertex[i], (before, after, one, other)),
        Inner.of(cell[i], keys.vertex[i], (one, corners.after[to], other)),
        Inner.of(cell[i], keys.side[i], (other, one, after, before)),
        Inner.of(cell[i[k]], keys.side[i[k]], (one[k], other[k], third)),
    ]


def _middle_parts(asked: Asked, cut: Cut, solids: Solids) -> Outer:
    """The middle of the four triangles of each triangular side."""
    corners, face = solids.corners, asked.skin.faces.cell_faces
    triangle = corners.centre < 0
    side, at = np.unique(solids.side[triangle], return_index=True)
    listed = corners.listed[triangle][at]
    single = asked.sides.pieces[listed] == 1
    # Of sides in four pieces, that one which has no corner of the side.
    bare, wanted = np.ones(len(face), dtype=bool), np.zeros(len(face), dtype=bool)
    bare[corners.listed] = False
    wanted[side[~single]] = True
    one, two = listed[single], np.flatnonzero(wanted[asked.sides.side] & bare)
    row = np.append(cut.first[face[one]] + 3, cut.first[face[two]])
    rows = np.append(np.ones(len(one), dtype=np.int64), np.diff(cut.first)[face[two]])
    listed = np.append(one, two)
    return Outer(np.zeros_like(listed), listed, row, rows)


def _with_hanging(asked: Asked, cut: Cut, inner: Inner) -> Inner:
    """New faces with the nodes that hang on their edges, where these are edges of pieces of sides already."""
    skin, outlines = asked.skin, cut.outlines
    pieces = np.unique(skin.faces.cell_faces[asked.sides.pieces > 1])
    if not len(pieces) or not len(inner.cell):
        return inner
    rows, position = rows_in_order(outlines.offsets, np.arange(len(outlines.nodes)), pieces)
    node = outlines.nodes[position]
    bend = np.append(skin.splitting.bend, np.zeros(len(cut.number) - len(skin.nodes), dtype=bool))[node]
    turn = rotation(rows, first_in_row(bend, rows))
    node, bend = cut.number[node[turn]], bend[turn]
    begin = np.flatnonzero(bend)
    many = np.diff(np.append(begin, len(bend))) - 1
    owner = cell_of_corner(rows)[begin]
    last = np.append(owner[1:] != owner[:-1], True)
    end = np.where(last, rows[owner], np.append(begin[1:], 0))
    kept = many > 0
    ends = np.column_stack([node[begin], node[end]])[kept]
    if not len(ends):
        return inner
    begin, many = begin[kept] + 1, many[kept]
    count = int(inner.vertices.max()) + 1
    keys, at = np.unique(edge_keys(ends, count), return_index=True)
    edges = directed_edges(inner.offsets, inner.vertices)
    wanted = edge_keys(edges, count)
    found = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    corner = np.flatnonzero(keys[found] == wanted)
    line = at[found[corner]]
    new, size = spans(begin[line], many[line]), offsets_of(many[line])
    mirrored = np.repeat(begin[line] + begin[line] + many[line] - 1, many[line]) - new
    backwards = np.repeat(ends[line, 0] != edges[corner, 0], many[line])
    vertices = np.insert(inner.vertices, np.repeat(corner + 1, many[line]), node[np.where(backwards, mirrored, new)])
    more = np.bincount(cell_of_corner(inner.offsets)[corner], many[line], minlength=len(inner.cell))
    assert size[-1] == more.sum()
    return inner._replace(offsets=offsets_of(np.diff(inner.offsets) + more.astype(np.int64)), vertices=vertices)
