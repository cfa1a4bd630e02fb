"""Pi v at points of cells, from vertex values: Pi v(x) = sum_i (w_i + G_i . (x - xbar)) v_i, as in `vem.projection`."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.vem.projection import area_gradients, boundary_weights
from vemcvx.vem.space import Space

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def point_values(space: Space, cells: Ints, points: Floats) -> sp.csr_matrix:
    """The matrix (p, n_nodes) that takes nodal values to those of Pi v at points.

    Parameters
    ----------
    space : Space
    cells : (p,) array of int
        The cell whose linear field is asked for at each point.
    points : (p, 2) array
    """
    mesh = space.mesh
    counts = np.diff(mesh.offsets)[cells]
    matrix = sp.csr_matrix((len(cells), mesh.n_nodes))
    for n in np.unique(counts):
        rows = np.flatnonzero(counts == n)
        nodes = mesh.vertices[mesh.offsets[cells[rows]][:, None] + np.arange(n)]
        first = mesh.points[nodes[:, 0]]
        corners = mesh.points[nodes] - first[:, None]
        areas, g = area_gradients(corners)
        w = boundary_weights(corners)
        arm = points[rows] - first - np.einsum("ci,cia->ca", w, corners)
        values = w + np.einsum("cia,ca->ci", g, arm / areas[:, None])
        matrix = matrix + sp.csr_matrix((values.ravel(), (np.repeat(rows, n), nodes.ravel())), shape=matrix.shape)
    return matrix
