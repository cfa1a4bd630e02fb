"""What the projection misses: tau |(I - Pi) v|^2 in vertex values, which the stiffness adds on every cell.

A triangle misses nothing. What tau is stands in :mod:`.isotropic` and :mod:`.anisotropic`.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.vem.assembly import CHUNK
from vemcvx.vem.projection import vertex_values
from vemcvx.vem.space import Space


def add_stabilisation(blocks: Floats, corners: Floats, tau: Floats) -> None:
    """Add tau (I - Pi)'(I - Pi), component by component, to local matrices (c, n, n, 2, 2) of cells (c, n, 2)."""
    if corners.shape[1] == 3:
        return
    stable = tau[:, None, None] * missed_products(corners)
    blocks[..., 0, 0] += stable
    blocks[..., 1, 1] += stable


def missed_products(corners: Floats) -> Floats:
    """(I - Pi)'(I - Pi), (c, n, n): scalar products of the vertex values that Pi misses."""
    missed = np.eye(corners.shape[1]) - vertex_values(corners)
    product: Floats = np.matmul(missed.transpose(0, 2, 1), missed)
    # A matrix product may sum (i, j) and (j, i) in different orders.
    return 0.5 * (product + product.transpose(0, 2, 1))


def missed_squares(space: Space, u: Floats) -> Floats:
    """|(I - Pi) u|^2 at the vertices of each cell, (n_cells,), of nodal displacements (n_nodes, 2)."""
    squares = np.zeros(space.mesh.n_cells)
    for group in space.groups:
        for chunk in group.chunks(CHUNK) if group.nodes.shape[1] > 3 else ():
            about = u[chunk.nodes] - u[chunk.nodes[:, :1]]
            missed = about - np.matmul(vertex_values(chunk.corners), about)
            squares[chunk.cells] = np.sum(missed**2, axis=(1, 2))
    return squares
