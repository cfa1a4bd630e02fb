"""The projection Pi of functions known at vertices, on polygons, plane faces and polyhedra, and its integrals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Self

import numpy as np

from vemcvx.base.arrays import SOME, Bools, Floats, Ints, read_only, totals
from vemcvx.meshes import Mesh, PolyhedralMesh
from vemcvx.meshes.polygons import (
    RADON_POINTS,
    RADON_WEIGHTS,
    diagonals_of,
    spans,
)


# The projection Pi_K of Section 3 in vertex values.
#
# For v in (W_K^h)^2, (3.11), the paper fixes the linear field Pi_K v by three conditions: for all linear q
#
#     (eps(Pi v), eps(q))_K = (eps(v), eps(q))_K,   int_dK Pi v ds = int_dK v ds,   int_K rot Pi v dx = int_K rot v dx.
#
# eps(q) runs through all constant symmetric matrices, so the first says that eps(Pi v) is the mean of eps(v) over K,
# the third that the rotation of Pi v is the mean rotation. Together: grad Pi v = 1/|K| int_K grad v dx, component by
# component, as if each were projected on its own. By Gauss, with v linear on the edges e_i = [x_i, x_{i+1}] of
# outward normal n_i (|e_i| n_i = (y_{i+1} - y_i, x_i - x_{i+1})),
#
#     grad Pi v = 1/|K| int_dK v (x) n ds = sum_i v_i (x) G_i,
#     G_i = (|e_{i-1}| n_{i-1} + |e_i| n_i) / (2|K|) = (y_{i+1} - y_{i-1}, x_{i-1} - x_{i+1}) / (2|K|),
#
# and the second condition fixes the constant:
#
#     Pi v(x) = sum_i w_i v_i + grad Pi v (x - xbar),   w_i = (|e_{i-1}| + |e_i|) / (2|dK|),   xbar = sum_i w_i x_i.
#
# Nothing here divides by an edge length, so edges may be as short as round-off lets them be; all quantities are
# homogeneous in the coordinates, so that scaling these by a power of two changes no bit of G |K| / h, w and Pi.
def area_gradients(corners: Floats) -> tuple[Floats, Floats]:
    """Areas |K| (c,) and |K| G_i (c, n, 2) of cells (c, n, 2), counter-clockwise, relative to a point of the cell.

    |K| = sum_i x_i |K| (G_i)_x: the very sum that makes the gradient of x one.
    """
    chord = np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1)
    gradients = np.empty_like(corners)
    np.multiply(chord[:, :, 1], 0.5, out=gradients[:, :, 0])
    np.multiply(chord[:, :, 0], -0.5, out=gradients[:, :, 1])
    return np.einsum("ci,ci->c", corners[:, :, 0], gradients[:, :, 0]), gradients


def boundary_weights(corners: Floats) -> Floats:
    """Weights w_i (c, n) of the mean over the boundary of a function linear on edges."""
    edge = np.roll(corners, -1, axis=1) - corners
    length = np.sqrt(np.einsum("cia,cia->ci", edge, edge))
    both = length + np.roll(length, 1, axis=1)
    return both / both.sum(axis=1)[:, None]


def tangents_of(normals: Floats) -> Floats:
    """(k, dim - 1, dim) orthonormal vectors across each unit normal (k, dim); exact where the normal is an axis.

    In the plane the normal turned by +90 degrees, so that the body lies on its left. In space the axis furthest from
    the normal, projected, and a second one that makes (t1, t2, n) right-handed.
    """
    if normals.shape[1] == 2:
        return np.stack([-normals[:, 1] + 0.0, normals[:, 0]], axis=1)[:, None, :]
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = axis - np.einsum("ki,ki->k", axis, normals)[:, None] * normals
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([first, np.cross(normals, first)], axis=1) + 0.0


# Functions on plane faces of polyhedra, given by the vertices: integrals that are exact for linear functions.
#
# A face is fanned from the mean of its outline, c = sum_i w_i x_i with w_i = (|e_{i-1}| + |e_i|) / (2 |df|), where a
# function takes the value sum_i w_i v_i, and is linear on each triangle (c, x_i, x_{i+1}). With N_i the area vectors
# of these and N their sum,
#
#     int_f v nu = sum_i b_i v_i,   b_i = (N_{i-1} + N_i) / 3 + w_i N / 3,   a_i = int_f phi_i = |b_i|,
#
# so that a_i is A/3 on triangles, A/4 on rectangles, and positive: contact has weights that are. Both cells of a face
# share its triangles, so the sum of the b_i over a closed surface vanishes even if faces are warped by rounding. A
# face that c does not see all of is cut into triangles along diagonals, without c.
@dataclass(frozen=True, kw_only=True, eq=False)
class FaceGroup:
    """Faces with equally many vertices, cut into equally many triangles."""

    faces: Ints  # (f,) face numbers
    nodes: Ints  # (f, n) their vertices; the right-hand rule gives the normal
    origin: Floats  # (f, 3) the first vertex
    corners: Floats  # (f, n + 1, 3) the vertices relative to the first, and c
    weights: Floats  # (f, n) w_i
    triangles: Ints  # (f, T, 3) numbers below n + 1

    @cached_property
    def vectors(self) -> Floats:
        """(f, T, 3) area vectors of the triangles."""
        a, b, c = self._of_triangles(self.corners).transpose(2, 0, 1, 3)
        return 0.5 * np.cross(b - a, c - a)

    @property
    def vector_shares(self) -> Floats:
        """(f, n, 3) the b_i."""
        third = self.vectors / 3.0
        return self._to_vertices(np.repeat(third[:, :, None], 3, axis=2))

    @property
    def shares(self) -> Floats:
        """(f, n) the a_i."""
        third = np.linalg.norm(self.vectors, axis=2)[:, :, None] / 3.0
        return self._to_vertices(np.repeat(third, 3, axis=2))

    def quadrature(self) -> tuple[Floats, Floats]:
        """Points (f, q, 3) of the faces, and shares (f, n, q): weights times basis functions, exact for degree 5."""
        f, count = self.triangles.shape[:2]
        within = np.einsum("qk,ftki->ftqi", RADON_POINTS, self._of_triangles(self.corners))
        each = np.linalg.norm(self.vectors, axis=2)[:, :, None, None] * (RADON_WEIGHTS[:, None] * RADON_POINTS).T
        shares = np.zeros((f, self.corners.shape[1], count, len(RADON_WEIGHTS)))
        rows = np.arange(f)
        for t in range(count):
            for k in range(3):
                shares[rows, self.triangles[:, t, k], t] += each[:, t, k]
        n = self.nodes.shape[1]
        spread = shares[:, :n] + self.weights[:, :, None, None] * shares[:, n:]
        return self.origin[:, None] + within.reshape(f, -1, 3), spread.reshape(f, n, -1)

    def _of_triangles(self, values: Floats) -> Floats:
        """(f, T, 3, ...) of values (f, n + 1, ...)."""
        return values[np.arange(len(values))[:, None, None], self.triangles]

    def _to_vertices(self, values: Floats) -> Floats:
        """Sums (f, n, ...) of what the corners of triangles have, (f, T, 3, ...)."""
        f, count = self.triangles.shape[:2]
        total, rows = np.zeros((f, self.corners.shape[1], *values.shape[3:])), np.arange(f)
        for t in range(count):
            for k in range(3):
                total[rows, self.triangles[:, t, k]] += values[:, t, k]
        n = self.nodes.shape[1]
        weights = self.weights.reshape(*self.weights.shape, *[1] * (values.ndim - 3))
        return total[:, :n] + weights * total[:, n:]


def face_groups(points: Floats, offsets: Ints, vertices: Ints, faces: Ints) -> Iterator[FaceGroup]:
    """Groups of faces with equally many vertices; face f has ``vertices[offsets[f]:offsets[f + 1]]``."""
    counts = (offsets[1:] - offsets[:-1])[faces]
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
        if sees.all():
            yield fans
            continue
        if sees.any():
            yield _some(fans, sees)
        cut = _some(fans, ~sees)
        yield replace(cut, triangles=_along_diagonals(cut.corners[:, :n]))


def _some(group: FaceGroup, mine: Bools) -> FaceGroup:
    return replace(group, **{field.name: getattr(group, field.name)[mine] for field in fields(group)})


def _fan(n: int) -> Ints:
    """The triangles (n, 3) of a fan from point n; a triangle is its own."""
    if n == 3:
        return np.arange(3)[None]
    return np.column_stack([np.full(n, n), np.arange(n), np.roll(np.arange(n), -1)])


def _along_diagonals(corners: Floats) -> Ints:
    """Triangles (f, n - 2, 3) of faces (f, n, 3)."""
    vector = 0.5 * np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
    plane = tangents_of(vector / np.linalg.norm(vector, axis=1)[:, None])
    return diagonals_of(np.einsum("fbi,fni->fnb", plane, corners))


CHUNK = 2**16
"""Numbers of eight bytes that stay in a second-level cache with a few temporaries of that size."""


@dataclass(frozen=True, eq=False)
class CellGroup:
    """Polygons with equally many vertices; polyhedra differ as `PolyhedronGroup` says."""

    cells: Ints  #: (c,) cell numbers
    nodes: Ints  #: (c, n) their vertices, of polygons counter-clockwise
    points: Floats  #: (n_nodes, dim) the points of the whole mesh

    @cached_property
    def corners(self) -> Floats:
        """Vertex coordinates (c, n, dim) relative to the first vertex of each cell.

        Differences of neighbouring coordinates are exact, products of coordinates near 1e6 are not: with
        this origin a body far away from the origin loses nothing more than its points were rounded by.
        """
        corners = self.points.take(self.nodes, axis=0)  # in half the time of an index
        corners -= corners[:, :1].copy()
        return read_only(corners)

    @property
    def simplices(self) -> bool:
        """True if the cells are triangles, or tetrahedra, on which Pi v = v."""
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
        (measures, gradients), w = self.gradients(), self.boundary_means()
        centre = np.einsum("ci,cia->ca", w, self.corners)
        arms = (self.corners - centre[:, None]) / measures[:, None, None]
        linear: Floats = np.matmul(arms, gradients.transpose(0, 2, 1))
        return linear + w[:, None, :]

    def chunks(self, entries: int = CHUNK) -> Iterator[CellGroup]:
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
# With b_{f,i} and a_{f,i} the shares of a node in a face (see `FaceGroup`), outward for the cell, Gauss' theorem gives
#
#     |K| G_i = sum_f b_{f,i},   grad Pi v = sum_i v_i (x) G_i,   |K| = sum_i x_i . |K| G_i / 3,
#     w_i = sum_f a_{f,i} / |dK|,
#
# the constant of Pi by the mean over the surface, as in the plane by that over the outline. All of it is
# homogeneous in the coordinates, and on a tetrahedron Pi v = v.
@dataclass(frozen=True, eq=False)
class PolyhedronGroup(CellGroup):
    """Polyhedra with equally many vertices, each cell's in ascending order."""

    vector_shares: Floats  # (c, n, 3) |K| G_i
    shares: Floats  # (c, n) sum_f a_{f,i}
    diameters: Floats
    centroids: Floats

    @property
    def shapes(self) -> tuple[Floats, ...]:
        """The shapes, as of polygons; sums over faces are rounded in the order in which these are numbered."""
        return (*super().shapes, self.vector_shares, self.shares, self.diameters)

    def gradients(self) -> tuple[Floats, Floats]:
        """As of polygons."""
        return np.einsum("cia,cia->c", self.corners, self.vector_shares) / 3.0, self.vector_shares

    def boundary_means(self) -> Floats:
        """As of polygons."""
        return self.shares / self.shares.sum(axis=1)[:, None]

    @property
    def stabilised_size(self) -> Floats:
        """h_K, (c,)."""
        return self.diameters

    def quadrature(self) -> tuple[Floats, Floats, Ints]:
        """One point a cell, the centroid: exact for degree 1."""
        return self.centroids, self.gradients()[0], np.arange(len(self.cells))


