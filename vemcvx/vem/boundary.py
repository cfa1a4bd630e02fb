"""Parts of the boundary. A *side* is an edge in the plane, or a face in space.

The basis function phi_i is 1 at node i, 0 at all other nodes, and linear on edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Bools, Floats, Ints, read_only, totals
from vemcvx.meshes import PolyhedralMesh
from vemcvx.meshes.polygons import TOLERANCE, find_in, offsets_of
from vemcvx.vem.projection import FaceGroup, face_groups, tangents_of


@dataclass(frozen=True, eq=False)
class SideRule:
    """A quadrature rule on m sides with n nodes each.

    ``shares[k, j] @ f(points[k])`` is the integral of f phi_i over side k, for i = ``nodes[k, j]``.
    """

    sides: Ints
    nodes: Ints
    points: Floats
    shares: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A set of sides of the boundary: edges in the plane, faces in space.

    A node at a corner has several *rows*, one per normal: see :class:`BoundaryRows`.

    Examples
    --------
    >>> part = vx.vem.Space(vx.meshes.squares(2)).part("left", "example")
    >>> print(part.measures, part.node_lengths)
    [0.5 0.5] [0.25 0.5  0.25]
    """

    sides: Ints  # (m, 2) nodes of edges, with the cell on the left; or (m,) ascending face numbers
    normals: Floats  # (m, dim) outward unit normals of sides
    measures: Floats  # (m,) lengths or areas of sides
    rules: Callable[[int], tuple[SideRule, ...]]  # Gauss points per edge -> rules (on faces always of degree 5)
    ends: SideEnds  # ends of the sides, in the order of `rules`

    @cached_property
    def nodes(self) -> Ints:
        """The nodes of the sides, ascending."""
        return read_only(np.unique(self.ends.nodes))

    @cached_property
    def node_lengths(self) -> Floats:
        """The integral int phi_i ds over the part, for each node i in `nodes`."""
        ends = self.ends
        return read_only(totals(np.searchsorted(self.nodes, ends.nodes), ends.lengths, len(self.nodes)))

    @property
    def names(self) -> Ints:
        """The ends (e, 2) of sides: a node and the other node of the edge, or a node and the face."""
        return np.column_stack([self.ends.nodes, self.ends.beyond])

    @cached_property
    def node_normals(self) -> BoundaryRows:
        """The rows of this part."""
        points, blocks = [], []
        for rule in self.rules(4):  # exact for degree 7 on edges
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
    *,
    axisymmetric: bool = False,
) -> Part:
    """Return the part of the boundary with the edges (m, 2), which have cells on the left.

    `across` (m, 2) is the coinciding node of another body, or -1. `inside` (m, 2) is True for nodes of a single
    cell; on interfaces, cells of the second body do not count. If the boundary is straight at a node of a single cell,
    the node is a hanging node. In bodies of revolution, lengths have the factor 2 pi r.
    """
    start, chords = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    normals, lengths = _outward(chords)
    # The depth (m, 2) of the body at nodes is 2 pi r or 1.
    r = points[edges, 0]
    depth = 2.0 * np.pi * r * (r > SAME * points[:, 0].max()) if axisymmetric else np.ones(edges.shape)
    node_lengths = 0.5 * lengths[:, None] * ((2.0 * depth + depth[:, ::-1]) / 3.0)

    def rules(count: int) -> tuple[SideRule, ...]:
        node, weight = np.polynomial.legendre.leggauss(count)
        s = 0.5 + 0.5 * node
        at = start[:, None, :] + s[:, None] * chords[:, None, :]
        shares = lengths[:, None, None] * (0.5 * weight * np.stack([1.0 - s, s]))
        shares = shares * (depth[:, :1] + s * (depth[:, 1:] - depth[:, :1]))[:, None, :]
        return (SideRule(np.arange(len(edges)), edges, at, shares),)

    first, last = _find_whole_sides(edges, points, inside)
    corner = points[edges[first, 0]]
    whole_normals, size = _outward(points[edges[last, 1]] - corner)
    ends = SideEnds(
        nodes=edges.ravel(),
        normals=np.repeat(whole_normals, 2, axis=0),
        curvature=np.repeat(1.0 / size, 2),
        noise=np.repeat(TOLERANCE * np.abs(points).max() / size, 2),
        sizes=np.repeat(size, 2),
        lengths=node_lengths.ravel(),
        whole_sides=np.repeat(np.column_stack([2 * first, 2 * last + 1]), 2, axis=0),
        position=(np.linalg.norm(points[edges] - corner[:, None], axis=2) / size[:, None]).ravel(),
        beyond=edges[:, ::-1].ravel(),
        partners=np.full(edges.size, -1) if across is None else across.ravel(),
        mirrors=mirrors,
    )
    measures = read_only(node_lengths.sum(axis=1))
    return Part(sides=edges, normals=read_only(normals), measures=measures, rules=rules, ends=ends)


