"""What the projection misses: tau h_K^(dim - 2) |(I - Pi) v|^2 in vertex values, added to the stiffness of every cell.

A triangle or tetrahedron misses nothing. What tau is stands in :mod:`.isotropic` and :mod:`.anisotropic`.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.vem.assembly import CHUNK
from vemcvx.vem.cells import CellGroup
from vemcvx.vem.space import Space


def add_stabilisation(blocks: Floats, cells: CellGroup, tau: Floats) -> None:
    """Add tau h_K^(dim - 2) (I - Pi)'(I - Pi), component by component, to local matrices (c, n, n, dim, dim)."""
    if cells.simplices:
        return
    stable = (tau * cells.stabilised_size)[:, None, None] * missed_products(cells.vertex_values())
    for axis in range(blocks.shape[-1]):
        blocks[..., axis, axis] += stable


def missed_products(Pi: Floats) -> Floats:
    """(I - Pi)'(I - Pi), (c, n, n), of the projection of vertex values: scalar products of what it misses."""
    missed = np.eye(Pi.shape[1]) - Pi
    product: Floats = np.matmul(missed.transpose(0, 2, 1), missed)
    # A matrix product may sum (i, j) and (j, i) in different orders.
    return 0.5 * (product + product.transpose(0, 2, 1))


def missed_squares(space: Space, u: Floats) -> Floats:
    """|(I - Pi) u|^2 at the vertices of each cell, (n_cells,), of nodal displacements (n_nodes, dim)."""
    squares = np.zeros(space.mesh.n_cells)
    for group in space.groups:
        for chunk in () if group.simplices else group.chunks(CHUNK):
            about = u[chunk.nodes] - u[chunk.nodes[:, :1]]
            missed = about - np.matmul(chunk.vertex_values(), about)
            squares[chunk.cells] = np.sum(missed**2, axis=(1, 2))
    return squares
