"""A part of the boundary: its edges, its nodes, and what each node owns of it.

A node gets the length int phi_i ds over the part. Where the part has a corner, conditions on the normal
hold for both sides, so besides the nodes there are *rows*: one a node and distinct normal, with the share of
int phi_i ds of the edges that have this normal.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints, read_only, totals

# Normals closer than this are one. Points that were rounded a few times turn an edge by a few EPS |x| / length
# besides, and as much is granted: an edge of 1e-12 on a straight inclined side of length 1 is no corner.
SAME_NORMAL = 1e-9
# Between bodies sides that turn by less than 45 degrees are a curve, whose nodes have the mean of their normals (by
# length, as constant pressure pushes them): with both, what slides along a curve would have to climb every corner.
SMOOTH = 2.0 * float(np.sin(np.pi / 8))
ROUNDED = 4.0 * float(np.finfo(float).eps)
# Four Gauss points: int g phi_i is exact for g of degree 6 on an edge (7 for the product).
GAUSS = 4


@dataclass(frozen=True, eq=False)
class EdgeEnds:
    """The ends (q,) of edges that rows own, each named by the row and the other node of its edge."""

    row: Ints
    beyond: Ints
    """node number of the edge's other end"""
    lengths: Floats
    """half the length of the edge: int phi_i ds over it"""


@dataclass(frozen=True, eq=False)
class BoundaryRows:
    """One row a node, distinct normal and partner of a part of the boundary, ordered by node."""

    nodes: Ints
    """(k,)"""
    normals: Floats
    """(k, 2) outward unit normals, averaged by length over the edges they stand for"""
    lengths: Floats
    """(k,) int phi_i ds over the edges of this row"""
    points: Floats
    """(q, 2) Gauss points of all edges, four an edge"""
    matrix: sp.csr_matrix
    """(k, q) by which g(points) gives int g phi_i ds over the edges of each row, exact for g of degree 6 on edges"""
    ends: EdgeEnds
    """what each row stands for"""
    partners: Ints
    """(k,) nodes of other bodies at the same places; -1 where the edges are no interface"""
    cosines: Floats
    """(k,) mean of n . n_e over the edges e of each row: edges that all move out by 1 move the node by 1 over that"""

    @property
    def tangents(self) -> Floats:
        """Normals turned by +90 degrees, (k, 2): along the boundary with the body on the left."""
        return np.column_stack([-self.normals[:, 1] + 0.0, self.normals[:, 0]])


@dataclass(frozen=True, eq=False)
class BoundaryPart:
    """A closed set of boundary edges."""

    edges: Ints
    """(m, 2) each as it runs in its counter-clockwise cell, once"""
    points: Floats
    """(n_nodes, 2) the points of the whole mesh"""
    across: Ints | None = None
    """(m, 2) the nodes of other bodies that an interface joins to those of each edge; -1 for an edge of no interface"""

    @cached_property
    def chords(self) -> Floats:
        """End minus start of each edge, (m, 2)."""
        return read_only(self.points[self.edges[:, 1]] - self.points[self.edges[:, 0]])

    @cached_property
    def lengths(self) -> Floats:
        """Length of each edge, (m,)."""
        return read_only(np.sqrt(np.einsum("ea,ea->e", self.chords, self.chords)))

    @cached_property
    def normals(self) -> Floats:
        """Outward unit normal of each edge, (m, 2)."""
        return read_only(np.column_stack([self.chords[:, 1], 0.0 - self.chords[:, 0]]) / self.lengths[:, None])

    @cached_property
    def midpoints(self) -> Floats:
        """Midpoint of each edge, (m, 2)."""
        return read_only(self.points[self.edges[:, 0]] + 0.5 * self.chords)

    @cached_property
    def nodes(self) -> Ints:
        """The nodes of the edges, ascending."""
        return read_only(np.unique(self.edges))

    @cached_property
    def node_lengths(self) -> Floats:
        """int phi_i ds over the part for each of `nodes`; the sum is the length of the part."""
        place = np.searchsorted(self.nodes, self.edges)
        half = np.repeat(0.5 * self.lengths, 2)
        return read_only(totals(place.ravel(), half, len(self.nodes)))

    def gauss(self, count: int) -> tuple[Floats, Floats]:
        """Gauss points (m, count, 2) of the edges, and their shares (m, 2, count).

        These are weight times length times basis function of the first and of the second end of each edge.
        """
        node, weight = np.polynomial.legendre.leggauss(count)
        s = 0.5 + 0.5 * node
        points = self.points[self.edges[:, 0]][:, None, :] + s[:, None] * self.chords[:, None, :]
        reference = 0.5 * weight * np.stack([1.0 - s, s])
        return points, self.lengths[:, None, None] * reference

    @cached_property
    def node_normals(self) -> BoundaryRows:
        """The rows of this part: at a corner, one for each of its sides."""
        order, row = self._grouped()
        edge, side = order // 2, order % 2
        k = row.max(initial=-1) + 1
        nodes = np.empty(k, dtype=np.int64)
        nodes[row] = self.edges.ravel()[order]
        partners = np.empty(k, dtype=np.int64)
        partners[row] = self._partners[order]
        half = 0.5 * self.lengths[edge]
        normals = np.zeros((k, 2))
        np.add.at(normals, row, half[:, None] * self.normals[edge])
        sizes, lengths = np.linalg.norm(normals, axis=1), totals(row, half, k)
        normals = normals / sizes[:, None] + 0.0
        points, shares = self.gauss(GAUSS)
        columns = edge[:, None] * GAUSS + np.arange(GAUSS)
        matrix = sp.csr_matrix(
            (shares[edge, side].ravel(), (np.repeat(row, GAUSS), columns.ravel())), shape=(k, len(self.edges) * GAUSS)
        )
        return BoundaryRows(
            nodes=read_only(nodes),
            normals=read_only(normals),
            lengths=read_only(lengths),
            points=read_only(points.reshape(-1, 2)),
            matrix=matrix,
            ends=EdgeEnds(read_only(row), read_only(self.edges[edge, 1 - side]), read_only(half)),
            partners=read_only(partners),
            cosines=read_only(np.where(partners < 0, 1.0, sizes / lengths)),
        )

    @property
    def _partners(self) -> Ints:
        """Of the ends of all edges."""
        return np.full(2 * len(self.edges), -1) if self.across is None else self.across.ravel()

    def _grouped(self) -> tuple[Ints, Ints]:
        """Ends of edges (2 * edge + side) ordered by node, and the row of each: one normal and partner, one row."""
        ends = self.edges.ravel()
        length = np.repeat(self.lengths, 2)
        order = np.argsort(ends, kind="stable")
        ends, normal = ends[order], np.repeat(self.normals, 2, axis=0)[order]
        partners = self._partners[order]
        noise = ROUNDED * np.abs(self.points).max() / length[order]
        leader = np.full(len(ends), -1)
        while (waiting := np.flatnonzero(leader < 0)).size:
            first = np.searchsorted(ends[waiting], ends[waiting])
            ahead = waiting[first]
            apart = np.linalg.norm(normal[waiting] - normal[ahead], axis=1)
            far = np.where(partners[waiting] < 0, SAME_NORMAL + noise[waiting] + noise[ahead], SMOOTH)
            joins = (apart <= far) & (partners[waiting] == partners[ahead])
            leader[waiting[joins]] = ahead[joins]
        return order, np.unique(leader, return_inverse=True)[1]
