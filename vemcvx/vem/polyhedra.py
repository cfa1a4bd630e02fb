"""Polyhedral cells: what the projection Pi is made of, from integrals over their faces.

With b_{f,i} and a_{f,i} the shares of a node in a face (:mod:`.faces`), outward for the cell, Gauss' theorem gives

    |K| G_i = sum_f b_{f,i},   grad Pi v = sum_i v_i (x) G_i,   |K| = sum_i x_i . |K| G_i / 3,
    w_i = sum_f a_{f,i} / |dK|,

the constant of Pi by the mean over the surface, as in the plane by that over the outline (:mod:`.projection`). All of
it is homogeneous in the coordinates, and on a tetrahedron Pi v = v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats, Ints, read_only, totals
from vemcvx.meshes.polygons.topology import spans
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh
from vemcvx.vem.cells import CellGroup
from vemcvx.vem.faces import face_groups


@dataclass(frozen=True, eq=False)
class PolyhedronGroup(CellGroup):
    """Polyhedra with equally many vertices, each cell's in ascending order."""

    vector_shares: Floats
    """(c, n, 3) |K| G_i"""
    shares: Floats
    """(c, n) sum_f a_{f,i}"""
    diameters: Floats
    centroids: Floats

    @property
    def shapes(self) -> tuple[Floats, ...]:
        """As of polygons; what is summed up over faces is rounded as these are numbered."""
        return (*super().shapes, self.vector_shares, self.shares, self.diameters)

    def gradients(self) -> tuple[Floats, Floats]:
        """As of polygons."""
        return np.einsum("cia,cia->c", self.corners, self.vector_shares) / 3.0, self.vector_shares

    def boundary_means(self) -> Floats:
        """As of polygons."""
        means: Floats = self.shares / self.shares.sum(axis=1)[:, None]
        return means

    @property
    def stabilised_size(self) -> Floats:
        """h_K, (c,)."""
        return self.diameters

    def quadrature(self) -> tuple[Floats, Floats, Ints]:
        """One point a cell, the centroid: exact for degree 1."""
        return self.centroids, self.gradients()[0], np.arange(len(self.cells))


def polyhedron_groups(mesh: PolyhedralMesh) -> tuple[PolyhedronGroup, ...]:
    """The cells by number of vertices, ascending; cell numbers ascend within a group."""
    offsets, nodes = mesh.cell_nodes
    counts = np.diff(offsets)
    vectors, areas = _shares_of_cells(mesh, offsets, nodes)
    groups = []
    for n in np.unique(counts):
        cells = np.flatnonzero(counts == n)
        at = offsets[cells][:, None] + np.arange(n)
        groups.append(
            PolyhedronGroup(
                cells=read_only(cells),
                nodes=read_only(nodes[at]),
                points=mesh.points,
                vector_shares=read_only(vectors[at]),
                shares=read_only(areas[at]),
                diameters=mesh.diameters[cells],
                centroids=mesh.centroids[cells],
            )
        )
    return tuple(groups)


def _shares_of_cells(mesh: PolyhedralMesh, offsets: Ints, nodes: Ints) -> tuple[Floats, Floats]:
    """|K| G_i (k, 3) and sum_f a_{f,i} (k,) of all pairs of a cell and its node."""
    b, a = np.empty((len(mesh.face_vertices), 3)), np.empty(len(mesh.face_vertices))
    for group in face_groups(mesh.points, mesh.face_offsets, mesh.face_vertices, np.arange(mesh.n_faces)):
        at = mesh.face_offsets[group.faces][:, None] + np.arange(group.nodes.shape[1])
        b[at], a[at] = group.vector_shares, group.shares
    sizes = np.diff(mesh.face_offsets)[mesh.cell_faces]
    corner = spans(mesh.face_offsets[mesh.cell_faces], sizes)
    every = np.arange(mesh.n_cells)
    cell = np.repeat(np.repeat(every, np.diff(mesh.cell_offsets)), sizes)
    pairs = np.repeat(every, np.diff(offsets)) * mesh.n_nodes + nodes
    pair = np.searchsorted(pairs, cell * mesh.n_nodes + mesh.face_vertices[corner])
    outward = b[corner] * np.repeat(mesh.face_signs, sizes)[:, None]
    vectors = np.column_stack([totals(pair, outward[:, axis], len(pairs)) for axis in range(3)])
    return vectors, totals(pair, a[corner], len(pairs))
