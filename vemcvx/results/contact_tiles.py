"""Recovered pressure and friction on interfaces of meshes that do not match.

`Contact.pressure` is R_i / |phi_i|, with the force R_i on the node at x_i and the integral |phi_i| of the hat function.
If a cell has several sides on the interface, this quotient has ripples of O(h) or more. Recovered values are means over
nodes,

    p_i = sum_j K_ij R_j,    K_ij = d_i k_ij d_j,    k_ij = max(0, 1 - |x_i - x_j|^2 / (1.5^2 h_i h_j)).

Here h_i is the largest length of a cell at x_i on the interface (in space, the square root of an area). If the normals
at i and j differ by `CURVE_ANGLE` or more, or closed contact does not connect i and j, k_ij is 0. The factors d_i make
K |phi| = 1, so that constants are exact (Sinkhorn and Knopp, Pacific J. Math. 21 (1967)). K is symmetric, so
sum |phi_i| p_i = sum R_i on each piece of closed contact. No entry of K is negative, so compression remains
compression. Nodes at corners of the interface keep R_i / |phi_i|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from vemcvx.base.arrays import Bools, Floats, Ints
from vemcvx.meshes import Mesh, PolyhedralMesh
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.interfaces import faces_of
from vemcvx.meshes.polygons import cell_of_corner, find_in, next_vertex, offsets_of, rows_in_order
from vemcvx.scene.contact import Surface
from vemcvx.scene.rows import ContactRows, pair_numbers
from vemcvx.vem.boundary import CURVE_ANGLE

CELLS = 1.5  # radius of the means in units of h_i


@dataclass(frozen=True, eq=False)
class ContactTiles:
    """Contact nodes, and pairs of contact nodes with a common side."""

    points: Floats  # (m, dim)
    normals: Floats  # (m, dim)
    reach: Floats  # (m,) the radius 1.5 h_i of the mean
    beside: sp.csr_matrix  # (m, m) nonzero for nodes with a common side

    @classmethod
    def from_rows(cls, rows: ContactRows, at: Ints, surface: Surface, mesh: Mesh) -> ContactTiles:
        """Return the contact nodes. Row i of `rows` belongs to the contact node `at[i]`."""
        owner, (node, other), normals = rows.owners(at), rows.names.T, surface.normals
        there = owner >= 0
        owner, node, other = owner[there], node[there], other[there]
        if isinstance(mesh, PolyhedralMesh):
            tile, away = other, 1.0 - np.einsum("qd,qd->q", normals[owner], mesh.face_normals[other])
            sharp = away > 1.0 - np.cos(0.5 * CURVE_ANGLE)
        else:
            tile = pair_numbers(np.minimum(node, other), np.maximum(node, other), mesh.n_nodes)
            along = mesh.points[other] - mesh.points[node]
            slope = np.einsum("qd,qd->q", normals[owner], along) / np.linalg.norm(along, axis=1)
            sharp = np.abs(slope) > np.sin(0.5 * CURVE_ANGLE)
        known, tile = np.unique(tile, return_inverse=True)
        smooth = ~np.isin(owner, owner[sharp])
        corners = np.ones(int(smooth.sum())), (tile[smooth], owner[smooth])
        on = sp.csr_matrix(corners, shape=(len(known), len(surface)))
        size = np.maximum(_cell_sizes(mesh, surface.nodes), _cell_sizes(mesh, surface.partners))
        reach = CELLS * np.where(size > 0, size, 1.0)  # A single contact node has size 0.
        return cls(mesh.points[surface.nodes], normals, reach, sp.csr_matrix(on.T @ on))

    def average(self, forces: Floats, lengths: Floats, closed: Bools) -> Floats:
        """Return the recovered values (k, m) of nodal forces (k, m); `lengths` (m,) are |phi_i|."""
        found = forces / lengths
        patterns, number = np.unique(closed, axis=0, return_inverse=True)
        for k, pattern in enumerate(patterns):
            rows = number.ravel() == k
            found[rows] = self._means(forces[rows], lengths, pattern)
        return found

    def _means(self, forces: Floats, lengths: Floats, among: Bools) -> Floats:
        k, d, nearest = self._nearness(among), np.ones(len(lengths)), np.inf
        for _ in range(100):
            off = d * (k @ (d * lengths))
            d /= np.sqrt(off)
            # In exact arithmetic, max |log(off)| does not grow.
            before, nearest = nearest, float(np.abs(np.log(off)).max())
            if nearest >= before:
                break
        return (d[:, None] * (k @ (d[:, None] * forces.T))).T

    def _nearness(self, among: Bools) -> sp.csr_matrix:
        from scipy.spatial import cKDTree  # The import takes .3 s.

        m, chosen = len(self.points), sp.diags_array(among.astype(float))
        _, piece = connected_components(chosen @ self.beside @ chosen)
        # k_ij > 0 only if |x_i - x_j| < 1.5 max(h_i, h_j).
        near = cKDTree(self.points).query_ball_point(self.points, self.reach)
        i, j = np.repeat(np.arange(m), list(map(len, near))), np.concatenate(near).astype(int)
        apart = self.points[i] - self.points[j]
        k = 1.0 - np.einsum("ed,ed->e", apart, apart) / (self.reach[i] * self.reach[j])
        alike = np.einsum("ed,ed->e", self.normals[i], self.normals[j]) > np.cos(CURVE_ANGLE)
        k = np.where((piece[i] == piece[j]) & alike, np.maximum(k, 0.0), 0.0)
        one_way = sp.csr_matrix((k, (i, j)), shape=(m, m))
        return one_way.maximum(one_way.T)


def find_unmatched(mesh: Mesh) -> Bools:
    """Return a mask (n_nodes,) of nodes on interfaces where meshes do not match."""
    found, (offsets, vertices, cells, _) = np.zeros(mesh.n_nodes, dtype=bool), _boundary_sides(mesh)
    for interface in mesh.interfaces.values():
        for sides in (interface.edges, interface.partners):
            own = cells[faces_of(sides, (offsets, vertices))]
            if len(np.unique(own)) < len(own):
                found[interface.pairs] = True
    return found


def _cell_sizes(mesh: Mesh, nodes: Ints) -> Floats:
    offsets, vertices, cells, sizes = _boundary_sides(mesh)
    on = np.zeros(mesh.n_nodes, dtype=bool)
    on[nodes[nodes >= 0]] = True
    among = np.logical_and.reduceat(on[vertices], offsets[:-1])
    of_cells = np.bincount(cells, sizes * among, minlength=mesh.n_cells)
    found = np.zeros(mesh.n_nodes)
    np.maximum.at(found, vertices, (of_cells[cells] * among)[cell_of_corner(offsets)])
    return np.where(nodes >= 0, found[nodes] ** (1.0 / (mesh.points.shape[1] - 1)), 0.0)


def _boundary_sides(mesh: Mesh) -> tuple[Ints, Ints, Ints, Floats]:
    sides = mesh.boundaries[WHOLE]
    if isinstance(mesh, PolyhedralMesh):
        offsets, vertices = rows_in_order(mesh.face_offsets, mesh.face_vertices, sides)
        return offsets, vertices, mesh.face_cells[sides, 0], mesh.face_areas[sides]
    offsets, vertices = mesh.cell_nodes
    every = pair_numbers(vertices, next_vertex(offsets, vertices), mesh.n_nodes)
    at = find_in(every, pair_numbers(sides[:, 0], sides[:, 1], mesh.n_nodes))
    lengths = np.linalg.norm(mesh.points[sides[:, 1]] - mesh.points[sides[:, 0]], axis=1)
    return offsets_of(np.full(len(sides), 2)), sides.ravel(), cell_of_corner(offsets)[at], lengths
