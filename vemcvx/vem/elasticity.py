"""Elasticity on virtual elements: the stiffness matrix, strains and energies of cells, and rigid motions.

The form of a cell K is a_K^h(u, v) = |K| eps(Pi u)' C eps(Pi v) + S_K, (3.13) of the paper named in :mod:`vemcvx`. Here
Pi is the projection (:mod:`.projection`), C the elastic matrix, eps = (e_xx, e_yy, 2 e_xy) the strains, and S_K the
stabilisation (:mod:`.stabilisation`). On triangles and tetrahedra, Pi v = v and S_K = 0. In Kelvin's notation, the
elastic matrix is C_k = D C D with D = diag(1, 1, sqrt 2), in space diag(1, 1, 1, sqrt 2, sqrt 2, sqrt 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isqrt

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints
from vemcvx.vem.projection import CellGroup, RingGroup
from vemcvx.vem.space import Space
from vemcvx.vem.stabilisation import (
    Stabilisation,
    VertexWeights,
    add_stabilisation,
    products_of_remainder,
    remainder_energies,
    stabilisation_of,
)
from vemcvx.vem.tensors import elastic_matrix, moduli_of_revolution, stresses


def add_weights(blocks: Floats, cells: CellGroup, tau: Floats) -> None:
    """Add the stabilisation with moduli tau (c,) to local matrices (c, n, n, dim, dim)."""
    if cells.simplices:
        return
    stable = (tau * cells.stabilised_size)[:, None, None] * products_of_remainder(cells.vertex_values())
    for axis in range(blocks.shape[-1]):
        blocks[..., axis, axis] += stable


def stiffness(space: Space, lam: Floats, mu: Floats, stabilisation: str | Stabilisation = "shear") -> sp.csr_matrix:
    """Return the stiffness matrix for all n_u = dim * n_nodes nodal displacement components.

    Parameters
    ----------
    space : Space
    lam, mu : (n_cells,) arrays
        Lame's constants, force per area. In plane stress, `lam` is the reduced constant. Cells where both are zero have
        no stiffness.
    stabilisation : {"shear", "unit"}, or Stabilisation
        The stabilisation S_K: see :mod:`vemcvx.vem.stabilisation`.

    Returns
    -------
    (n_u, n_u) csr_matrix
        The exactly symmetric matrix, force per length. Plane bodies have the thickness 1. Zero entries are stored.

    Raises
    ------
    SceneError
        There is no stabilisation of this name, or a user's stabilisation returns no valid form.

    Examples
    --------
    >>> K = vx.vem.stiffness(vx.vem.Space(vx.meshes.squares(1)), np.array([1.0]), np.array([1.0]))
    >>> bool(abs(K @ np.ones(8)).max() < 1e-12)
    True
    """
    moduli = moduli_of_revolution(lam, mu) if space.axisymmetric else np.stack([lam, mu])
    return stiffness_of(space, moduli, stabilisation_of(stabilisation, mu))


def stiffness_of(space: Space, moduli: Floats, stabilisation: Stabilisation) -> sp.csr_matrix:
    """Return the stiffness matrix for the moduli of :func:`.tensors.elastic_matrix`."""
    filled, dim = (moduli != 0.0).any(axis=0), space.dim
    # Leave out cells without a material, unless no cell has a material.
    filled = filled if filled.any() else np.ones_like(filled)
    blocks, nodes = list[Floats](), list[Ints]()
    for group in space.groups:
        for cells in group.part(np.flatnonzero(filled[group.cells])).chunks():
            C = elastic_matrix(moduli[:, cells.cells], dim)
            local = consistent_blocks(cells, C)
            if isinstance(stabilisation, VertexWeights):
                add_weights(local, cells, stabilisation.tau[cells.cells])
            else:
                add_stabilisation(local, cells, stabilisation, C)
            blocks.append(local.reshape(-1, dim * dim))
            nodes.append(cells.nodes)
    return assemble(nodes, np.concatenate(blocks), space.mesh.n_nodes)


def assemble(nodes: Sequence[Ints], blocks: Floats, n_nodes: int) -> sp.csr_matrix:
    """Assemble a matrix from blocks (pairs, dim^2) for all vertex pairs (i, j) of cells.

    Pairs are ordered by cell, then by i, then by j.
    """
    keys = np.concatenate([(group[:, :, None] * n_nodes + group[:, None]).ravel() for group in nodes])
    order = np.argsort(keys, kind="stable")  # entries (i, j) and (j, i) are summed in the same order
    keys = keys[order]
    first = np.flatnonzero(np.diff(keys, prepend=-1))
    rows, columns = np.divmod(keys[first], n_nodes)
    del keys  # frees memory
    add = sp.csr_matrix((np.ones(len(order)), order, np.append(first, len(order))), shape=(len(first), len(blocks)))
    dim, starts = isqrt(blocks.shape[1]), np.searchsorted(rows, np.arange(n_nodes + 1))
    entries = (add @ blocks).reshape(-1, dim, dim), columns, starts
    return sp.bsr_matrix(entries, shape=(dim * n_nodes, dim * n_nodes)).tocsr()


def softest_shear(C: Floats) -> Floats:
    """Return the smallest eigenvalues (n_cells,) of C_k on deviatoric strains."""
    return np.maximum(_deviatoric_moduli(C)[:, 0], 0.0)


def mean_shear(C: Floats) -> Floats:
    """Return harmonic means of deviatoric eigenvalues, or 0 if an eigenvalue is not positive."""
    moduli = _deviatoric_moduli(C)
    positive = moduli[:, 0] > 0
    inverses = 1.0 / np.where(positive[:, None], moduli, 1.0)
    return np.where(positive, 1.0 / inverses.mean(axis=1), 0.0)


def _deviatoric_moduli(C: Floats) -> Floats:
    """Return the ascending eigenvalues (n_cells, 2 or 5) of C_k on deviatoric strains."""
    basis, across = np.zeros((2, 3)), 1
    basis[0, :2] = np.array([1.0, -1.0]) / np.sqrt(2.0)
    if C.shape[1] == 4:  # In a body of revolution, the hoop component is last.
        C = C[:, [0, 1, 3, 2]][:, :, [0, 1, 3, 2]]
    if C.shape[1] > 3:
        basis, across = np.zeros((C.shape[1] - 1, C.shape[1])), C.shape[1] - 3
        basis[0, :2], basis[1, :3] = np.array([1.0, -1.0]) / np.sqrt(2.0), np.array([1.0, 1.0, -2.0]) / np.sqrt(6.0)
    basis[-across:, -across:] = np.sqrt(2.0) * np.eye(across)
    return np.asarray(np.linalg.eigvalsh(basis @ C @ basis.T))


def consistent_blocks(cells: CellGroup, C: Floats) -> Floats:
    """Return the local matrices of |K| eps(Pi u)' C eps(Pi v) for c cells with n vertices each.

    Parameters
    ----------
    cells : CellGroup
    C : (c, 3, 3) array, in space (c, 6, 6)
        Elastic matrices, force per area.

    Returns
    -------
    (c, n, n, dim, dim) array
        Entry (K, i, j, a, b) couples component a of vertex i with component b of vertex j.

    Examples
    --------
    >>> [cells] = vx.vem.Space(vx.meshes.squares(1)).groups
    >>> vx.vem.consistent_blocks(cells, np.eye(3)[None]).shape
    (1, 4, 4, 2, 2)
    """
    measures, rows = cells.strain_rows()
    count, components, n, dim = rows.shape
    B = rows.reshape(count, components, n * dim)
    blocks = np.asarray(np.matmul(B.transpose(0, 2, 1), np.matmul(C / measures[:, None, None], B)))
    blocks = 0.5 * (blocks + blocks.transpose(0, 2, 1))
    blocks = blocks.reshape(count, n, dim, n, dim).transpose(0, 1, 3, 2, 4)
    if isinstance(cells, RingGroup):
        blocks[..., 0, 0] += 2.0 * C[:, 2, 2, None, None] * cells.hoop_variation()
    return blocks


def cell_energies(space: Space, moduli: Floats, stabilisation: Stabilisation, u: Floats) -> Floats:
    """Return a_K^h(u, u), twice the elastic energies. Bodies of revolution are not allowed."""
    strain = strains(space, u)
    density = np.sum(strain * stresses(moduli, strain), axis=1)
    missed = remainder_energies(space, stabilisation, elastic_matrix(moduli, space.dim), u)
    return np.asarray(space.mesh.measures * density + missed)


def strains(space: Space, u: Floats) -> Floats:
    """Return the mean strain eps(Pi u) of a virtual function u on each cell.

    Parameters
    ----------
    space : Space
    u : (n_nodes, dim) or (n_u,) array
        Nodal displacements.

    Returns
    -------
    (n_cells, components) array
        In the plane: e_xx, e_yy, 2 e_xy. In space: e_xx, e_yy, e_zz, 2 e_xy, 2 e_yz, 2 e_xz. In bodies of revolution:
        e_rr, e_zz, 2 e_rz, and the hoop strain.

    Examples
    --------
    >>> space = vx.vem.Space(vx.meshes.squares(1))
    >>> vx.vem.strains(space, space.mesh.points).round(9)
    array([[1., 1., 0.]])
    """
    u = np.reshape(u, (-1, space.dim))
    result = np.empty((space.mesh.n_cells, space.components))
    for group in space.groups:
        for chunk in group.chunks():
            result[chunk.cells] = chunk.strains(u.take(chunk.nodes, axis=0))
    return result


def rigid_modes(points: Floats) -> Floats:
    """Return the rigid motions in columns, (n_u, 3) or (n_u, 6): translations along the axes, then rotations.

    The rotation in the plane is (-y, x). The rotations in space are (0, -z, y), (z, 0, -x) and (-y, x, 0).
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
    """Split coefficients of rigid modes into translations and rotations."""
    return (mode[:2], mode[2:]) if len(mode) == 3 else (mode[:3], mode[3:])
