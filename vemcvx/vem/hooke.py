"""Stresses from strains, cell by cell, in the plane, and what of them does not depend on the axes.

Moduli are rows over cells: (2, n_cells) Lame's lam (as it acts in the plane) and mu, or (6, n_cells) the upper
triangle of the elastic matrix C row by row: xx-xx, xx-yy, xx-xy, yy-yy, yy-xy, xy-xy, where the strain that goes with
xy is 2 e_xy. Principal stresses in the plane, and von Mises' equivalent stress:

    sigma_1,2 = (xx + yy) / 2 +- sqrt(((xx - yy) / 2)^2 + xy^2)                                 Mohr's circle (1882)
    sigma_v^2 = ((xx - yy)^2 + (yy - zz)^2 + (zz - xx)^2) / 2 + 3 xy^2                          von Mises (1913)

zz, across the plane, is the third principal stress: 0 in plane stress, lam (e_xx + e_yy) and more in plane strain.
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


def principal(stress: Floats) -> Floats:
    """Principal stresses in the plane (n, 2), the larger one first, of stresses (n, 3), (xx, yy, xy)."""
    xx, yy, xy = stress.T
    centre, radius = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    return np.column_stack([centre + radius, centre - radius])


def equivalent(stress: Floats, out_of_plane: Floats) -> Floats:
    """Von Mises' stress (n,) of stresses (n, 3), (xx, yy, xy), in the plane and (n,), zz, across it."""
    xx, yy, xy = stress.T
    apart = (xx - yy) ** 2 + (yy - out_of_plane) ** 2 + (out_of_plane - xx) ** 2
    squared: Floats = 0.5 * apart + 3.0 * xy**2
    return np.sqrt(squared)
