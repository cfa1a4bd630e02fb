"""Parts of the boundary in the plane and in space: edges or faces, nodes, what each node owns, normals and tangents."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Bools, Floats, Ints, read_only, totals
from vemcvx.meshes import PolyhedralMesh
from vemcvx.meshes.polygons import TOLERANCE, found_in, offsets_of
from vemcvx.vem.projection import FaceGroup, face_groups, tangents_of


@dataclass(frozen=True, eq=False)
class SideRule:
    """Quadrature on sides with equally many nodes."""

    sides: Ints  #: (m,) places in the part
    nodes: Ints  #: (m, n)
    points: Floats  #: (m, q, dim)
    shares: Floats  #: (m, n, q) weights times the sides' lengths or areas times the basis function of each node


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A closed set of sides of the boundary: edges in the plane, faces in space.

    A node gets the length (in space the area) int phi_i ds over the part, with functions on faces as in
    :mod:`vemcvx.vem.projection`. Where sides meet at an angle, conditions on the normal hold for both, so besides the
    nodes there are *rows*: see :class:`BoundaryRows`.
    """

    sides: Ints
    """the edges (m, 2), each as it runs in its counter-clockwise cell, or the numbers (m,) of the faces, ascending"""
    normals: Floats  #: (m, dim) outward unit normal of each side
    measures: Floats  #: (m,) the length, or area, of each side
    rules: Callable[[int], tuple[SideRule, ...]]
    """quadrature with as many Gauss points an edge; on the triangles of a face exact for degree 5, in any case"""
    ends: SideEnds  #: the nodes of all sides, in the order of the rules

    @cached_property
    def nodes(self) -> Ints:
        """The nodes of the sides, ascending."""
        return read_only(np.unique(self.ends.nodes))

    @cached_property
    def node_lengths(self) -> Floats:
        """int phi_i ds over the part for each of `nodes`; the sum is the length, or area, of the part."""
        ends = self.ends
        return read_only(totals(np.searchsorted(self.nodes, ends.nodes), ends.lengths, len(self.nodes)))

    @property
    def names(self) -> Ints:
        """Each end of its sides (e, 2): the node, and the other node of the edge, or the number of the face."""
        return np.column_stack([self.ends.nodes, self.ends.beyond])

    @cached_property
    def node_normals(self) -> BoundaryRows:
        """The rows of this part: where sides meet at an angle, one for each normal."""
        points, blocks = [], []
        for rule in self.rules(4):  # exact for g phi_i with g of degree 6 on edges
            m, n, q = rule.shares.shape
            columns = np.repeat(np.arange(m * q).reshape(m, 1, q), n, axis=1)
            starts = np.arange(0, m * n * q + 1, q)
            points.append(rule.points.reshape(m * q, -1))
            blocks.append(sp.csr_matrix((rule.shares.ravel(), columns.ravel(), starts), shape=(m * n, m * q)))
        return self.ends.rows(np.concatenate(points), sp.csr_matrix(sp.block_diag(blocks, format="csr")))


