"""Triangles (t, 3, 2), counter-clockwise: areas, fans of convex polygons, places given by barycentric coordinates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.polygons.segments import cross

# Barycentric coordinates of the inner three-point rule of degree 2; its weights are equal.
INNER = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)


class Triangles(NamedTuple):
    """Triangles with their areas, and what each is a part of."""

    corners: Floats
    areas: Floats
    owner: Ints


def signed_areas(corners: Floats) -> Floats:
    """Areas (...,) of triangles (..., 3, 2), counter-clockwise positive."""
    return 0.5 * cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :])


def fans(polygons: Floats, owner: Ints) -> Triangles:
    """The triangles from the first vertex of convex polygons (p, m, 2), without the flat ones where vertices repeat."""
    first = np.broadcast_to(polygons[:, :1], polygons[:, 2:].shape)
    corners = np.stack([first, polygons[:, 1:-1], polygons[:, 2:]], axis=2)
    areas = signed_areas(corners)
    kept = areas > 0.0
    return Triangles(corners[kept], areas[kept], np.repeat(owner, kept.sum(axis=1)))


def places(corners: Floats, barycentric: Floats) -> Floats:
    """The points (t, q, 2) with the given barycentric coordinates (q, 3) in each triangle."""
    # Relative to the first vertex: a body far from the origin loses no digits.
    origin = corners[:, :1]
    within: Floats = np.matmul(barycentric, corners - origin)
    return origin + within
