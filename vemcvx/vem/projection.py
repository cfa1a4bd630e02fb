"""The projection Pi of functions with given vertex values, on polygons, plane faces and polyhedra."""

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


# The projection Pi of the paper named in `vemcvx`, Section 3, in vertex values (docs/theory/virtual_elements.md):
#
#     Pi v(x) = sum_i w_i v_i + grad Pi v (x - xbar),   w_i = (|e_{i-1}| + |e_i|) / (2|dK|),   xbar = sum_i w_i x_i,
#     grad Pi v = sum_i v_i (x) G_i,   G_i = (y_{i+1} - y_{i-1}, x_{i-1} - x_{i+1}) / (2|K|),
#
# with the edges e_i = [x_i, x_{i+1}] and the perimeter |dK|. Edges may be as short as rounding allows.
def area_gradients(corners: Floats) -> tuple[Floats, Floats]:
    """Return areas |K| (c,) and |K| G_i (c, n, 2) of counter-clockwise cells (c, n, 2) near the origin.

    The area is computed as |K| = sum_i x_i |K| (G_i)_x: then the computed gradient of the function x is exactly one.
    """
    gradients = 0.5 * right_of(np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1))
    return np.einsum("ci,ci->c", corners[:, :, 0], gradients[:, :, 0]), gradients


def boundary_weights(corners: Floats) -> Floats:
    """Return the weights w_i (c, n) in the boundary mean of a function that is linear on edges."""
    edge = np.roll(corners, -1, axis=1) - corners
    length = np.sqrt(np.einsum("cia,cia->ci", edge, edge))
    both = length + np.roll(length, 1, axis=1)
    return both / both.sum(axis=1)[:, None]


def tangents_of(normals: Floats) -> Floats:
    """Return orthonormal tangents (k, dim - 1, dim) of unit normals (k, dim), exact for normals along an axis.

    The tangent in the plane is the normal rotated by +90 degrees: the body is on its left. In space, the first tangent
    is the projection of the axis farthest from the normal, and (t1, t2, n) is right-handed.
    """
    if normals.shape[1] == 2:
        return np.stack([-normals[:, 1] + 0.0, normals[:, 0]], axis=1)[:, None, :]
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = axis - np.einsum("ki,ki->k", axis, normals)[:, None] * normals
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(normals, first)], axis=1) + 0.0


# Functions on plane faces of polyhedra with given vertex values: their integrals are exact for linear functions.
#
# A face f is split into triangles (c, x_i, x_{i+1}) around c = sum_i w_i x_i, with the weights w_i of its outline. A
# function v is sum_i w_i v_i at c, and linear on each triangle. With the area vectors N_i of the triangles, their sum
# N, the unit normal nu, and the basis function phi_i of vertex i,
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
    corners: Floats  # (f, n + 1, 3) the vertices and c, relative to the first vertex
    weights: Floats  # (f, n) w_i
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
        """Return points (f, q, 3), and weights times basis functions (f, n, q), exact for degree 5."""
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
        """Return values (f, T, 3, ...) at corners of triangles, given values (f, n + 1, ...) at vertices and at c."""
        return values[np.arange(len(values))[:, None, None], self.triangles]


def face_groups(points: Floats, offsets: Ints, vertices: Ints, faces: Ints) -> Iterator[FaceGroup]:
    """Yield groups of faces with equally many vertices; face f has ``vertices[offsets[f]:offsets[f + 1]]``."""
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
    """Return the triangles (n, 3) of a fan around point n; if n = 3, return the triangle itself, (1, 3)."""
    if n == 3:
        return np.arange(3)[None]
    return np.column_stack([np.full(n, n), np.arange(n), np.roll(np.arange(n), -1)])


def _split_along_diagonals(corners: Floats) -> Ints:
    """Return the triangles (f, n - 2, 3) of faces (f, n, 3)."""
    vector = 0.5 * np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
    plane = tangents_of(vector / np.linalg.norm(vector, axis=1)[:, None])
    return split_at_vertices(np.einsum("fbi,fni->fnb", plane, corners))