def edge_part(
    edges: Ints,
    points: Floats,
    across: Ints | None = None,
    mirrors: MirrorPlanes | None = None,
    inside: Bools | None = None,
) -> Part:
    """The part of the boundary that edges (m, 2) make.

    Parameters
    ----------
    edges : (m, 2) array
    points : (n_nodes, 2) array
        Of the whole mesh.
    across : (m, 2) array, optional
        The nodes of other bodies that an interface joins to those of each edge; -1 for an edge of no interface.
    mirrors : MirrorPlanes, optional
        Of symmetry, at its nodes.
    inside : (m, 2) bool array, optional
        Ends in one cell alone of the body that has drawn the boundary: where it is straight there, they hang.
    """
    start, chords = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    normals, lengths = _outward(chords)

    def rules(count: int) -> tuple[SideRule, ...]:
        node, weight = np.polynomial.legendre.leggauss(count)
        s = 0.5 + 0.5 * node
        at = start[:, None, :] + s[:, None] * chords[:, None, :]
        shares = lengths[:, None, None] * (0.5 * weight * np.stack([1.0 - s, s]))
        return (SideRule(np.arange(len(edges)), edges, at, shares),)

    first, last = _drawn(edges, points, inside)
    corner = points[edges[first, 0]]
    drawn, size = _outward(points[edges[last, 1]] - corner)
    ends = SideEnds(
        nodes=edges.ravel(),
        normals=np.repeat(drawn, 2, axis=0),
        curvature=np.repeat(1.0 / size, 2),
        noise=np.repeat(TOLERANCE * np.abs(points).max() / size, 2),
        sizes=np.repeat(size, 2),
        lengths=np.repeat(0.5 * lengths, 2),
        drawn=np.repeat(np.column_stack([2 * first, 2 * last + 1]), 2, axis=0),
        share=(np.linalg.norm(points[edges] - corner[:, None], axis=2) / size[:, None]).ravel(),
        beyond=edges[:, ::-1].ravel(),
        partners=np.full(edges.size, -1) if across is None else across.ravel(),
        mirrors=mirrors,
    )
    return Part(sides=edges, normals=read_only(normals), measures=read_only(lengths), rules=rules, ends=ends)


def _outward(chords: Floats) -> tuple[Floats, Floats]:
    """The outward unit normals of edges that are these vectors (m, 2), and their lengths."""
    lengths = np.sqrt(np.einsum("ea,ea->e", chords, chords))
    return np.column_stack([chords[:, 1], 0.0 - chords[:, 0]]) / lengths[:, None], lengths


def _drawn(edges: Ints, points: Floats, inside: Bools | None) -> tuple[Ints, Ints]:
    """The first and the last edge (m,) of the straight side that each was before nodes were hung into it."""
    own = np.arange(len(edges))
    if inside is None or not inside.any():
        return own, own
    normals = _outward(points[edges[:, 1]] - points[edges[:, 0]])[0]
    after = found_in(edges[:, 0], edges[:, 1])
    straight = np.linalg.norm(normals[after] - normals, axis=1) < STRAIGHT
    hung = np.flatnonzero((after >= 0) & inside[:, 1] & inside[after, 0] & straight)
    first, last = own.copy(), own.copy()
    first[after[hung]], last[hung] = hung, after[hung]
    for _ in range(len(edges).bit_length()):
        first, last = first[first], last[last]
    # What goes round a body of one cell has no ends, and what is bent in the large was not drawn as one side.
    ends = ~np.isin(first, after[hung])
    chord = np.where(ends[:, None], points[edges[last, 1]] - points[edges[first, 0]], 1.0)
    bent = np.linalg.norm(_outward(chord)[0] - normals, axis=1) >= STRAIGHT
    ends &= ~np.isin(first, first[bent])
    return np.where(ends, first, own), np.where(ends, last, own)


def face_part(
    faces: Ints, mesh: PolyhedralMesh, across: Ints | None = None, mirrors: MirrorPlanes | None = None
) -> Part:
    """The part of the boundary that faces (m,), ascending numbers, make.

    `across` (c,) are the nodes of other bodies that an interface joins to the vertices of the faces, one face after the
    other; -1 for a face of no interface. `mirrors` are planes of symmetry at its nodes.
    """
    groups = list(face_groups(mesh.points, mesh.face_offsets, mesh.face_vertices, faces))
    placed = [(group, np.searchsorted(faces, group.faces)) for group in groups]
    vectors, outline = np.empty((len(faces), 3)), np.empty(len(faces))
    for group, at in placed:
        corners = group.corners[:, :-1]
        vectors[at] = group.vectors.sum(axis=1)
        outline[at] = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).sum(axis=1)
    areas = np.linalg.norm(vectors, axis=1)
    normals = vectors / areas[:, None] + 0.0

    def rules(count: int) -> tuple[SideRule, ...]:
        return tuple(SideRule(at, group.nodes, *group.quadrature()) for group, at in placed)

    begin = offsets_of(np.diff(mesh.face_offsets)[faces])
    corner = np.concatenate([np.ravel(begin[at][:, None] + np.arange(group.nodes.shape[1])) for group, at in placed])
    side = np.concatenate([np.repeat(at, group.nodes.shape[1]) for group, at in placed])
    ends = SideEnds(
        nodes=np.concatenate([group.nodes.ravel() for group in groups]),
        normals=normals[side],
        curvature=np.concatenate([_curvature(group).ravel() for group in groups]),
        noise=(TOLERANCE * np.abs(mesh.points).max() * outline / areas)[side],
        sizes=areas[side],
        lengths=np.concatenate([group.shares.ravel() for group in groups]),
        beyond=faces[side],
        partners=np.full(len(side), -1) if across is None else across[corner],
        mirrors=mirrors,
    )
    return Part(sides=faces, normals=read_only(normals), measures=read_only(areas), rules=rules, ends=ends)


