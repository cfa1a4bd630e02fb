"""The stiffness matrix of a^h, (3.13).

    a_K^h(u, v) = 2 mu (eps(Pi u), eps(Pi v))_K + lam (Pi_0 div u, Pi_0 div v)_K
                  + tau sum_i chi_i(u - Pi u) chi_i(v - Pi v)

with Pi and |K| G_i = g_i as in :mod:`vemcvx.vem.projection`; Pi_0 div u is the trace of eps(Pi u). Between the
components a, b of the vertices i, j this is

    (lam g_ia g_jb + mu g_ib g_ja + mu delta_ab g_i.g_j) / |K| + tau delta_ab ((I - Pi)'(I - Pi))_ij.

tau = 2 mu ("shear") has the units of the rest and leaves the volumetric part alone, so nothing locks as
lam grows; tau = 1 ("unit") is (3.13) to the letter. On triangles Pi v = v, and the last term is left out.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
from vemcvx.errors import SceneError
from vemcvx.vem.assembly import assemble_cells
from vemcvx.vem.projection import area_gradients
from vemcvx.vem.space import CellGroup, Space
from vemcvx.vem.stabilisation import add_stabilisation


def stiffness(space: Space, lam: Floats, mu: Floats, stabilisation: str = "shear") -> sp.csr_matrix:
    """Matrix of a^h over all nodal values, (2 n_nodes, 2 n_nodes), symmetric to the bit.

    Parameters
    ----------
    space : Space
    lam, mu : (n_cells,) arrays
        Lame's constants, force per area; `lam` already reduced in plane stress. Both zero on cells that another
        material fills.
    stabilisation : {"shear", "unit"}
        tau = 2 mu, or tau = 1.

    Raises
    ------
    SceneError
        `stabilisation` is neither.

    Notes
    -----
    Scaling all coordinates by a power of two changes no bit; scaling moduli by one scales the matrix exactly
    (with "unit", its consistent part). Entries that happen to vanish are stored.
    """
    tau = stabilisation_factor(mu, stabilisation)

    def local(cells: CellGroup) -> Floats:
        return local_blocks(cells.corners, lam[cells.cells], mu[cells.cells], tau[cells.cells])

    return assemble_cells(space, local)


def stabilisation_factor(mu: Floats, stabilisation: str) -> Floats:
    """tau (n_cells,) of an isotropic material; zero on cells that another material fills."""
    if stabilisation not in ("shear", "unit"):
        raise SceneError(f"stiffness: found stabilisation {stabilisation!r}; there are 'shear' and 'unit'.")
    return 2.0 * mu if stabilisation == "shear" else np.sign(mu)


def local_blocks(corners: Floats, lam: Floats, mu: Floats, tau: Floats) -> Floats:
    """The local matrices (c, n, n, 2, 2) of cells with n vertices (c, n, 2), relative to a point of the cell.

    Entry (K, i, j, a, b) couples component a of vertex i with component b of vertex j.
    """
    areas, g = area_gradients(corners)
    lam, mu = (lam / areas)[:, None, None], (mu / areas)[:, None, None]
    x, y = g[:, :, 0], g[:, :, 1]
    xx, yy, xy = x[:, :, None] * x[:, None, :], y[:, :, None] * y[:, None, :], x[:, :, None] * y[:, None, :]
    yx = xy.transpose(0, 2, 1)
    blocks = np.empty((*xx.shape, 2, 2))
    blocks[..., 0, 0] = (lam + 2.0 * mu) * xx + mu * yy
    blocks[..., 1, 1] = (lam + 2.0 * mu) * yy + mu * xx
    blocks[..., 0, 1] = lam * xy + mu * yx
    blocks[..., 1, 0] = lam * yx + mu * xy
    add_stabilisation(blocks, corners, tau)
    return blocks