CACHED_NUMBERS = 2**16
"""Size of an array of eight-byte numbers that fits into the second-level cache with a few temporaries."""


@dataclass(frozen=True, eq=False)
class CellGroup:
    """A group of cells with equally many vertices: polygons; for polyhedra see `PolyhedronGroup`.

    Attributes
    ----------
    cells : (c,) array of int
        Cell numbers.
    nodes : (c, n) array of int
        The vertices of the cells, counter-clockwise if these are polygons.
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
    """For each component, 1 if a translation causes no strain; 0 for the radial component of a body of revolution."""

    @cached_property
    def corners(self) -> Floats:
        """The vertex coordinates (c, n, dim) relative to the first vertex: exact, also far from the origin."""
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
        """Return |K| (c,), and |K| G_i (c, n, dim): grad Pi v = sum_i v_i (x) G_i."""
        return area_gradients(self.corners)

    def strain_rows(self) -> tuple[Floats, Floats]:
        """Return |K| (c,), and |K| eps(Pi u) (c, components, n, dim) for a unit displacement of each vertex."""
        measures, g = self.gradients()
        count, n, dim = g.shape
        B = np.zeros((count, len(COMPONENTS[dim]), n, dim))
        for k, (a, b) in enumerate(COMPONENTS[dim]):
            B[:, k, :, a], B[:, k, :, b] = g[:, :, b], g[:, :, a]
        return measures, B

    def strains(self, v: Floats) -> Floats:
        """Return the mean strains eps(Pi v), (c, components), for the vertex values v (c, n, dim)."""
        measures, B = self.strain_rows()
        v = v - v[:, :1] * self.FREE  # a large rigid translation costs no digits
        return np.asarray(np.einsum("ckia,cia->ck", B, v) / measures[:, None])

    def depth(self, x: Floats) -> Floats:
        """Return the thickness (k,) of the body at points x (k, dim) in the cells: one, also in space."""
        return np.ones(len(x))

    def load_shares(self) -> Floats:
        """Return the fraction (c, n) of the force on a cell that each vertex carries: 1 / n."""
        return np.full(self.nodes.shape, 1.0 / self.nodes.shape[1])

    def boundary_means(self) -> Floats:
        """Return the weights (c, n) of vertex values in the mean over the boundary of a cell."""
        return boundary_weights(self.corners)

    def vertex_values(self) -> Floats:
        """Return Pi in vertex values, (c, n, n): entry (i, j) is the value of Pi phi_j at vertex i."""
        return self.values_at(self.corners)

    def values_at(self, x: Floats) -> Floats:
        """Return Pi of the n basis functions, (c, q, n), at points x (c, q, dim) relative to the first vertices."""
        (measures, gradients), w = self.gradients(), self.boundary_means()
        arms = (x - np.einsum("ci,cia->ca", w, self.corners)[:, None]) / measures[:, None, None]
        return np.asarray(np.matmul(arms, gradients.transpose(0, 2, 1)) + w[:, None])

    def chunks(self) -> Iterator[CellGroup]:
        """Yield pieces of the group; all n x n matrices of a piece together have about `CACHED_NUMBERS` entries."""
        size = max(1, CACHED_NUMBERS // self.nodes.shape[1] ** 2)
        for start in range(0, len(self.cells), size):
            yield self.part(slice(start, start + size))

    def part(self, places: Ints | slice) -> Self:
        """Return the group of some cells, given by their positions in this group."""
        own = [field.name for field in fields(self) if field.name != "points"]
        return replace(self, **{name: getattr(self, name)[places] for name in own})


# Polyhedral cells: with b_i and a_i of all faces f (b_i outward for the cell), Gauss' theorem gives
#
#     |K| G_i = sum_f b_{f,i},   |K| = sum_i x_i . |K| G_i / 3,   w_i = sum_f a_{f,i} / |dK|.
@dataclass(frozen=True, eq=False)
class PolyhedronGroup(CellGroup):
    """A group of polyhedra with equally many vertices; the vertices of each cell are in ascending order."""

    vector_shares: Floats  # (c, n, 3) |K| G_i
    shares: Floats  # (c, n) sum_f a_{f,i}
    diameters: Floats
    centroids: Floats

    def gradients(self) -> tuple[Floats, Floats]:
        """Return |K| (c,), and |K| G_i (c, n, 3)."""
        return np.einsum("cia,cia->c", self.corners, self.vector_shares) / 3.0, self.vector_shares

    def boundary_means(self) -> Floats:
        """Return the weights (c, n) of vertex values in the mean over the surface of a cell."""
        return self.shares / self.shares.sum(axis=1)[:, None]

    @property
    def stabilised_size(self) -> Floats:
        """The diameters h_K, (c,)."""
        return self.diameters

    def quadrature(self) -> tuple[Floats, Floats, Ints]:
        """Return centroids, volumes and positions of the cells: a rule of one point per cell, exact for degree 1."""
        return self.centroids, self.gradients()[0], np.arange(len(self.cells))


def second_moments(about: Floats) -> Floats:
    """Return int_K x x' dx, (c, 2, 2), of polygons with the vertices (c, n, 2) about the origin."""
    after = np.roll(about, -1, axis=1)
    # The integral over the triangle (0, p, q) is (p x q) / 24 (pp' + qq' + (p + q)(p + q)').
    part = cross(about, after) / 24.0
    sums = [np.einsum("ci,cia,cib->cab", part, p, p) for p in (about, after, about + after)]
    return np.asarray(sums[0] + sums[1] + sums[2])