def _curvature(group: FaceGroup) -> Floats:
    """sin(alpha) / (|a| |b|) of the edges a and b of each face at its vertices, (f, n)."""
    corners = group.corners[:, :-1]
    a, b = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    lengths = np.einsum("fni,fni->fn", a, a) * np.einsum("fni,fni->fn", b, b)
    return np.linalg.norm(np.cross(a, b), axis=2) / lengths


# Rows of a part of the boundary: one a node and distinct normal.
#
# Where a part has a corner, or an edge in space, conditions on the normal hold for all sides that meet there, each
# with the share of int phi_i ds of the sides that have its normal. Sides that turn by less than 42.5 degrees are a
# curve, or a straight side whose points are rounded, whose nodes have a mean of their normals: with both, a node
# could not slide, or would have to climb every corner, however fine the mesh is.
#
# The mean is that by 1 / length; in space by sin(alpha) / (|a| |b|), a and b being the edges of a face at the node
# and alpha their angle (N. Max, J. Graphics Tools 4 (1999)). It is exact for nodes on a circle, or a sphere, whatever
# their distances. By length, what slides along a curve of unequal sides would be pressed by forces that do not vanish
# with the mesh. Sides far shorter than those beside them have no say: rounding turns them.
#
# A curve that ends on a plane of symmetry goes on behind it as its mirror image: the mean over both is the normal
# without its component across the plane. Where the curve and its image make a corner, as the tip of a wedge does, the
# node keeps the normal of its own side: what that of the image says is the same.
#
# In the plane one body draws a curve, and another hangs nodes into its sides. Means are of sides as they were drawn,
# and along these normals go linearly from one end to the other, so that on a circle all are radial, and a ring turns in
# another. With the normals of the chords what sticks was stretched: two rings were pressed apart along directions that
# are off by up to half the angle of a chord, and so by overlap / radius times a number that no mesh makes smaller. On
# sides of 1 : .8 friction was .33 of a pressure that rippled by 6.8 % (root of the mean square) at every h; with the
# normals of the circle both are of order h. (Continuous normals: Yang, Laursen and Meng, Int. J. Numer. Meth. Engng 62
# (2005); Puso and Laursen, Comput. Methods Appl. Mech. Engrg. 193 (2004).)


CURVE = float(np.radians(42.5))  # Sides that turn by less are a curve.
SMOOTH = 2.0 * float(np.sin(0.5 * CURVE))
"""Distance of unit normals that are those of one curve: octagons and chamfers have corners, a regular nonagon is round,
however their points are rounded."""
STRAIGHT = 1e-2
"""Directions and motions that differ by less are one: no mesh is meant to resolve corners of half a degree. Sides that
turn by less at a node in one cell alone were drawn as one: straight sides with points of four digits have such."""


@dataclass(frozen=True, eq=False)
class EdgeEnds:
    """The ends (q,) of edges that rows own, each named by the row and the other node of its edge.

    In space the corners of faces, named by the row and the face.
    """

    row: Ints
    beyond: Ints  #: node number of the edge's other end; number of the face
    lengths: Floats  #: int phi_i ds over the edge, half its length; over the face


