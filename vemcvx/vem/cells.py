"""Cells with equally many vertices, in the plane and in space, and the integrals that their projection is made of."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Self

import numpy as np

from vemcvx.arrays import Floats, Ints, read_only, totals
from vemcvx.meshes.polygons.topology import spans
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh
from vemcvx.vem.faces import face_groups
from vemcvx.vem.projection import area_gradients, boundary_weights, values_at_vertices

# Cells with equally many vertices, so that one array operation serves them all.


@dataclass(frozen=True, eq=False)
class CellGroup:
    """Polygons with equally many vertices; polyhedra differ as `PolyhedronGroup` says."""

    cells: Ints
    """(c,) cell numbers"""
    nodes: Ints
    """(c, n) their vertices, of polygons counter-clockwise"""
    points: Floats
    """(n_nodes, dim) the points of the whole mesh"""

    @cached_property
    def corners(self) -> Floats:
        """Vertex coordinates (c, n, dim) relative to the first vertex of each cell.

        Differences of neighbouring coordinates are exact, products of coordinates near 1e6 are not: with
        this origin a body far away from the origin loses nothing more than its points were rounded by.
        """
        corners = self.points[self.nodes]
        return read_only(corners - corners[:, :1])

    @property
    def simplices(self) -> bool:
        """Whether the cells are triangles, or tetrahedra, on which Pi v = v."""
        return bool(self.nodes.shape[1] == self.points.shape[1] + 1)

    @property
    def shapes(self) -> tuple[Floats, ...]:
        """Arrays (c, ...) that local matrices depend on, beside moduli: equal to the bit for translates."""
        return (self.corners,)

    @property
    def stabilised_size(self) -> Floats:
        """h_K^(dim - 2), by which the stabilisation is scaled, (c,)."""
        return np.ones(len(self.cells))

    def gradients(self) -> tuple[Floats, Floats]:
        """|K| (c,), and |K| G_i (c, n, dim): grad Pi v = sum_i v_i (x) G_i."""
        return area_gradients(self.corners)

    def boundary_means(self) -> Floats:
        """(c, n) weights of the mean over the boundary of a cell."""
        return boundary_weights(self.corners)

    def vertex_values(self) -> Floats:
        """Pi at the vertices, (c, n, n): entry (i, j) is Pi of the basis function of x_j at x_i."""
        return values_at_vertices(self.corners, *self.gradients(), self.boundary_means())

    def chunks(self, entries: int) -> Iterator[CellGroup]:
        """The group in pieces whose local n x n matrices hold about `entries` numbers together."""
        size = max(1, entries // self.nodes.shape[1] ** 2)
        for start in range(0, len(self.cells), size):
            yield self.part(slice(start, start + size))

    def part(self, places: Ints | slice) -> Self:
        """Some of its cells, by their places in the group."""
        own = [field.name for field in fields(self) if field.name != "points"]
        return replace(self, **{name: getattr(self, name)[places] for name in own})


# Polyhedral cells: what the projection Pi is made of, from integrals over their faces.
#
# With b_{f,i} and a_{f,i} the shares of a node in a face (:mod:`.faces`), outward for the cell, Gauss' theorem gives
#
#     |K| G_i = sum_f b_{f,i},   grad Pi v = sum_i v_i (x) G_i,   |K| = sum_i x_i . |K| G_i / 3,
#     w_i = sum_f a_{f,i} / |dK|,
#
# the constant of Pi by the mean over the surface, as in the plane by that over the outline (:mod:`.projection`). All
# of it is homogeneous in the coordinates, and on a tetrahedron Pi v = v.


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
