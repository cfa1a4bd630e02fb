"""The projection Pi from vertex values to linear functions, on polygons, plane faces and polyhedra."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from vemcvx.base.arrays import CHUNK_SIZE, Floats, Ints, read_only, totals
from vemcvx.meshes import Mesh, PolyhedralMesh
from vemcvx.meshes.polygons import (
    RADON_POINTS,
    RADON_WEIGHTS,
    cross,
    polygon_centroids,
    right_of,
    spans,
    split_at_vertices,
)
from vemcvx.vem.tensors import COMPONENTS


# Let K be a polygon with the area |K|, the perimeter |dK|, the vertices p_i = (x_i, y_i), and the edges e_i from p_i to
# p_{i+1}. A function v with the values v_i at p_i has the projection (docs/theory/virtual_elements.md)
#
#     Pi v(x) = sum_i w_i v_i + grad Pi v (x - xbar),   w_i = (|e_{i-1}| + |e_i|) / (2|dK|),   xbar = sum_i w_i p_i,
#     grad Pi v = sum_i v_i G_i',   G_i = (y_{i+1} - y_{i-1}, x_{i-1} - x_{i+1}) / (2|K|).
def area_gradients(corners: Floats) -> tuple[Floats, Floats]:
    """Return |K| and |K| G_i of counter-clockwise cells."""
    gradients = 0.5 * right_of(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1))
    # With this area, the computed gradient of the function x is exactly one.
    return np.einsum("ci,ci->c", corners[:, :, 0], gradients[:, :, 0]), gradients


def boundary_weights(corners: Floats) -> Floats:
    """Return the weights w_i of cells or faces."""
    edge = np.roll(corners, -1, axis=1) - corners
    length = np.sqrt(np.einsum("cia,cia->ci", edge, edge))
    both = length + np.roll(length, 1, axis=1)
    return both / both.sum(axis=1)[:, None]


def tangents_of(normals: Floats) -> Floats:
    """Return orthonormal tangents that form right-handed frames with unit normals."""
    if normals.shape[1] == 2:
        return np.stack([-normals[:, 1] + 0.0, normals[:, 0]], axis=1)[:, None, :]
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = axis - np.einsum("ki,ki->k", axis, normals)[:, None] * normals
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(normals, first)], axis=1) + 0.0


# Let f be a plane face of a polyhedron, with the vertices p_i and the point c = sum_i w_i p_i. A function v is linear
# on each triangle (c, p_i, p_{i+1}), with v(c) = sum_i w_i v_i. Let N_i be the area vector of triangle i, N the sum of
# all N_i, nu the unit normal of the face, and phi_i the basis function of vertex i. Then
#
#     int_f v nu = sum_i b_i v_i,   b_i = (N_{i-1} + N_i) / 3 + w_i N / 3,   a_i = int_f phi_i = |b_i|.
#
# A face that is not star-shaped about c is cut into triangles along diagonals, without c.
@dataclass(frozen=True, kw_only=True, eq=False)
class FaceGroup:
    """A group of faces with equally many vertices, cut into equally many triangles."""

    faces: Ints  # (f,) face numbers
    nodes: Ints  # (f, n) vertices; the right-hand rule gives the normal
    origin: Floats  # (f, 3) the first vertex
    corners: Floats  # (f, n + 1, 3) vertices and c, relative to the first vertex
    weights: Floats  # (f, n) weights w_i
    triangles: Ints  # (f, T, 3) positions in `corners`

    @cached_property
    def vectors(self) -> Floats:
        """The area vectors (f, T, 3) of the triangles."""
        a, b, c = self._at_triangles(self.corners).transpose(2, 0, 1, 3)
        return 0.5 * np.cross(b - a, c - a)

    @cached_property
    def vector_shares(self) -> Floats:
        """The vectors b_i (f, n, 3)."""
        f, n = self.nodes.shape
        total = np.zeros((f, n + 1, 3))  # at the vertices and at c
        np.add.at(total, (np.arange(f)[:, None, None], self.triangles), self.vectors[:, :, None] / 3.0)
        return total[:, :n] + self.weights[:, :, None] * total[:, n:]

    @property
    def shares(self) -> Floats:
        """The weights a_i (f, n)."""
        return np.linalg.norm(self.vector_shares, axis=2)

    def quadrature(self) -> tuple[Floats, Floats]:
        """Return quadrature points, and weights times basis functions, exact for degree 5."""
        f, count = self.triangles.shape[:2]
        within = np.einsum("qk,ftki->ftqi", RADON_POINTS, self._at_triangles(self.corners))
        each = np.linalg.norm(self.vectors, axis=2)[:, :, None, None] * (RADON_WEIGHTS[:, None] * RADON_POINTS).T
        shares = np.zeros((f, self.corners.shape[1], count, len(RADON_WEIGHTS)))
        places = np.arange(f)[:, None, None], self.triangles, np.arange(count)[:, None]
        np.add.at(shares, places, np.broadcast_to(each, (f, count, 3, len(RADON_WEIGHTS))))
        n = self.nodes.shape[1]
        spread = shares[:, :n] + self.weights[:, :, None, None] * shares[:, n:]
        return self.origin[:, None] + within.reshape(f, -1, 3), spread.reshape(f, n, -1)

    def _at_triangles(self, values: Floats) -> Floats:
        """Return the values at corners of triangles."""
        return values[np.arange(len(values))[:, None, None], self.triangles]


def face_groups(points: Floats, offsets: Ints, vertices: Ints, faces: Ints) -> Iterator[FaceGroup]:
    """Yield groups of faces with equally many vertices."""
    counts = np.diff(offsets)[faces]
    for n in np.unique(counts):
        some = faces[counts == n]
        nodes = vertices[offsets[some][:, None] + np.arange(n)]
        corners = points[nodes] - points[nodes[:, :1]]
        weights = boundary_weights(corners)
        corners = np.concatenate([corners, np.einsum("fi,fia->fa", weights, corners)[:, None]], axis=1)
        triangles = np.broadcast_to(_fan(n), (len(some), *_fan(n).shape))
        fans = FaceGroup(
            faces=some, nodes=nodes, origin=points[nodes[:, 0]], corners=corners, weights=weights, triangles=triangles
        )
        sees = np.einsum("fti,fi->ft", fans.vectors, fans.vectors.sum(axis=1)).min(axis=1) > 0.0
        for mine in (sees, ~sees):
            if mine.any():
                group = replace(fans, **{field.name: getattr(fans, field.name)[mine] for field in fields(fans)})
                is_cut = not sees[mine].all()
                yield replace(group, triangles=_split_along_diagonals(group.corners[:, :n])) if is_cut else group


def _fan(n: int) -> Ints:
    """Return the triangles (T, 3) around the point c."""
    if n == 3:
        return np.arange(3)[None]
    return np.column_stack([np.full(n, n), np.arange(n), np.roll(np.arange(n), -1)])


def _split_along_diagonals(corners: Floats) -> Ints:
    vector = 0.5 * np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
    plane = tangents_of(vector / np.linalg.norm(vector, axis=1)[:, None])
    return split_at_vertices(np.einsum("fbi,fni->fnb", plane, corners))


CACHED_NUMBERS = 2**16
"""Largest number of floats in an array. A few arrays of this size fit into the second-level cache."""


@dataclass(frozen=True, eq=False)
class CellGroup:
    """A group of polygons with equally many vertices, and the base class of other groups of cells.

    Attributes
    ----------
    cells : (c,) array of int
        Cell numbers.
    nodes : (c, n) array of int
        The vertices of the cells; polygons are counter-clockwise.
    points : (n_nodes, dim) array
        The points of the whole mesh.

    Examples
    --------
    >>> [cells] = vx.vem.Space(vx.meshes.squares(2)).groups
    >>> cells.nodes.shape
    (4, 4)
    """

    cells: Ints
    nodes: Ints
    points: Floats

    FREE: ClassVar[float | tuple[float, float]] = 1.0

    @cached_property
    def corners(self) -> Floats:
        """The coordinates (c, n, dim) of vertices relative to the first vertex of each cell."""
        corners = self.points.take(self.nodes, axis=0)  # twice as fast as indexing
        return read_only(corners - corners[:, :1])

    @property
    def simplices(self) -> bool:
        """True if the cells are triangles or tetrahedra, on which Pi v = v."""
        return bool(self.nodes.shape[1] == self.points.shape[1] + 1)

    @property
    def stabilised_size(self) -> Floats:
        """The factor h_K^(dim - 2) of the stabilisation, (c,)."""
        return np.ones(len(self.cells))

    def gradients(self) -> tuple[Floats, Floats]:
        """Return |K| (c,), and |K| G_i (c, n, dim)."""
        return area_gradients(self.corners)

    def strain_rows(self) -> tuple[Floats, Floats]:
        """Return |K|, and |K| times the strains (c, components, n, dim) of unit displacements."""
        measures, g = self.gradients()
        count, n, dim = g.shape
        B = np.zeros((count, len(COMPONENTS[dim]), n, dim))
        for k, (a, b) in enumerate(COMPONENTS[dim]):
            B[:, k, :, a], B[:, k, :, b] = g[:, :, b], g[:, :, a]
        return measures, B

    def strains(self, v: Floats) -> Floats:
        """Return the strains eps(Pi v) (c, components) of vertex values v (c, n, dim)."""
        measures, B = self.strain_rows()
        v = v - v[:, :1] * self.FREE  # reduces rounding for large translations
        return np.asarray(np.einsum("ckia,cia->ck", B, v) / measures[:, None])

    def depth(self, x: Floats) -> Floats:
        """Return the thickness (k,) of the body at points x (k, dim)."""
        return np.ones(len(x))

    def load_shares(self) -> Floats:
        """Return the fractions (c, n) of a uniform force at the vertices."""
        return np.full(self.nodes.shape, 1.0 / self.nodes.shape[1])

    def boundary_means(self) -> Floats:
        """Return the weights w_i (c, n)."""
        return boundary_weights(self.corners)

    def vertex_values(self) -> Floats:
        """Return the values (c, n, n) of Pi phi_j at vertices i."""
        return self.values_at(self.corners)

    def values_at(self, x: Floats) -> Floats:
        """Return the values (c, q, n) of Pi phi_j at points x; x is relative to the first vertex."""
        (measures, gradients), w = self.gradients(), self.boundary_means()
        arms = (x - np.einsum("ci,cia->ca", w, self.corners)[:, None]) / measures[:, None, None]
        return np.asarray(np.matmul(arms, gradients.transpose(0, 2, 1)) + w[:, None])

    def chunks(self) -> Iterator[CellGroup]:
        """Yield parts of the group with matrices that fit into the cache."""
        size = max(1, CACHED_NUMBERS // self.nodes.shape[1] ** 2)
        for start in range(0, len(self.cells), size):
            yield self.part(slice(start, start + size))

    def part(self, places: Ints | slice) -> Self:
        """Return the group of the cells at the given positions."""
        own = [field.name for field in fields(self) if field.name != "points"]
        return replace(self, **{name: getattr(self, name)[places] for name in own})


# Let K be a polyhedron with the surface area |dK|. A face f with an outward normal has the vectors b_{f,i} = b_i and
# the integrals a_{f,i} = a_i. By Gauss' theorem,
#
#     |K| G_i = sum_f b_{f,i},   |K| = sum_i p_i . |K| G_i / 3,   w_i = sum_f a_{f,i} / |dK|.
@dataclass(frozen=True, eq=False)
class PolyhedronGroup(CellGroup):
    """A group of polyhedra with equally many vertices; `nodes` ascend in each cell."""

    vector_shares: Floats  # (c, n, 3) |K| G_i
    shares: Floats  # (c, n) sum_f a_{f,i}
    diameters: Floats
    centroids: Floats

    def gradients(self) -> tuple[Floats, Floats]:
        """Return |K| (c,), and |K| G_i (c, n, 3)."""
        return np.einsum("cia,cia->c", self.corners, self.vector_shares) / 3.0, self.vector_shares

    def boundary_means(self) -> Floats:
        """Return the weights w_i (c, n)."""
        return self.shares / self.shares.sum(axis=1)[:, None]

    @property
    def stabilised_size(self) -> Floats:
        """The diameters (c,) of the cells."""
        return self.diameters

    def quadrature(self) -> tuple[Floats, Floats, Ints]:
        """Return the centroids, volumes and positions of cells."""
        return self.centroids, self.gradients()[0], np.arange(len(self.cells))


def second_moments(about: Floats) -> Floats:
    """Return int_K x x' dx for polygons K."""
    after = np.roll(about, -1, axis=1)
    # The integral over the triangle (0, p, q) is (p x q) / 24 (pp' + qq' + (p + q)(p + q)').
    part = cross(about, after) / 24.0
    sums = [np.einsum("ci,cia,cib->cab", part, p, p) for p in (about, after, about + after)]
    return np.asarray(sums[0] + sums[1] + sums[2])