# Cells of bodies of revolution, in the coordinates (r, z): formulas of docs/theory/virtual_elements.md.
@dataclass(frozen=True, eq=False)
class RingGroup(CellGroup):
    """A group of cells of a body of revolution: all integrals are over the full turn."""

    FREE = (0.0, 1.0)

    @cached_property
    def centres(self) -> Floats:
        """The centroids (c, 2), relative to the first vertex of each cell."""
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
        """Return the means (c, n) of Pi phi_i over each cell: these fractions make loads f / r exact for constant f."""
        return self.values_at(self.centres[:, None])[:, 0]

    def strain_rows(self) -> tuple[Floats, Floats]:
        """Return 2 pi V (c,), and 2 pi V times the mean strains (c, 4, n, 2): rr, zz, rz and the hoop strain."""
        areas, g = self.gradients()
        outward = right_of(np.roll(self.corners, -1, axis=1) - self.corners)
        # With r relative to the centroid, a body far from the axis loses no digits.
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
        """Return the matrices (c, n, n) of 2 pi g'M g / r_c in the radial displacements of the vertices."""
        areas, g = self.gradients()
        rows = (g / areas[:, None, None]).transpose(0, 2, 1).copy()
        rows[:, 0] -= self.load_shares() / self.radii[:, None]
        M = second_moments(self.corners - self.centres[:, None])
        both = (np.pi / self.radii)[:, None, None] * np.matmul(rows.transpose(0, 2, 1), np.matmul(M, rows))
        return np.asarray(both + both.transpose(0, 2, 1))


def cell_groups(mesh: Mesh, axisymmetric: bool = False) -> tuple[CellGroup, ...]:
    """Return groups of cells by number of vertices, ascending; cell numbers ascend within a group."""
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
    """Return |K| G_i (k, 3) and sum_f a_{f,i} (k,) for all pairs of a cell and one of its nodes, in batches."""
    b, a = np.empty((len(mesh.face_vertices), 3)), np.empty(len(mesh.face_vertices))
    for start in range(0, mesh.n_faces, 4 * CHUNK_SIZE):  # A face needs a quarter of the memory of a cell.
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
