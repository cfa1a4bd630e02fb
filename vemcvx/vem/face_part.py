"""A part of the boundary of polyhedra: its faces, its nodes, and what each node owns of it.

A node gets the area int phi_i ds over the part, with functions on faces as in :mod:`vemcvx.vem.faces`; where faces
meet at an angle it has a row for each normal (:mod:`vemcvx.vem.rows`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints, read_only, totals
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh
from vemcvx.vem.boundary import SideRule
from vemcvx.vem.faces import FaceGroup, face_groups
from vemcvx.vem.rows import NORMAL_ROUNDING, BoundaryRows, MirrorPlanes, SideEnds


@dataclass(frozen=True, eq=False)
class FacePart:
    """A closed set of boundary faces; what effects ask of it is what they ask of a part made of edges."""

    sides: Ints
    """(m,) face numbers, ascending"""
    mesh: PolyhedralMesh
    mirrors: MirrorPlanes | None = None
    """of symmetry, at its nodes"""

    @cached_property
    def normals(self) -> Floats:
        """Outward unit normal of each face, (m, 3)."""
        vectors = np.empty((len(self.sides), 3))
        for group, at in self._groups:
            vectors[at] = group.vectors.sum(axis=1)
        return read_only(vectors / np.linalg.norm(vectors, axis=1)[:, None] + 0.0)

    @cached_property
    def nodes(self) -> Ints:
        """The nodes of the faces, ascending."""
        return read_only(np.unique(self.names[:, 0]))

    @cached_property
    def node_lengths(self) -> Floats:
        """int phi_i ds over the part for each of `nodes`; the sum is the area of the part."""
        ends = self._ends
        return read_only(totals(np.searchsorted(self.nodes, ends.nodes), ends.lengths, len(self.nodes)))

    @property
    def names(self) -> Ints:
        """Each corner of its faces (e, 2): the node, and the number of the face."""
        return np.column_stack([self._ends.nodes, self._ends.beyond])

    def rules(self, count: int = 0) -> tuple[SideRule, ...]:
        """Quadrature exact for degree 5 on the triangles of each face, whatever the `count` of points on an edge."""
        return tuple(SideRule(at, group.nodes, *group.quadrature()) for group, at in self._groups)

    @cached_property
    def node_normals(self) -> BoundaryRows:
        """The rows of this part: where faces meet at an angle, one for each normal."""
        rules = self.rules()
        points = np.concatenate([rule.points.reshape(-1, 3) for rule in rules])
        blocks = []
        for rule in rules:
            m, n, q = rule.shares.shape
            columns = np.repeat(np.arange(m * q).reshape(m, 1, q), n, axis=1)
            starts = np.arange(0, m * n * q + 1, q)
            blocks.append(sp.csr_matrix((rule.shares.ravel(), columns.ravel(), starts), shape=(m * n, m * q)))
        return self._ends.rows(points, sp.csr_matrix(sp.block_diag(blocks, format="csr")))

    @cached_property
    def _groups(self) -> tuple[tuple[FaceGroup, Ints], ...]:
        """Faces cut into triangles, and their places in the part."""
        mesh = self.mesh
        found = face_groups(mesh.points, mesh.face_offsets, mesh.face_vertices, self.sides)
        return tuple((group, np.searchsorted(self.sides, group.faces)) for group in found)

    @cached_property
    def _ends(self) -> SideEnds:
        """The corners of all faces, in the order of the groups."""
        each = [(group, at, group.nodes.shape[1]) for group, at in self._groups]
        side = np.concatenate([np.repeat(at, n) for _, at, n in each])
        noise = np.empty(len(self.sides))
        for group, at, n in each:
            noise[at] = _outline(group, n) / np.linalg.norm(group.vectors.sum(axis=1), axis=1)
        return SideEnds(
            nodes=np.concatenate([group.nodes.ravel() for group, _, _ in each]),
            normals=self.normals[side],
            curvature=np.concatenate([_curvature(group, n).ravel() for group, _, n in each]),
            noise=(NORMAL_ROUNDING * np.abs(self.mesh.points).max() * noise)[side],
            lengths=np.concatenate([group.shares.ravel() for group, _, _ in each]),
            beyond=self.sides[side],
            partners=np.full(len(side), -1),
            mirrors=self.mirrors,
        )


def _curvature(group: FaceGroup, n: int) -> Floats:
    """sin(alpha) / (|a| |b|) of the edges a and b of each face at its vertices, (f, n)."""
    corners = group.corners[:, :n]
    a, b = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    lengths = np.einsum("fni,fni->fn", a, a) * np.einsum("fni,fni->fn", b, b)
    weights: Floats = np.linalg.norm(np.cross(a, b), axis=2) / lengths
    return weights


def _outline(group: FaceGroup, n: int) -> Floats:
    """Length of the outline of each face, (f,)."""
    corners = group.corners[:, :n]
    length: Floats = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).sum(axis=1)
    return length