@dataclass(frozen=True, eq=False)
class RingGroup(CellGroup):
    """A group of cells in the (r, z) plane of a body of revolution (docs/theory/virtual_elements.md)."""

    FREE = (0.0, 1.0)

    @cached_property
    def centres(self) -> Floats:
        """The centroids (c, 2) relative to the first vertex of each cell."""
        return read_only(polygon_centroids(self.corners)[1])

    @property
    def radii(self) -> Floats:
        """The radii (c,) of the centroids."""
        return self.points[self.nodes[:, 0], 0] + self.centres[:, 0]

    @property
    def stabilised_size(self) -> Floats:
        """The circumference (c,) at the centroids."""
        return 2.0 * np.pi * self.radii

    def depth(self, x: Floats) -> Floats:
        """Return the circumference (k,) at points x (k, 2)."""
        return 2.0 * np.pi * x[:, 0]

    def load_shares(self) -> Floats:
        """Return the means (c, n) of Pi phi_i over each cell."""
        return self.values_at(self.centres[:, None])[:, 0]

    def strain_rows(self) -> tuple[Floats, Floats]:
        """Return volumes, and volumes times mean strains: rr, zz, rz and hoop."""
        areas, g = self.gradients()
        outward = right_of(np.roll(self.corners, -1, axis=1) - self.corners)
        # Values of r relative to the centroid reduce rounding far from the axis.
        r = self.corners[:, :, 0] - self.centres[:, :1]
        after = np.roll(r, -1, axis=1)
        own, next_ = ((2.0 * r + after) / 6.0)[:, :, None] * outward, ((r + 2.0 * after) / 6.0)[:, :, None] * outward
        flux = self.radii[:, None, None] * g + own + np.roll(next_, 1, axis=1)  # oint r phi_i n ds
        inside = areas[:, None] * self.load_shares()
        B = np.zeros((len(areas), 4, *self.nodes.shape[1:], 2))
        B[:, 0, :, 0] = B[:, 2, :, 1] = flux[:, :, 0] - inside
        B[:, 1, :, 1] = B[:, 2, :, 0] = flux[:, :, 1]
        B[:, 3, :, 0] = inside
        return 2.0 * np.pi * areas * self.radii, 2.0 * np.pi * B

    def hoop_variation(self) -> Floats:
        """Return the matrices of the hoop variation (docs/theory/virtual_elements.md)."""
        areas, g = self.gradients()
        rows = (g / areas[:, None, None]).transpose(0, 2, 1).copy()
        rows[:, 0] -= self.load_shares() / self.radii[:, None]
        M = second_moments(self.corners - self.centres[:, None])
        both = (np.pi / self.radii)[:, None, None] * np.matmul(rows.transpose(0, 2, 1), np.matmul(M, rows))
        return np.asarray(both + both.transpose(0, 2, 1))