def cell_groups(mesh: Mesh) -> tuple[CellGroup, ...]:
    """The cells by number of vertices, ascending; cell numbers ascend within a group."""
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
            groups.append(CellGroup(*own))
    return tuple(groups)


def _shares_of_cells(mesh: PolyhedralMesh, offsets: Ints, nodes: Ints) -> tuple[Floats, Floats]:
    """|K| G_i (k, 3) and sum_f a_{f,i} (k,) of all pairs of a cell and its node; SOME faces, and cells, at a time."""
    b, a = np.empty((len(mesh.face_vertices), 3)), np.empty(len(mesh.face_vertices))
    for start in range(0, mesh.n_faces, 4 * SOME):  # A face takes a quarter of what a cell does.
        some = np.arange(start, min(start + 4 * SOME, mesh.n_faces))
        for group in face_groups(mesh.points, mesh.face_offsets, mesh.face_vertices, some):
            at = mesh.face_offsets[group.faces][:, None] + np.arange(group.nodes.shape[1])
            b[at], a[at] = group.vector_shares, group.shares
    vectors, areas = np.empty((len(nodes), 3)), np.empty(len(nodes))
    for start in range(0, mesh.n_cells, SOME):
        every = np.arange(start, min(start + SOME, mesh.n_cells))
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
