"""Strains of Pi u, and the motions without strain."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.vem.assembly import CHUNK
from vemcvx.vem.hooke import COMPONENTS
from vemcvx.vem.space import Space


def strains(space: Space, u: Floats) -> Floats:
    """The mean strain of a virtual function on each cell, eps(Pi u), (3.13): (n_cells, components).

    These are e_xx, e_yy and 2 e_xy in the plane, and e_xx, e_yy, e_zz, 2 e_xy, 2 e_yz, 2 e_xz in space. u are nodal
    displacements, (n_nodes, dim) or (n_u,).
    """
    dim = space.mesh.points.shape[1]
    u = np.reshape(u, (-1, dim))
    result = np.empty((space.mesh.n_cells, len(COMPONENTS[dim])))
    for group in space.groups:
        for chunk in group.chunks(CHUNK):
            measures, g = chunk.gradients()
            v = u[chunk.nodes]
            # Differences from a vertex: a rigid translation much larger than the deformation costs no digits.
            v -= v[:, :1]
            slope = np.matmul(v.transpose(0, 2, 1), g) / measures[:, None, None]
            for k, (a, b) in enumerate(COMPONENTS[dim]):
                result[chunk.cells, k] = slope[:, a, a] if a == b else slope[:, a, b] + slope[:, b, a]
    return result


def rigid_modes(points: Floats) -> Floats:
    """The infinitesimal rigid motions (n_u, 3 or 6): translations along the axes, then rotations about the origin.

    In the plane the rotation is (-y, x), in space they are (0, -z, y), (z, 0, -x) and (-y, x, 0).
    """
    dim = points.shape[1]
    turns = ((0, 1),) if dim == 2 else ((1, 2), (2, 0), (0, 1))
    modes = np.zeros((*points.shape, dim + len(turns)))
    for axis in range(dim):
        modes[:, axis, axis] = 1.0
    for k, (a, b) in enumerate(turns, start=dim):
        modes[:, a, k] = -points[:, b]
        modes[:, b, k] = points[:, a]
    return modes.reshape(-1, modes.shape[2])


def split_motion(mode: Floats) -> tuple[Floats, Floats]:
    """The translation and the rotation, one number in the plane and three in space, of a sum of rigid modes."""
    return (mode[:2], mode[2:]) if len(mode) == 3 else (mode[:3], mode[3:])
