"""Loads of Section 3, before (3.14): matrices that turn point values of a force into a nodal load vector.

    <l^h, v> = sum_K int_K Pi_0^0 f_1 . v_hat dx + int_{Gamma_N} f_2 . v ds,

where v_hat is the average of the vertex values of v on K: each vertex of K takes an equal part of the cell's
force int_K f_1 dx. Traces are linear, and two Gauss points an edge integrate f_2 . v exactly for f_2 of
degree 2; seven points a triangle of a face, for f_2 of degree 4.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints
from vemcvx.vem.hooke import COMPONENTS
from vemcvx.vem.quadrature import cell_quadrature
from vemcvx.vem.space import Part, Space

# Gauss points on an edge.
GAUSS = 2
# Cells are taken in pieces of a few tens of megabytes.
CHUNK = 2**22


def edge_load(space: Space, part: Part) -> tuple[Floats, sp.csr_matrix, Ints]:
    """The load of a force per length, in space per area, on a part of the boundary.

    Returns
    -------
    points : (q, dim) array
        Two Gauss points an edge; seven a triangle of a face.
    matrix : (n_u, dim q) csr_matrix
        ``matrix @ f(points).ravel()`` is the nodal load; exact for f of degree 2 on edges, 4 on faces.
    sides : (q,) array of int
        The side of each point, as a place in the part.
    """
    rules = part.rules(GAUSS)
    points = np.concatenate([rule.points.reshape(-1, space.dim) for rule in rules])
    sides = np.concatenate([np.repeat(rule.sides, rule.points.shape[1]) for rule in rules])
    matrices = []
    for rule in rules:
        m, n, q = rule.shares.shape
        nodes = np.repeat(rule.nodes, q, axis=0)
        matrices.append(_spread(nodes, rule.shares.transpose(0, 2, 1).reshape(m * q, n), space))
    return points, sp.hstack(matrices, format="csc").tocsr(), sides


def cell_load(space: Space) -> tuple[Floats, sp.csr_matrix, Ints]:
    """The load of a force per area, (Pi_0^0 f, average of the vertex values).

    Returns
    -------
    points : (q, dim) array
        Points inside the cells: :func:`vemcvx.vem.quadrature.cell_quadrature`.
    matrix : (n_u, dim q) csr_matrix
        ``matrix @ f(points).ravel()`` is the nodal load; exact for f of degree 2 on polygons, 1 on polyhedra.
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
            matrices.append(_spread(chunk.nodes[owner], shares, space))
    return np.concatenate(points), sp.hstack(matrices, format="csc").tocsr(), np.concatenate(cells)


def stress_load(space: Space) -> sp.csr_matrix:
    """The virtual work of stresses that are constant on cells, sum_K |K| sigma : eps(Pi v).

    Returns
    -------
    (n_u, components n_cells) csr_matrix
        ``matrix @ sigma.ravel()`` for sigma (n_cells, components), in the order of :mod:`vemcvx.vem.hooke`.
    """
    dim, components = space.dim, COMPONENTS[space.dim]
    rows, columns, values = [], [], []
    for group in space.groups:
        g = group.gradients()[1]
        cell = np.repeat(group.cells[:, None] * len(components), g.shape[1], axis=1)
        for k, (a, b) in enumerate(components):
            for force, slope in {(a, b), (b, a)}:
                rows.append(dim * group.nodes + force)
                columns.append(cell + k)
                values.append(g[:, :, slope])
    v, i, j = (np.concatenate([part.ravel() for part in parts]) for parts in (values, rows, columns))
    return sp.coo_matrix((v, (i, j)), shape=(space.n_unknowns, len(components) * space.mesh.n_cells)).tocsr()


def _spread(nodes: Ints, shares: Floats, space: Space) -> sp.csc_matrix:
    """(n_u, dim q) from the nodes (q, n) that each point loads, and the share of each, (q, n)."""
    (q, n), dim = nodes.shape, space.dim
    rows = dim * nodes[:, None, :] + np.arange(dim)[:, None]
    values = np.repeat(shares[:, None, :], dim, axis=1)
    indptr = np.arange(0, dim * q * n + 1, n)
    return sp.csc_matrix((values.ravel(), rows.ravel(), indptr), shape=(space.n_unknowns, dim * q))