@dataclass(frozen=True, eq=False)
class MirrorPlanes:
    """Planes of symmetry at some nodes: those across the directions in which these are held."""

    nodes: Ints  #: (k,) ascending
    projections: Floats  #: (k, dim, dim) on these directions of each node, symmetric

    def across(self, vectors: Floats, nodes: Ints, partners: Ints) -> Floats:
        """The component of vectors (m, dim) across the planes that nodes share with their partners."""
        found, partners = np.zeros_like(vectors), np.where(partners < 0, nodes, partners)
        at = np.flatnonzero(np.isin(nodes, self.nodes) & np.isin(partners, self.nodes))
        one, other = (self.projections[np.searchsorted(self.nodes, which[at])] for which in (nodes, partners))
        sizes, axes = np.linalg.eigh(0.5 * (one + other))
        # Planes of two bodies that are half a degree apart are one; their projections have this mean along the
        # bisector.
        along = np.einsum("kij,ki->kj", axes, vectors[at]) * (sizes > (1.0 - 0.25 * 1e-2**2))
        found[at] = np.einsum("kij,kj->ki", axes, along)
        return found


@dataclass(frozen=True, eq=False)
class BoundaryRows:
    """One row a node, distinct normal and partner of a part of the boundary, ordered by node."""

    nodes: Ints  #: (k,)
    normals: Floats  #: (k, dim) outward unit normals, means of those of the edges or faces they stand for
    lengths: Floats  #: (k,) int phi_i ds over the edges or faces of this row
    points: Floats  #: (q, dim) quadrature points of all edges or faces
    matrix: sp.csr_matrix
    """(k, q) by which g(points) gives int g phi_i ds over the edges or faces of each row, exact for g of degree 6 on
    edges and 4 on faces"""
    ends: EdgeEnds  #: the ends of edges, in space corners of faces, that each row stands for
    partners: Ints  #: (k,) nodes of other bodies at the same places; -1 where the edges are no interface
    cosines: Floats
    """(k,) mean of n . n_e over the edges e of each row: edges that all move out by 1 move the node by 1 over that"""

    @property
    def curved(self) -> bool:
        """True if sides turn somewhere by more than a degree and a half."""
        return bool((self.cosines < np.cos(0.5 * np.radians(1.5))).any())

    @property
    def tangents(self) -> Floats:
        """(k, dim) the first tangent of each, in the plane along the boundary with the body on the left."""
        return tangents_of(self.normals)[:, 0]


