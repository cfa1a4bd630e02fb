"""Orthonormal tangents at nodes of the boundary, chosen once a normal: nothing may depend on which they are."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats


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
