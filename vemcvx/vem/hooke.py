"""Stresses from strains, cell by cell, in the plane.

Moduli are rows over cells: (2, n_cells) Lame's lam (as it acts in the plane) and mu, or (6, n_cells) the upper
triangle of the elastic matrix C row by row: xx-xx, xx-yy, xx-xy, yy-yy, yy-xy, xy-xy, where the strain that goes with
xy is 2 e_xy.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats

UPPER = np.triu_indices(3)


def stresses(moduli: Floats, strain: Floats) -> Floats:
    """Stresses (n_cells, 3), (xx, yy, xy), of the strains (n_cells, 3), (e_xx, e_yy, 2 e_xy)."""
    if len(moduli) == len(UPPER[0]):
        stress: Floats = np.einsum("ckl,cl->ck", elastic_matrix(moduli), strain)
        return stress
    lam, mu = moduli
    xx, yy, xy = strain.T
    return np.column_stack([2 * mu * xx + lam * (xx + yy), 2 * mu * yy + lam * (xx + yy), mu * xy])


def elastic_matrix(moduli: Floats) -> Floats:
    """C (n_cells, 3, 3) of moduli in either form."""
    C = np.zeros((moduli.shape[1], 3, 3))
    if len(moduli) == len(UPPER[0]):
        C[:, UPPER[0], UPPER[1]] = C[:, UPPER[1], UPPER[0]] = moduli.T
        return C
    lam, mu = moduli
    C[:, 0, 0] = C[:, 1, 1] = lam + 2 * mu
    C[:, 0, 1] = C[:, 1, 0] = lam
    C[:, 2, 2] = mu
    return C


def upper_triangle(C: Floats) -> Floats:
    """Moduli (6, n_cells) of C (n_cells, 3, 3)."""
    return np.ascontiguousarray(C[:, UPPER[0], UPPER[1]].T)
