"""The stiffness matrix of a^h, (3.13).

    a_K^h(u, v) = 2 mu (eps(Pi u), eps(Pi v))_K + lam (Pi_0 div u, Pi_0 div v)_K
                  + tau sum_i chi_i(u - Pi u) chi_i(v - Pi v)

with Pi and |K| G_i = g_i as in :mod:`vemcvx.vem.projection`; Pi_0 div u is the trace of eps(Pi u). Between the
components a, b of the vertices i, j this is

    (lam g_ia g_jb + mu g_ib g_ja + mu delta_ab g_i.g_j) / |K| + tau h_K^(dim - 2) delta_ab ((I - Pi)'(I - Pi))_ij.

tau = 2 mu ("shear") has the units of the rest and leaves the volumetric part alone, so nothing locks as
lam grows; tau = 1 ("unit") is (3.13) to the letter. On triangles and
tetrahedra Pi v = v, and the last term is left out.
"""

from __future__ import annotations

from functools import reduce

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
from vemcvx.errors import SceneError
from vemcvx.vem.assembly import assemble_cells
from vemcvx.vem.cells import CellGroup
from vemcvx.vem.space import Space
from vemcvx.vem.stabilisation import add_stabilisation


def stiffness(space: Space, lam: Floats, mu: Floats, stabilisation: str = "shear") -> sp.csr_matrix:
    """Matrix of a^h over all nodal values, (n_u, n_u), symmetric to the bit.

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
    return assemble_cells(space, local_blocks, (lam != 0.0) | (mu != 0.0), (lam, mu, tau))


def stabilisation_factor(mu: Floats, stabilisation: str) -> Floats:
    """tau (n_cells,) of an isotropic material; zero on cells that another material fills."""
    if stabilisation not in ("shear", "unit"):
        raise SceneError(f"stiffness: found stabilisation {stabilisation!r}; there are 'shear' and 'unit'.")
    return 2.0 * mu if stabilisation == "shear" else np.sign(mu)


def local_blocks(cells: CellGroup, lam: Floats, mu: Floats, tau: Floats) -> Floats:
    """The local matrices (c, n, n, dim, dim) of cells with n vertices.

    Entry (K, i, j, a, b) couples component a of vertex i with component b of vertex j.
    """
    measures, g = cells.gradients()
    lam, mu = (lam / measures)[:, None, None], (mu / measures)[:, None, None]
    axes = range(g.shape[2])
    square = [g[:, :, None, a] * g[:, None, :, a] for a in axes]
    blocks = np.empty((*square[0].shape, len(axes), len(axes)))
    for a in axes:
        others = reduce(np.add, [square[b] for b in axes if b != a])
        blocks[..., a, a] = (lam + 2.0 * mu) * square[a] + mu * others
        for b in range(a + 1, len(axes)):
            ab = g[:, :, None, a] * g[:, None, :, b]
            ba = ab.transpose(0, 2, 1)
            blocks[..., a, b] = lam * ab + mu * ba
            blocks[..., b, a] = lam * ba + mu * ab
    add_stabilisation(blocks, cells, tau)
    return blocks
