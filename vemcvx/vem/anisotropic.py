"""The stiffness matrix of a^h, (3.13), for any elastic matrix C (3, 3) a cell.

    a_K^h(u, v) = |K| eps(Pi u)' C eps(Pi v) + tau sum_i chi_i(u - Pi u) chi_i(v - Pi v),   eps = (e_xx, e_yy, 2 e_xy)

What Pi misses (hourglass modes) is mostly deviatoric, and tau stands for the modulus it meets. In Kelvin's notation,
C_k = D C D with D = diag(1, 1, sqrt 2), rotations of the plane act as rotations of R^3 that keep the volumetric
direction (1, 1, 0) and turn the deviatoric plane, spanned by (1, -1, 0) / sqrt 2 and (0, 0, 1), within itself. We take

    tau = smallest eigenvalue of C_k on the deviatoric plane = mean - sqrt(((p - q) / 2)^2 + r^2) of [[p, r], [r, q]].

It has the units of C, does not depend on the axes, and is 2 mu for an isotropic material, as in
:mod:`vemcvx.vem.isotropic`. It does not lock: a volumetric modulus that grows leaves the deviatoric plane alone, and
fibres whose modulus grows add a matrix of rank one to it, which leaves the smaller of its two eigenvalues bounded.
(The trace or the mean would grow with the fibres: with E1 / G = 2e8 and 8 Voronoi cells a side, 1.04 of the energy of a
sheared body is found; with either of them nothing.)
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
from vemcvx.vem.assembly import assemble_cells
from vemcvx.vem.cells import CellGroup
from vemcvx.vem.space import Space
from vemcvx.vem.stabilisation import add_stabilisation


def anisotropic_stiffness(space: Space, C: Floats) -> sp.csr_matrix:
    """Matrix of a^h over all nodal values, (2 n_nodes, 2 n_nodes), symmetric to the bit.

    Parameters
    ----------
    space : Space
    C : (n_cells, 3, 3) array
        Stresses (xx, yy, xy) from strains (e_xx, e_yy, 2 e_xy), force per area; symmetric, positive definite, or zero
        on cells that another material fills.
    """
    tau = softest_shear(C)
    filled = np.abs(C).max(axis=(1, 2)) > 0.0
    return assemble_cells(space, general_blocks, filled, (C, tau))


def softest_shear(C: Floats) -> Floats:
    """The smallest Kelvin modulus of deviatoric strains, (n_cells,); 2 mu where C is isotropic."""
    p, q, r = _deviatoric(C)
    larger = 0.5 * (p + q) + np.hypot(0.5 * (p - q), r)
    # The product of the two is the determinant: their difference would cancel where fibres are stiff.
    return np.divide(p * q - r * r, larger, out=np.zeros_like(p), where=larger > 0)


def mean_shear(C: Floats) -> Floats:
    """The harmonic mean (n_cells,) of the two Kelvin moduli of deviatoric strains; 2 mu where C is isotropic."""
    p, q, r = _deviatoric(C)
    return np.divide(2.0 * (p * q - r * r), p + q, out=np.zeros_like(p), where=p + q > 0)


def _deviatoric(C: Floats) -> tuple[Floats, Floats, Floats]:
    """p, q, r of the Kelvin matrix [[p, r], [r, q]] on the deviatoric plane."""
    return 0.5 * (C[:, 0, 0] + C[:, 1, 1]) - C[:, 0, 1], 2.0 * C[:, 2, 2], C[:, 0, 2] - C[:, 1, 2]


def general_blocks(cells: CellGroup, C: Floats, tau: Floats) -> Floats:
    """The local matrices (c, n, n, 2, 2) of polygons with n vertices; `local_blocks` is the isotropic case."""
    areas, g = cells.gradients()
    B = np.zeros((*g.shape[:2], 3, 2))
    B[:, :, 0, 0] = B[:, :, 2, 1] = g[:, :, 0]
    B[:, :, 1, 1] = B[:, :, 2, 0] = g[:, :, 1]
    stress = np.einsum("ckl,cjlb->cjkb", C / areas[:, None, None], B)
    blocks: Floats = np.einsum("cika,cjkb->cijab", B, stress)
    blocks = 0.5 * (blocks + blocks.transpose(0, 2, 1, 4, 3))
    add_stabilisation(blocks, cells, tau)
    return blocks
