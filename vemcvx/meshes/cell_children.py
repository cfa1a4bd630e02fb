"""Children of polyhedral cells: their faces on the skin of the cell, and those between each other.

Cells of most kinds are cut about their vertices. All others fall into cones, a child each: their new faces joined to
the centre of the cell. Faces that are tiny, or have a tiny edge, would give needles: all new faces about a tiny edge
are one group, with one child. Faces of a side in pieces that are none of the parts into which it would be split, as
where tilings of two bodies meet askew, are grouped by the nearest corner of the side, so that slivers go with their
neighbours. A group becomes one child if the centroid of that child sees all of it; if not, a smaller group is tried, or
the whole side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vemcvx.base.arrays import SINGLE, Bools, Floats, Ints
from vemcvx.meshes.cell_kinds import CONES, OCTA, PYRAMID, TETRA, VERTICES, WEDGE, Cut, Solids
from vemcvx.meshes.cell_sides import TINY, Asked, CellSides, Skin
from vemcvx.meshes.polygons import (
    all_found_in,
    cell_of_corner,
    directed_edges,
    edge_keys,
    first_in_row,
    least_of_each,
    next_corner,
    offsets_of,
    rotation,
    rounding,
    rows_in_order,
    smallest_linked,
    spans,
    turned,
    with_hanging,
)
from vemcvx.meshes.polyhedra import face_shapes, volumes_and_centroids


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
    """The children of several lots together."""
    counts = [np.diff(part.offsets) for part in parts]
    cell, key, vertices = (np.concatenate([getattr(p, name) for p in parts]) for name in ("cell", "key", "vertices"))
    return Inner(cell, key, offsets_of(np.concatenate(counts)), vertices)


class Keys(NamedTuple):
    """Keys of children, at each of the corners of solids."""

    vertex: Ints  # of the child at the vertex
    side: Ints  # of the child on the side
    inner: Ints  # of the one child that touches no more than the middles of edges


def regular_children(asked: Asked, cut: Cut, solids: Solids, about: Ints) -> tuple[Outer, Inner]:
    """Children of all cells but those that stay or fall into cones; about (n_cells,) are the nodes in their centres."""
    corners, kind = solids.corners, solids.kind[solids.cell]
    many, n_listed = int(solids.vertex.max(initial=0)) + 1, len(asked.skin.cell)
    keys = Keys(solids.vertex, many + solids.side, np.full(len(kind), many + n_listed))
    tetrahedra = solids.first[kind[solids.first] == TETRA]  # each has one at each vertex, and an octahedron between
    parts = [
        *_about_centres(solids, keys, about),
        *_caps(solids, keys, tetrahedra, 3),
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
    ends, begin, many = np.column_stack([node[begin], node[end]])[kept], begin[kept] + 1, many[kept]
    hung = with_hanging((inner.offsets, inner.vertices), ends, offsets_of(many), node[spans(begin, many)])
    return Inner(inner.cell, inner.key, *hung)


# Of its diameter, how far the centroid of a child over several faces is at least behind the planes of its faces.
CLEAR = 0.02


@dataclass(frozen=True, eq=False)
class Cones:
    """New faces of cells that are joined to their centres, outwards."""

    points: Floats  # of all nodes, those in the centres of cells included
    listed: Ints
    row: Ints
    cell: Ints
    offsets: Ints
    nodes: Ints
    of: Ints  # (m,) the new face of each corner
    partner: Ints  # (m,) the corner that starts the same edge of the other new face of the cell that has it
    top: Ints  # (n_rows,) the node in the centre of the cell

    @classmethod
    def laid(cls, skin: Skin, cut: Cut, solids: Solids, about: Ints) -> Cones:
        """Lay out the new faces of cells that fall into cones."""
        listed = np.flatnonzero(solids.kind[skin.cell] == CONES)
        face = skin.faces.cell_faces[listed]
        counts = np.diff(cut.first)[face]
        row, listed = spans(cut.first[face], counts), np.repeat(listed, counts)
        offsets, nodes = rows_in_order(cut.offsets, cut.vertices, row)
        nodes = turned(offsets, nodes, skin.signs[listed] < 0.0)
        of, cell = cell_of_corner(offsets), skin.cell[listed]
        keys = edge_keys(directed_edges(offsets, nodes), len(cut.points))
        order = np.lexsort((keys, cell[of])).reshape(-1, 2)
        partner = np.empty(len(nodes), dtype=np.int64)
        partner[order] = order[:, ::-1]
        return cls(
            points=np.concatenate([cut.points, solids.centre[about >= 0]]),
            listed=listed,
            row=row,
            cell=cell,
            offsets=offsets,
            nodes=nodes,
            of=of,
            partner=partner,
            top=about[cell],
        )

    def between(self, label: Ints) -> Inner:
        """The faces between children, which are labels of new faces: triangles on lines between two of these."""
        edge = np.flatnonzero(label[self.of] != label[self.of[self.partner]])
        if not len(edge):
            return Inner(edge, edge, np.zeros(1, dtype=np.int64), edge)
        start, end = self.nodes[edge], self.nodes[next_corner(self.offsets)[edge]]
        owner = self.of[edge]
        mine, count = label[owner], len(self.points)
        chain, along = self._lines(edge, np.column_stack([start, end]), mine * count)
        last = np.lexsort((along, chain))
        last = last[np.append(np.diff(chain[last]) != 0, len(last) > 0)[: len(last)]]
        ends = chain[last]
        order = np.lexsort(
            (
                np.concatenate([along, np.full(len(ends), np.inf), np.full(len(ends), np.inf)]),
                np.repeat([0, 1, 2], [len(edge), len(ends), len(ends)]),
                np.concatenate([chain, ends, ends]),
            )
        )
        nodes = np.concatenate([start, end[last], self.top[owner[last]]])[order]
        offsets = offsets_of(np.bincount(chain, minlength=len(edge))[ends] + 2)
        nodes = turned(offsets, nodes, np.ones(len(ends), dtype=bool))
        return Inner(self.cell[owner[last]], mine[last], offsets, nodes)

    def _lines(self, edge: Ints, ends: Ints, key: Ints) -> tuple[Ints, Floats]:
        """Edges in one line between the same two children, by the number of one of them, and places along this."""
        at, degree = np.unique(
            self.cell[self.of[edge]] * len(self.points) + ends[:, 0], return_inverse=True, return_counts=True
        )[1:]
        number = np.argsort(key + ends[:, 0])
        keys = (key + ends[:, 0])[number]
        follower = number[np.minimum(np.searchsorted(keys, key + ends[:, 1]), len(keys) - 1)]
        step = self.points[ends[:, 1]] - self.points[ends[:, 0]]
        length = np.linalg.norm(step, axis=1)
        sine = np.linalg.norm(np.cross(step, step[follower]), axis=1)
        slack = SINGLE * length * length[follower] + rounding(self.points[ends[:, 0]]) * (length + length[follower])
        straight = (sine <= slack) & (np.einsum("ij,ij->i", step, step[follower]) > 0.0) & (degree[at[follower]] == 2)
        chain = smallest_linked(np.column_stack([np.flatnonzero(straight), follower[straight]]), len(edge))
        arm = self.points[ends[:, 0]] - self.points[ends[chain, 0]]
        return chain, np.einsum("ij,ij->i", arm, step[chain])

    def around_tiny_edges(self, tiny: Floats, free: Bools) -> Ints:
        """Labels of new faces: the free ones about edges shorter than what is tiny in a cell have one."""
        keys, at = np.unique(self.cell[self.of] * len(self.points) + self.nodes, return_inverse=True)
        follow = next_corner(self.offsets)
        length = np.linalg.norm(self.points[self.nodes[follow]] - self.points[self.nodes], axis=1)
        short = length < tiny[self.cell[self.of]]
        close = smallest_linked(np.column_stack([at[short], at[follow[short]]]), len(keys))
        several = (np.bincount(close, minlength=len(keys)) > 1)[close[at]] & free[self.of]
        links = np.column_stack([self.of[several], len(self.row) + close[at[several]]])
        return smallest_linked(links, len(self.row) + len(keys))[: len(self.row)]

    def connected(self, group: Ints) -> Ints:
        """Labels of new faces that hang together and are of one group."""
        one, other = self.of, self.of[self.partner]
        same = (group[one] == group[other]) & (self.cell[one] == self.cell[other])
        return smallest_linked(np.column_stack([one[same], other[same]]), len(self.row))


def cones(asked: Asked, cut: Cut, solids: Solids, about: Ints) -> tuple[Outer, Inner]:
    """Children of cells that are joined to their centres."""
    if not (solids.kind == CONES).any():
        nothing = np.empty(0, dtype=np.int64)
        return Outer(*[nothing] * 4), Inner(nothing, nothing, np.zeros(1, dtype=np.int64), nothing)
    found = Cones.laid(asked.skin, cut, solids, about)
    label = _grouped(found, asked)
    for part in TINY / 4.0 ** np.arange(4):  # fewer together where not all is seen
        alone = np.bincount(label, minlength=len(label))[label] == 1
        wider = np.where(alone, found.around_tiny_edges(part * asked.skin.sizes, alone), label)
        label = np.where(_unseen(found, wider)[wider], label, wider)
    return Outer(label, found.listed, found.row, np.ones_like(label)), found.between(label)


def _grouped(found: Cones, asked: Asked) -> Ints:
    """Labels of new faces by the piece, or the nearest corner, of a side in several pieces; else by the side."""
    skin, sides, own = asked.skin, asked.sides, np.arange(len(found.row))
    several = sides.pieces[found.listed] > 1
    if not several.any():
        return own
    side, big = sides.side[found.listed], len(skin.points) + 1
    alone = (own + 1) * big * len(skin.cell)
    group = np.where(several, found.listed * big, alone)
    askew = np.flatnonzero(several & ~asked.parted[found.listed])
    group[askew] = side[askew] * big + 1 + _nearest_corners(found, sides, skin, askew)
    label = found.connected(group)
    bad = _unseen(found, label, several)[label] & several
    if bad.any():
        whole = np.zeros(len(skin.cell), dtype=bool)
        whole[side[bad]] = True
        label = found.connected(np.where(whole[side], side * big, group))
        label = np.where(_unseen(found, label)[label], own, label)
    return label


def _nearest_corners(found: Cones, sides: CellSides, skin: Skin, some: Ints) -> Ints:
    """The corner of its side, a node, that is nearest to the centroid of each of some new faces."""
    listed = np.unique(found.listed[some])
    rows, corners = rows_in_order(sides.rows, sides.corners, listed)
    owner, node = sides.side[listed][cell_of_corner(rows)], skin.nodes[corners]
    ends = sides.degree(skin.cell[owner], node, len(skin.points)) > 2
    side, node = np.divmod(np.unique(owner[ends] * len(skin.points) + node[ends]), len(skin.points))
    of, pairs = all_found_in(side, sides.side[found.listed[some]])
    middle = face_shapes(found.points, *rows_in_order(found.offsets, found.nodes, some)).centroids
    away = np.linalg.norm(found.points[node[pairs]] - middle[of], axis=1)
    first = least_of_each(of, away)
    nearest = np.zeros(len(some), dtype=np.int64)
    nearest[of[first]] = node[pairs[first]]
    return nearest


def _unseen(found: Cones, label: Ints, also: Bools | None = None) -> Bools:
    """A mask of the labels of several new faces, and of some others, whose child its centroid does not see all of."""
    inner = found.between(label)
    many, bad = np.bincount(label, minlength=len(label)) > 1, np.zeros(len(label), dtype=bool)
    if also is not None:
        many[label[also]] = True
    alone = np.ones(len(label), dtype=bool)
    alone[inner.key] = False
    bad[label[alone[label]]] = True  # all of the cell
    many &= ~bad
    one, other = np.flatnonzero(many[label]), np.flatnonzero(many[inner.key])
    if not len(one):
        return bad
    rows, nodes = rows_in_order(found.offsets, found.nodes, one)
    more, others = rows_in_order(inner.offsets, inner.vertices, other)
    key = np.append(label[one], inner.key[other])
    order = np.argsort(key, kind="stable")
    rows, nodes = rows_in_order(np.concatenate([rows, rows[-1] + more[1:]]), np.append(nodes, others), order)
    names, counts = np.unique(key, return_counts=True)
    shapes, offsets = face_shapes(found.points, rows, nodes), offsets_of(counts)
    volumes, centroids = volumes_and_centroids(shapes, offsets, np.arange(len(key)), np.ones(len(key)))
    of = cell_of_corner(offsets)
    arm = shapes.centroids - centroids[of]
    size = np.sqrt(np.maximum.reduceat(np.einsum("ij,ij->i", arm, arm), offsets[:-1]))
    low = np.minimum.reduceat(np.einsum("ij,ij->i", arm, shapes.normals), offsets[:-1])
    bad[names] = (low < CLEAR * size) | (volumes <= 0.0)
    return bad
