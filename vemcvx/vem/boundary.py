"""A part of the boundary: its edges, its nodes, and what each node owns of it.

A node gets the length int phi_i ds over the part. Where the part has a corner, conditions on the normal
hold for both sides, so besides the nodes there are *rows*: see :mod:`vemcvx.vem.rows`. In space parts are made of
faces, :mod:`vemcvx.vem.face_part`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints, read_only, totals
from vemcvx.vem.rows import NORMAL_ROUNDING, BoundaryRows, MirrorPlanes, SideEnds

# Four Gauss points: int g phi_i is exact for g of degree 6 on an edge (7 for the product).
GAUSS = 4


@dataclass(frozen=True, eq=False)
class SideRule:
    """Quadrature on sides with equally many nodes."""

    sides: Ints
    """(m,) places in the part"""
    nodes: Ints
    """(m, n)"""
    points: Floats
    """(m, q, dim)"""
    shares: Floats
    """(m, n, q) weights times the sides' lengths or areas times the basis function of each node"""


@dataclass(frozen=True, eq=False)
class BoundaryPart:
    """A closed set of boundary edges."""

    edges: Ints
    """(m, 2) each as it runs in its counter-clockwise cell, once"""
    points: Floats
    """(n_nodes, 2) the points of the whole mesh"""
    across: Ints | None = None
    """(m, 2) the nodes of other bodies that an interface joins to those of each edge; -1 for an edge of no interface"""
    mirrors: MirrorPlanes | None = None
    """of symmetry, at its nodes"""

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

    @property
    def sides(self) -> Ints:
        """What the part is made of: its edges, (m, 2)."""
        return self.edges

    @property
    def names(self) -> Ints:
        """Each end of its edges (2 m, 2): the node, and the other node of the edge."""
        return np.concatenate([self.edges, self.edges[:, ::-1]])

    def rules(self, count: int) -> tuple[SideRule, ...]:
        """Quadrature with `count` Gauss points an edge."""
        return (SideRule(np.arange(len(self.edges)), self.edges, *self.gauss(count)),)

    @cached_property
    def node_normals(self) -> BoundaryRows:
        """The rows of this part: at a corner, one for each of its sides."""
        points, shares = self.gauss(GAUSS)
        m = len(self.edges)
        columns = np.repeat(np.arange(m * GAUSS).reshape(m, GAUSS), 2, axis=0)
        starts = np.arange(0, 2 * m * GAUSS + 1, GAUSS)
        matrix = sp.csr_matrix((shares.ravel(), columns.ravel(), starts), shape=(2 * m, m * GAUSS))
        length = np.repeat(self.lengths, 2)
        ends = SideEnds(
            nodes=self.edges.ravel(),
            normals=np.repeat(self.normals, 2, axis=0),
            curvature=1.0 / length,
            noise=NORMAL_ROUNDING * np.abs(self.points).max() / length,
            lengths=0.5 * length,
            beyond=self.edges[:, ::-1].ravel(),
            partners=np.full(2 * m, -1) if self.across is None else self.across.ravel(),
            mirrors=self.mirrors,
        )
        return ends.rows(points.reshape(-1, 2), matrix)
