"""Recovered pressure and friction in space: means of the forces of nodes over one and a half cells.

As in the plane (:mod:`.contact`), forces of single nodes are off by more than their means over a few cells. Where two
tilings are intersected some nodes have hardly any area of their own, and the stiffness at a node does not know of it:
what its force is off by does not vanish with |phi_i| = int phi_i, and R_i / |phi_i| may be off by half of what it is
where the root of the mean square is off by half a per cent. So the recovered values are means over nodes nearby,

    p_i = sum_j K_ij R_j,    K_ij = d_i k_ij d_j,    k_ij = max(0, 1 - |x_i - x_j|^2 / (1.5^2 h_i h_j)),

with the d that make K |phi| = 1 (Sinkhorn and Knopp, Pacific J. Math. 21 (1967); Milanfar, SIAM J. Imaging Sci. 6
(2013)). K being symmetric, sum |phi_i| p_i = sum R_i: the resultant of every piece that is closed is kept, what is
constant is found exactly, and what presses gives pressures. Smooth fields change by the order of h^2, and by that of h
where contact ends, whose edge is rounded over 1.5 h. The length h is the root of the area that a cell has on the
surface, the larger one of both bodies. Where k is 0 because normals differ by more than those of a curve, faces do not
mix; and nodes at edges and corners of the body keep R_i / |phi_i|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Bools, Floats, Ints
from vemcvx.meshes import PolyhedralMesh
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.polygons import cell_of_corner, next_corner, offsets_of, rows_in_order, spans
from vemcvx.scene.contact import Surface
from vemcvx.scene.rows import ContactRows
from vemcvx.vem.boundary import CURVE

CELLS = 1.5
"""How far means go, in h."""


@dataclass(frozen=True, eq=False)
class ContactFaces:
    """Faces of contact in space between its m nodes, without those at edges and corners of the body."""

    points: Floats
    """(m, 3)"""
    normals: Floats
    """(m, 3)"""
    reach: Floats
    """(m,) 1.5 h"""
    offsets: Ints
    """(k + 1,) where the corners of each face begin"""
    corners: Ints
    """(q,) the node of each corner, of m"""

    @classmethod
    def of(cls, rows: ContactRows, at: Ints, surface: Surface, mesh: PolyhedralMesh) -> ContactFaces:
        """The faces of these rows, whose places among the nodes of contact are `at`."""
        owner, (node, face) = rows.owners(at), rows.names.T
        faces = np.unique(face[face >= 0])
        offsets, vertices = rows_in_order(mesh.face_offsets, mesh.face_vertices, faces)
        face_of = faces[cell_of_corner(offsets)]
        order = np.lexsort((node, face))
        known, wanted = (f * mesh.n_nodes + v for f, v in ((face[order], node[order]), (face_of, vertices)))
        found = order[np.minimum(np.searchsorted(known, wanted), len(order) - 1)]
        there = (face[found] == face_of) & (node[found] == vertices) & (owner[found] >= 0)
        own = np.where(there, owner[found], 0)
        turns = np.einsum("qd,qd->q", surface.normals[own], mesh.face_normals[face_of]) < np.cos(0.5 * CURVE)
        sharp = np.isin(own, own[turns & there])
        reach = CELLS * np.maximum(_size(mesh, surface.nodes), _size(mesh, surface.partners))
        every = cls(mesh.points[surface.nodes], surface.normals, reach, offsets, own)
        return every._of_faces(np.logical_and.reduceat(there & ~sharp, offsets[:-1]))

    def _of_faces(self, kept: Bools) -> ContactFaces:
        corners = self.corners[kept[cell_of_corner(self.offsets)]]
        return ContactFaces(self.points, self.normals, self.reach, offsets_of(np.diff(self.offsets)[kept]), corners)

    def within(self, pattern: Bools) -> ContactFaces:
        """The faces all of whose nodes are in the pattern (m,)."""
        return self._of_faces(np.logical_and.reduceat(pattern[self.corners], self.offsets[:-1]))

    @property
    def links(self) -> Ints:
        """(q, 2) the nodes at the ends of edges."""
        return np.column_stack([self.corners, self.corners[next_corner(self.offsets)]])

    def smoothed(self, forces: Floats, lengths: Floats) -> Floats:
        """The means p (S, m), R_i / int phi_i where no face is."""
        k, d, nearest = self._nearness(), np.ones(len(lengths)), np.inf
        for _ in range(100):
            off = d * (k @ (d * lengths))
            d /= np.sqrt(off)
            # The step of log d is 1/2 - 1/2 (a mean with weights): the largest change never grows, but by rounding.
            before, nearest = nearest, float(np.abs(np.log(off)).max())
            if nearest >= before:
                break
        return (d[:, None] * (k @ (d[:, None] * forces.T))).T

    def _nearness(self) -> sp.csr_matrix:
        """(m, m) k, symmetric; 1 on the diagonal.

        Nodes are looked for from neighbour to neighbour, which leads to no other piece: SciPy's tree of points takes
        .08 s to import.
        """
        m, used = len(self.points), np.unique(self.corners)
        both = np.vstack([self.links, self.links[:, ::-1]])
        beside = sp.csr_matrix((np.ones(len(both)), both.T), shape=(m, m))
        i, j, known = used, used, used * m + used
        begin, beyond = beside.indptr.astype(np.int64), beside.indices.astype(np.int64)
        while len(i):
            count = np.diff(begin)[j]
            i, j = np.repeat(i, count), beyond[spans(begin[j], count)]
            new = np.unique((i * m + j)[self._away(i, j) < 1.0])
            new = new[~np.isin(new, known, assume_unique=True)]
            known, (i, j) = np.append(known, new), np.divmod(new, m)
        i, j = np.divmod(known, m)
        alike = np.einsum("ed,ed->e", self.normals[i], self.normals[j]) > np.cos(CURVE)
        one_way = sp.csr_matrix((np.where(alike, 1.0 - self._away(i, j), 0.0), (i, j)), shape=(m, m))
        alone = np.setdiff1d(np.arange(m), used)
        return one_way.maximum(one_way.T) + sp.csr_matrix((np.ones(len(alone)), (alone, alone)), shape=(m, m))

    def _away(self, i: Ints, j: Ints) -> Floats:
        """|x_i - x_j|^2 over 1.5^2 h_i h_j, of pairs of nodes (e,)."""
        apart = self.points[i] - self.points[j]
        away: Floats = np.einsum("ed,ed->e", apart, apart) / (self.reach[i] * self.reach[j])
        return away


def _size(mesh: PolyhedralMesh, nodes: Ints) -> Floats:
    """The root of the largest area that a cell at each node (m,) has on the faces between them; 0 of the node -1."""
    boundary = mesh.boundaries[WHOLE]
    offsets, vertices = rows_in_order(mesh.face_offsets, mesh.face_vertices, boundary)
    on = np.zeros(mesh.n_nodes, dtype=bool)
    on[nodes[nodes >= 0]] = True
    among = np.logical_and.reduceat(on[vertices], offsets[:-1])
    cells = mesh.face_cells[boundary, 0]
    area = np.bincount(cells, mesh.face_areas[boundary] * among, minlength=mesh.n_cells)
    found = np.zeros(mesh.n_nodes)
    np.maximum.at(found, vertices, (area[cells] * among)[cell_of_corner(offsets)])
    return np.where(nodes >= 0, np.sqrt(found[nodes]), 0.0)
