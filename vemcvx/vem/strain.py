"""Strains of Pi u, and the motions without strain."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.vem.assembly import CHUNK
from vemcvx.vem.projection import area_gradients
from vemcvx.vem.space import Space


def strains(space: Space, u: Floats) -> Floats:
    """The mean strain of a virtual function on each cell, eps(Pi u), (3.13): e_xx, e_yy and 2 e_xy, (n_cells, 3).

    u are nodal displacements, (n_nodes, 2) or (2 n_nodes,).
    """
    u = np.reshape(u, (-1, 2))
    result = np.empty((space.mesh.n_cells, 3))
    for group in space.groups:
        for chunk in group.chunks(CHUNK):
            areas, g = area_gradients(chunk.corners)
            v = u[chunk.nodes]
            # Differences from a vertex: a rigid translation much larger than the deformation costs no digits.
            v -= v[:, :1]
            slope = np.matmul(v.transpose(0, 2, 1), g) / areas[:, None, None]
            result[chunk.cells, 0] = slope[:, 0, 0]
            result[chunk.cells, 1] = slope[:, 1, 1]
            result[chunk.cells, 2] = slope[:, 0, 1] + slope[:, 1, 0]
    return result


def rigid_modes(points: Floats) -> Floats:
    """The infinitesimal rigid motions (2 n_nodes, 3): translations along x and y, the rotation (-y, x) about (0, 0)."""
    modes = np.zeros((*points.shape, 3))
    modes[:, 0, 0] = 1.0
    modes[:, 1, 1] = 1.0
    modes[:, 0, 2] = -points[:, 1]
    modes[:, 1, 2] = points[:, 0]
    return modes.reshape(-1, 3)