def _outward(chords: Floats) -> tuple[Floats, Floats]:
    """Return the outward unit normals and the lengths of edges."""
    lengths = np.sqrt(np.einsum("ea,ea->e", chords, chords))
    return np.column_stack([chords[:, 1], 0.0 - chords[:, 0]]) / lengths[:, None], lengths


def _find_whole_sides(edges: Ints, points: Floats, inside: Bools | None) -> tuple[Ints, Ints]:
    """Return the first and last edge of the straight chain through each edge."""
    own = np.arange(len(edges))
    if inside is None or not inside.any():
        return own, own
    normals = _outward(points[edges[:, 1]] - points[edges[:, 0]])[0]
    after = find_in(edges[:, 0], edges[:, 1])
    straight = np.linalg.norm(normals[after] - normals, axis=1) < DIRECTION_TOLERANCE
    hung = np.flatnonzero((after >= 0) & inside[:, 1] & inside[after, 0] & straight)
    first, last = own.copy(), own.copy()
    first[after[hung]], last[hung] = hung, after[hung]
    for _ in range(len(edges).bit_length()):
        first, last = first[first], last[last]
    # Leave out chains that are closed, or not straight as a whole.
    ends = ~np.isin(first, after[hung])
    chord = np.where(ends[:, None], points[edges[last, 1]] - points[edges[first, 0]], 1.0)
    bent = np.linalg.norm(_outward(chord)[0] - normals, axis=1) >= DIRECTION_TOLERANCE
    ends &= ~np.isin(first, first[bent])
    return np.where(ends, first, own), np.where(ends, last, own)


