"""Plane faces of polyhedra: functions on them given by the vertices, and orthonormal tangents."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.polygons.geometry import RADON_POINTS, RADON_WEIGHTS, clip_ears
from vemcvx.vem.projection import boundary_weights

# Orthonormal tangents at nodes of the boundary, chosen once a normal: nothing may depend on which they are.


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
# face that c does not see all of is cut into triangles by clipping ears, without c.


@dataclass(frozen=True, kw_only=True, eq=False)
class FaceGroup:
    """Faces with equally many vertices, cut into equally many triangles."""

    faces: Ints
    """(f,) face numbers"""
    nodes: Ints
    """(f, n) their vertices; the right-hand rule gives the normal"""
    origin: Floats
    """(f, 3) the first vertex"""
    corners: Floats
    """(f, n + 1, 3) the vertices relative to the first, and c"""
    weights: Floats
    """(f, n) w_i"""
    triangles: Ints
    """(f, T, 3) numbers below n + 1"""

    @cached_property
    def vectors(self) -> Floats:
        """(f, T, 3) area vectors of the triangles."""
        return area_vectors(self._of_triangles(self.corners))

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
        shared: Floats = total[:, :n] + weights * total[:, n:]
        return shared


def face_groups(points: Floats, offsets: Ints, vertices: Ints, faces: Ints) -> Iterator[FaceGroup]:
    """Those of some faces, face f having the vertices ``vertices[offsets[f]:offsets[f + 1]]``."""
    counts = (offsets[1:] - offsets[:-1])[faces]
    for n in np.unique(counts):
        some = faces[counts == n]
        nodes = vertices[offsets[some][:, None] + np.arange(n)]
        corners = points[nodes] - points[nodes[:, :1]]
        weights = boundary_weights(corners)
        corners = np.concatenate([corners, np.einsum("fi,fia->fa", weights, corners)[:, None]], axis=1)
        triangles = np.broadcast_to(_fan(n), (len(some), *_fan(n).shape))
        fans = FaceGroup(
            faces=some,
            nodes=nodes,
            origin=points[nodes[:, 0]],
            corners=corners,
            weights=weights,
            triangles=triangles,
        )
        sees = np.einsum("fti,fi->ft", fans.vectors, fans.vectors.sum(axis=1)).min(axis=1) > 0.0
        if sees.all():
            yield fans
            continue
        if sees.any():
            yield _some(fans, sees)
        cut = _some(fans, ~sees)
        yield replace(cut, triangles=_ears(cut.corners[:, :n]))


def _some(group: FaceGroup, mine: Bools) -> FaceGroup:
    return replace(group, **{field.name: getattr(group, field.name)[mine] for field in fields(group)})


def area_vectors(triangles: Floats) -> Floats:
    """(..., 3) of triangles (..., 3, 3) in space."""
    a, b, c = (triangles[..., k, :] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def _fan(n: int) -> Ints:
    """The triangles (n, 3) of a fan from point n; a triangle is its own."""
    if n == 3:
        return np.arange(3)[None]
    return np.column_stack([np.full(n, n), np.arange(n), np.roll(np.arange(n), -1)])


def _ears(corners: Floats) -> Ints:
    """Triangles (f, n - 2, 3) of faces (f, n, 3)."""
    vector = 0.5 * np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
    plane = tangents_of(vector / np.linalg.norm(vector, axis=1)[:, None])
    return clip_ears(np.einsum("fbi,fni->fnb", plane, corners))