@dataclass(frozen=True, kw_only=True, eq=False)
class SideEnds:
    """The nodes (e,) of all sides of a part, each with what its side gives it."""

    nodes: Ints
    normals: Floats  # (e, dim) of the sides
    curvature: Floats  # (e,) by which the normals of a curve are averaged: see above
    noise: Floats  # (e,) by which rounding may have turned the side
    sizes: Floats  # (e,) the length of the side as it was drawn, in space the area
    lengths: Floats  # (e,) int phi_i ds over the side
    beyond: Ints  # (e,) what tells the sides of a node apart
    partners: Ints  # (e,)
    drawn: Ints | None = None  # (e, 2) the ends, among these, of the side as it was drawn; None if nothing hangs
    share: Floats | None = None  # (e,) the part of that side that is ahead of the node
    mirrors: MirrorPlanes | None = None

    def rows(self, points: Floats, matrix: sp.csr_matrix) -> BoundaryRows:
        """The rows; `matrix` (e, q) gives int g phi_i ds over each end's side from g at points (q, dim)."""
        order, row = self._grouped()
        k = row.max(initial=-1) + 1
        nodes, partners = np.empty(k, dtype=np.int64), np.empty(k, dtype=np.int64)
        nodes[row], partners[row] = self.nodes[order], self.partners[order]
        lengths, total = self.lengths[order], totals(row, self.lengths[order], k)
        normals = np.zeros((k, self.normals.shape[1]))
        np.add.at(normals, row, self._weights(order, row, k)[:, None] * self.normals[order])
        normals = normals / np.linalg.norm(normals, axis=1)[:, None] + 0.0
        if self.mirrors is not None:
            noise = np.zeros(k)
            np.maximum.at(noise, row, self.noise[order])
            normals = _continued(normals, self.mirrors.across(normals, nodes, partners), noise)
        normals = self._along_drawn(normals, order, row)
        along = totals(row, lengths * np.einsum("ei,ei->e", normals[row], self.normals[order]), k)
        each = matrix[order].tocoo()
        return BoundaryRows(
            nodes=read_only(nodes),
            normals=read_only(normals),
            lengths=read_only(total),
            points=read_only(points),
            matrix=sp.csr_matrix((each.data, (row[each.row], each.col)), shape=(k, len(points))),
            ends=EdgeEnds(read_only(row), read_only(self.beyond[order]), read_only(lengths)),
            partners=read_only(partners),
            cosines=read_only(np.where(along < (1.0 - TOLERANCE) * total, along / total, 1.0)),
        )

    def _weights(self, order: Ints, row: Ints, k: int) -> Floats:
        """By which the normals of ends that make k rows are averaged, (e,)."""
        length, curvature = self.sizes[order], self.curvature[order]
        longest, most = np.zeros(k), np.zeros(k)
        np.maximum.at(longest, row, length)
        np.maximum.at(most, row, curvature)
        part = (length / longest[row]) ** 4
        # Where no face has an angle at a node that hangs in its edges, areas count alone.
        share = np.divide(curvature, most[row], out=np.zeros_like(curvature), where=most[row] > 0)
        # Sides that are shorter by more, in parts of the longest at their node, hardly count in mean normals.
        return share * part / (part + 0.03**4) + TOLERANCE * part

    def _along_drawn(self, normals: Floats, order: Ints, row: Ints) -> Floats:
        """Normals (k, dim) of rows, between those at the ends of the drawn sides where nodes hang in these."""
        if self.drawn is None or self.share is None:
            return normals
        (one, other), share = self.drawn.T, self.share[:, None]
        place = np.empty_like(row)
        place[order] = row
        start, stop = normals[place[one]], normals[place[other]]
        turns = np.linalg.norm(stop - start, axis=1) > self.noise[one] + self.noise[other]
        here = np.arange(len(order))
        hung = np.flatnonzero(turns & (here != one) & (here != other))
        between = ((1.0 - share) * start + share * stop)[hung]
        found = normals.copy()
        found[place[hung]] = between / np.linalg.norm(between, axis=1)[:, None] + 0.0
        return found

    def _grouped(self) -> tuple[Ints, Ints]:
        """The ends ordered by node, and the row of each: one normal and partner, one row."""
        order = np.argsort(self.nodes, kind="stable")
        leader = np.full(len(order), -1)
        while (waiting := np.flatnonzero(leader < 0)).size:
            mine = self.nodes[order[waiting]]
            ahead = waiting[np.searchsorted(mine, mine)]
            one, other = order[waiting], order[ahead]
            apart = np.linalg.norm(self.normals[one] - self.normals[other], axis=1)
            near = apart <= SMOOTH + self.noise[one] + self.noise[other]
            joins = near & (self.partners[one] == self.partners[other])
            leader[waiting[joins]] = ahead[joins]
        return order, np.unique(leader, return_inverse=True)[1]


def _continued(normals: Floats, across: Floats, noise: Floats) -> Floats:
    """Normals (k, dim) with their mirror images, which are twice their components `across` the plane away from them."""
    turn, rounding = 2.0 * np.linalg.norm(across, axis=1), 2.0 * noise
    smooth = (turn > rounding) & (turn <= SMOOTH + rounding)
    mean = normals[smooth] - across[smooth]
    found = normals.copy()
    found[smooth] = mean / np.linalg.norm(mean, axis=1)[:, None] + 0.0
    return found
