"""Triangles (t, 3, 2), counter-clockwise: areas, places given by barycentric coordinates, and polygons cut into them.

Convex polygons are cut into fans, simple ones by clipping ears. An ear is a vertex whose triangle with its two
neighbours turns left and holds no other vertex; every simple polygon of more than three vertices has two (Meisters,
Amer. Math. Monthly 82 (1975)). The ear taken is the one that other vertices stay away from most, which needs no
tolerance, and takes vertices on straight sides first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.polygons.segments import cross

# Barycentric coordinates of the inner three-point rule of degree 2; its weights are equal.
INNER = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)
# Those of Radon's seven points (Monatsh. Math. 52 (1948)), exact for degree 5, and their weights, which add up to one:
# the centroid with 9/40, and with s = (6 -+ sqrt 15) / 21 the points (s, s, 1 - 2s) with (155 -+ sqrt 15) / 1200 each.
_NEAR, _FAR = (6.0 - np.sqrt(15.0)) / 21.0, (6.0 + np.sqrt(15.0)) / 21.0
RADON_POINTS = np.concatenate(
    [np.full((1, 3), 1.0 / 3.0), *(np.full((3, 3), s) + (1.0 - 3.0 * s) * np.eye(3) for s in (_NEAR, _FAR))]
)
RADON_WEIGHTS = np.repeat([0.225, (155.0 - np.sqrt(15.0)) / 1200.0, (155.0 + np.sqrt(15.0)) / 1200.0], [1, 3, 3])


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


def clip_ears(corners: Floats) -> Ints:
    """Triangles (c, n - 2, 3) of simple polygons (c, n, 2), vertices on straight sides included; counter-clockwise.

    Their signed areas add up to the polygon's.
    """
    c, n, _ = corners.shape
    left = np.broadcast_to(np.arange(n), (c, n))
    triangles = np.empty((c, n - 2, 3), dtype=np.int64)
    for step in range(n - 3):
        ear = np.argmin(_intrusion(np.take_along_axis(corners, left[:, :, None], axis=1)), axis=1)
        around = (ear[:, None] + np.array([-1, 0, 1])) % (n - step)
        triangles[:, step] = np.take_along_axis(left, around, axis=1)
        stays = np.arange(n - step) != ear[:, None]
        left = left[stays].reshape(c, n - step - 1)
    triangles[:, n - 3] = left
    return triangles


def _intrusion(x: Floats) -> Floats:
    """How deep other vertices reach into the triangle at each vertex, (c, m): below zero for ears only."""
    before, after = np.roll(x, 1, axis=1), np.roll(x, -1, axis=1)
    depth = np.minimum(np.minimum(_side(before, x, x), _side(x, after, x)), _side(after, before, x))
    m = x.shape[1]
    vertex = np.arange(m)
    for shift in (-1, 0, 1):
        depth[:, vertex, (vertex + shift) % m] = -np.inf
    return np.where(cross(x - before, after - x) >= 0.0, depth.max(axis=2), np.inf)


def _side(a: Floats, b: Floats, x: Floats) -> Floats:
    """Twice the area of (a_i, b_i, x_j), (c, m, m): positive where x_j lies left of the line from a_i to b_i."""
    return cross((b - a)[:, :, None], x[:, None] - a[:, :, None])