def cell_groups(mesh: Mesh, axisymmetric: bool = False) -> tuple[CellGroup, ...]:
    """Return groups of cells with equally many vertices."""
    offsets, nodes = mesh.cell_nodes
    counts, groups = np.diff(offsets), list[CellGroup]()
    shares = _shares_of_cells(mesh, offsets, nodes) if isinstance(mesh, PolyhedralMesh) else ()
    for n in np.unique(counts):
        cells = np.flatnonzero(counts == n)
        at = offsets[cells][:, None] + np.arange(n)
        own = read_only(cells), read_only(nodes[at]), mesh.points
        if isinstance(mesh, PolyhedralMesh):
            vectors, areas = (read_only(values[at]) for values in shares)
            sizes, centroids = mesh.diameters[cells], mesh.centroids[cells]
            groups.append(PolyhedronGroup(*own, vectors, areas, diameters=sizes, centroids=centroids))
        else:
            groups.append((RingGroup if axisymmetric else CellGroup)(*own))
    return tuple(groups)


def _shares_of_cells(mesh: PolyhedralMesh, offsets: Ints, nodes: Ints) -> tuple[Floats, Floats]:
    """Return |K| G_i and sum_f a_{f,i} for all pairs of cells and nodes."""
    b, a = np.empty((len(mesh.face_vertices), 3)), np.empty(len(mesh.face_vertices))
    for start in range(0, mesh.n_faces, 4 * CHUNK_SIZE):  # a face takes a quarter of a cell's memory
        some = np.arange(start, min(start + 4 * CHUNK_SIZE, mesh.n_faces))
        for group in face_groups(mesh.points, mesh.face_offsets, mesh.face_vertices, some):
            at = mesh.face_offsets[group.faces][:, None] + np.arange(group.nodes.shape[1])
            b[at], a[at] = group.vector_shares, group.shares
    vectors, areas = np.empty((len(nodes), 3)), np.empty(len(nodes))
    for start in range(0, mesh.n_cells, CHUNK_SIZE):
        every = np.arange(start, min(start + CHUNK_SIZE, mesh.n_cells))
        stop = start + len(every)
        sides, ours = slice(*mesh.cell_offsets[[start, stop]]), slice(*offsets[[start, stop]])
        faces = mesh.cell_faces[sides]
        sizes = mesh.face_offsets[faces + 1] - mesh.face_offsets[faces]
        corner = spans(mesh.face_offsets[faces], sizes)
        cell = np.repeat(np.repeat(every, np.diff(mesh.cell_offsets[start : stop + 1])), sizes)
        pairs = np.repeat(every, np.diff(offsets[start : stop + 1])) * mesh.n_nodes + nodes[ours]
        pair = np.searchsorted(pairs, cell * mesh.n_nodes + mesh.face_vertices[corner])
        outward = b[corner] * np.repeat(mesh.face_signs[sides], sizes)[:, None]
        vectors[ours] = np.column_stack([totals(pair, outward[:, axis], len(pairs)) for axis in range(3)])
        areas[ours] = totals(pair, a[corner], len(pairs))
    return vectors, areas