def face_part(
    faces: Ints, mesh: PolyhedralMesh, across: Ints | None = None, mirrors: MirrorPlanes | None = None
) -> Part:
    """Return the part of the boundary with the ascending faces (m,).

    `across` has a number for each vertex of the faces: the coinciding node of another body, or -1.
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
    """Return sin(alpha) / (|a| |b|) (f, n) for adjacent edges a, b at the angle alpha."""
    corners = group.corners[:, :-1]
    a, b = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    lengths = np.einsum("fni,fni->fn", a, a) * np.einsum("fni,fni->fn", b, b)
    return np.linalg.norm(np.cross(a, b), axis=2) / lengths


# Rows of a part of the boundary: one per node and distinct normal (docs/signs.md, "Corners and curves").
#
# Neighbouring sides form a curve if the normals differ by less than 42.5 degrees. A node on a curve has one normal,
# because a node with two normals could not slide along the curve. This normal is a mean over sides, with the weights
# 1 / length. In space, a face has the weight sin(alpha) / (|a| |b|), with the angle alpha between the edges a and b at
# the node (N. Max, J. Graphics Tools 4 (1999)). On a circle or a sphere, the mean is exact.
#
# In the plane, a hanging node divides a *whole side* into sides. Means are taken over whole sides. The normal at a
# hanging node is interpolated between the ends of the whole side. Without interpolation, friction and pressure in a
# press fit would oscillate at every h (Yang, Laursen, Meng, Int. J. Numer. Meth. Engng 62 (2005)).
CURVE_ANGLE = float(np.radians(42.5))  # between 40 degrees (regular nonagon) and 45 degrees (octagon, chamfer)
CURVE_DISTANCE = 2.0 * float(np.sin(0.5 * CURVE_ANGLE))  # largest distance between neighbouring unit normals of a curve
DIRECTION_TOLERANCE = 1e-2  # unit vectors with a smaller distance (0.57 degrees) count as equal


@dataclass(frozen=True, eq=False)
class EdgeEnds:
    """The ends of edges, or in space the corners of faces, with row numbers."""

    row: Ints
    beyond: Ints
    lengths: Floats


@dataclass(frozen=True, eq=False)
class MirrorPlanes:
    """Planes of symmetry at nodes, with projections onto the normals of the planes."""

    nodes: Ints
    projections: Floats

    def across(self, vectors: Floats, nodes: Ints, partners: Ints) -> Floats:
        """Project vectors (m, dim) onto the normals of common planes of symmetry."""
        found, partners = np.zeros_like(vectors), np.where(partners < 0, nodes, partners)
        at = np.flatnonzero(np.isin(nodes, self.nodes) & np.isin(partners, self.nodes))
        one, other = (self.projections[np.searchsorted(self.nodes, which[at])] for which in (nodes, partners))
        sizes, axes = np.linalg.eigh(0.5 * (one + other))
        # At the angle t between two normals, `0.5 * (one + other)` has the eigenvalue cos(t / 2)^2, about 1 - t^2 / 4.
        along = np.einsum("kij,ki->kj", axes, vectors[at]) * (sizes > (1.0 - 0.25 * DIRECTION_TOLERANCE**2))
        found[at] = np.einsum("kij,kj->ki", axes, along)
        return found


@dataclass(frozen=True, eq=False)
class BoundaryRows:
    """The rows of a part of the boundary, one per node, normal and partner, ordered by node.

    Attributes
    ----------
    nodes : (k,) array of int
    normals : (k, dim) array
        Outward unit normals, averaged over the edges or faces of the row.
    lengths : (k,) array
        int phi_i ds over the edges or faces of the row, with the basis function phi_i of the node.
    points : (q, dim) array
        Quadrature points of all edges or faces.
    matrix : (k, q) csr_matrix
        ``matrix @ g(points)`` is int g phi_i ds. It is exact for g of degree 6 on edges, 5 in bodies of
        revolution, and 4 on faces.
    ends : EdgeEnds
        The ends of edges, or in space the corners of faces, with row numbers.
    partners : (k,) array of int
        Coinciding nodes of other bodies, or -1.
    cosines : (k,) array
        Mean of n . n_e over the edges e of the row, with the normals n of the row and n_e of the edge. If all edges
        move outwards by 1, the node moves by 1 / cosine.

    Examples
    --------
    >>> rows = vx.vem.Space(vx.meshes.squares(1)).part(["left", "bottom"], "example").node_normals
    >>> print(rows.nodes, rows.lengths)
    [0 0 1 2] [0.5 0.5 0.5 0.5]
    """

    nodes: Ints
    normals: Floats
    lengths: Floats
    points: Floats
    matrix: sp.csr_matrix
    ends: EdgeEnds
    partners: Ints
    cosines: Floats

    @property
    def curved(self) -> bool:
        """True if the sides turn by more than 1.5 degrees at some node."""
        return bool((self.cosines < np.cos(0.5 * np.radians(1.5))).any())

    @property
    def tangents(self) -> Floats:
        """The first tangents (k, dim) of rows. In the plane, the body is on the left."""
        return tangents_of(self.normals)[:, 0]


@dataclass(frozen=True, kw_only=True, eq=False)
class SideEnds:
    """The ends (e,) of all sides, one per side and node."""

    nodes: Ints
    normals: Floats  # (e, dim) normals of the whole sides
    curvature: Floats  # (e,) weights of normals: 1 / length, or sin(alpha) / (|a| |b|)
    noise: Floats  # (e,) largest angle by which rounding turns the side
    sizes: Floats  # (e,) length or area of the whole side
    lengths: Floats  # (e,) int phi_i ds over the side
    beyond: Ints  # (e,) the other node of the edge, or the number of the face
    partners: Ints  # (e,) coinciding nodes of other bodies, or -1
    whole_sides: Ints | None = None  # (e, 2) positions of both ends of the whole side in these arrays
    position: Floats | None = None  # (e,) position of the node on the whole side, from 0 to 1
    mirrors: MirrorPlanes | None = None

    def rows(self, points: Floats, matrix: sp.csr_matrix) -> BoundaryRows:
        """Return the rows. `matrix` maps g(points) to int g phi_i ds."""
        row, order = self._group_ends(), np.argsort(self.nodes, kind="stable")
        k = row.max(initial=-1) + 1
        nodes, partners = np.empty(k, dtype=np.int64), np.empty(k, dtype=np.int64)
        nodes[row], partners[row] = self.nodes, self.partners
        total, normals = totals(row, self.lengths, k), np.zeros((k, self.normals.shape[1]))
        np.add.at(normals, row, self._weights(row, k)[:, None] * self.normals)
        normals = normals / np.linalg.norm(normals, axis=1)[:, None] + 0.0
        if self.mirrors is not None:
            noise = np.zeros(k)
            np.maximum.at(noise, row, self.noise)
            normals = _mirror_normals(normals, self.mirrors.across(normals, nodes, partners), noise)
        normals = self._interpolate_normals(normals, row)
        along = totals(row, self.lengths * np.einsum("ei,ei->e", normals[row], self.normals), k)
        each = matrix.tocoo()
        return BoundaryRows(
            nodes=read_only(nodes),
            normals=read_only(normals),
            lengths=read_only(total),
            points=read_only(points),
            matrix=sp.csr_matrix((each.data, (row[each.row], each.col)), shape=(k, len(points))),
            ends=EdgeEnds(read_only(row[order]), read_only(self.beyond[order]), read_only(self.lengths[order])),
            partners=read_only(partners),
            cosines=read_only(np.divide(along, total, out=np.ones(k), where=along < (1.0 - TOLERANCE) * total)),
        )

    def _weights(self, row: Ints, k: int) -> Floats:
        """Return the weights (e,) of side normals in the normals of k rows."""
        longest, most = np.zeros(k), np.zeros(k)
        np.maximum.at(longest, row, self.sizes)
        np.maximum.at(most, row, self.curvature)
        part = (self.sizes / longest[row]) ** 4
        # At hanging nodes of faces, all curvatures are zero, and only areas count.
        relative = np.divide(self.curvature, most[row], out=np.zeros(len(row)), where=most[row] > 0)
        # Sides shorter than 0.03 of the longest side at the node have almost no weight.
        return relative * part / (part + 0.03**4) + TOLERANCE * part

    def _interpolate_normals(self, normals: Floats, row: Ints) -> Floats:
        """Return the normals (k, dim), interpolated at hanging nodes."""
        if self.whole_sides is None or self.position is None:
            return normals
        (one, other), s = self.whole_sides.T, self.position[:, None]
        start, stop = normals[row[one]], normals[row[other]]
        turns = np.linalg.norm(stop - start, axis=1) > self.noise[one] + self.noise[other]
        here = np.arange(len(row))
        hung = np.flatnonzero(turns & (here != one) & (here != other))
        between = ((1.0 - s) * start + s * stop)[hung]
        found = normals.copy()
        found[row[hung]] = between / np.linalg.norm(between, axis=1)[:, None] + 0.0
        return found

    def _group_ends(self) -> Ints:
        """Return the row numbers (e,) of ends."""
        order = np.argsort(self.nodes, kind="stable")
        leader = np.full(len(order), -1)
        while (waiting := np.flatnonzero(leader < 0)).size:
            mine = self.nodes[order[waiting]]
            ahead = waiting[np.searchsorted(mine, mine)]
            one, other = order[waiting], order[ahead]
            apart = np.linalg.norm(self.normals[one] - self.normals[other], axis=1)
            near = apart <= CURVE_DISTANCE + self.noise[one] + self.noise[other]
            joins = near & (self.partners[one] == self.partners[other])
            leader[waiting[joins]] = ahead[joins]
        row = np.empty_like(order)
        row[order] = np.unique(leader, return_inverse=True)[1]
        return row


def _mirror_normals(normals: Floats, across: Floats, noise: Floats) -> Floats:
    """Return the means (k, dim) of normals and nearby mirror images."""
    turn, rounding = 2.0 * np.linalg.norm(across, axis=1), 2.0 * noise
    smooth = (turn > rounding) & (turn <= CURVE_DISTANCE + rounding)
    mean = normals[smooth] - across[smooth]
    found = normals.copy()
    found[smooth] = mean / np.linalg.norm(mean, axis=1)[:, None] + 0.0
    return found
