"""Loads of Section 3, before (3.14): matrices that turn point values of a force into a nodal load vector.

    <l^h, v> = sum_K int_K Pi_0^0 f_1 . v_hat dx + int_{Gamma_N} f_2 . v ds,

where v_hat is the average of the vertex values of v on K: each vertex of K takes an equal part of the cell's
force int_K f_1 dx. Traces are linear, and two Gauss points an edge integrate f_2 . v exactly for f_2 of
degree 2.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints
from vemcvx.vem.boundary import BoundaryPart
from vemcvx.vem.projection import area_gradients
from vemcvx.vem.quadrature import cell_quadrature
from vemcvx.vem.space import Space

# Cells are taken in pieces of a few tens of megabytes.
CHUNK = 2**22


def edge_load(space: Space, part: BoundaryPart) -> tuple[Floats, sp.csr_matrix]:
    """The load of a force per length on a part of the boundary.

    Returns
    -------
    points : (q, 2) array
        Two Gauss points an edge.
    matrix : (2 n_nodes, 2 q) csr_matrix
        ``matrix @ f(points).ravel()`` is the nodal load; exact for f of degree 2 on edges.
    """
    points, shares = part.gauss(2)
    m = len(part.edges)
    nodes = np.repeat(part.edges, 2, axis=0)
    matrix = _spread(nodes, shares.transpose(0, 2, 1).reshape(2 * m, 2), space.mesh.n_nodes)
    return points.reshape(-1, 2), matrix.tocsr()


def cell_load(space: Space) -> tuple[Floats, sp.csr_matrix, Ints]:
    """The load of a force per area, (Pi_0^0 f, average of the vertex values).

    Returns
    -------
    points : (q, 2) array
        Points inside the cells: :func:`vemcvx.vem.quadrature.cell_quadrature`.
    matrix : (2 n_nodes, 2 q) csr_matrix
        ``matrix @ f(points).ravel()`` is the nodal load; exact for f of degree 2 on cells.
    cells : (q,) array of int
        The cell of each point.
    """
    points, matrices, cells = [], [], []
    for group in space.groups:
        n = group.nodes.shape[1]
        for chunk in group.chunks(CHUNK):
            x, weights, owner = cell_quadrature(chunk)
            points.append(x)
            cells.append(chunk.cells[owner])
            shares = np.repeat(weights[:, None] / n, n, axis=1)
            matrices.append(_spread(chunk.nodes[owner], shares, space.mesh.n_nodes))
    return np.concatenate(points), sp.hstack(matrices, format="csc").tocsr(), np.concatenate(cells)


def stress_load(space: Space) -> sp.csr_matrix:
    """The virtual work of stresses that are constant on cells, sum_K |K| sigma : eps(Pi v).

    Returns
    -------
    (2 n_nodes, 3 n_cells) csr_matrix
        ``matrix @ sigma.ravel()`` for sigma (n_cells, 3), (xx, yy, xy).
    """
    rows, columns, values = [], [], []
    for group in space.groups:
        g = area_gradients(group.corners)[1]
        x, y = 2 * group.nodes, 2 * group.nodes + 1
        cell = 3 * np.repeat(group.cells[:, None], g.shape[1], axis=1)
        rows += [x, y, x, y]
        columns += [cell, cell + 1, cell + 2, cell + 2]
        values += [g[:, :, 0], g[:, :, 1], g[:, :, 1], g[:, :, 0]]
    v, i, j = (np.concatenate([part.ravel() for part in parts]) for parts in (values, rows, columns))
    return sp.coo_matrix((v, (i, j)), shape=(space.n_unknowns, 3 * space.mesh.n_cells)).tocsr()


def _spread(nodes: Ints, shares: Floats, n_nodes: int) -> sp.csc_matrix:
    """(2 n_nodes, 2 q) from the nodes (q, n) that each point loads, and the share of each, (q, n)."""
    q, n = nodes.shape
    rows = 2 * nodes[:, None, :] + np.arange(2)[:, None]
    values = np.repeat(shares[:, None, :], 2, axis=1)
    indptr = np.arange(0, 2 * q * n + 1, n)
    return sp.csc_matrix((values.ravel(), rows.ravel(), indptr), shape=(2 * n_nodes, 2 * q))
