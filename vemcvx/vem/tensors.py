"""Symmetric tensors by components: moduli, stresses, tractions, principal and equivalent stresses.

In the plane, components have the order xx, yy, xy. In space, the order is xx, yy, zz, xy, yz, xz. In a body of
revolution, the order is rr, zz, rz, hoop. Shear components of strains are doubled: 2 e_xy.

Moduli are arrays with one column per cell. Arrays with two rows have Lame's constants lam and mu. In plane stress, lam
is reduced. Arrays with more rows have the upper triangle of the elastic matrix C, row by row: 6 entries in the plane,
10 in a body of revolution, and 21 in space.
"""

from __future__ import annotations

from math import isqrt

import numpy as np

from vemcvx.base.arrays import Floats

COMPONENTS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}
"""Dimension -> axes of the components of symmetric tensors."""


def component_names(dim: int) -> tuple[str, ...]:
    """Return the names of components, such as ("xx", "yy", "xy")."""
    return tuple("xyz"[a] + "xyz"[b] for a, b in COMPONENTS[dim])


def isotropic_stress(value: Floats, dim: int) -> Floats:
    """Return isotropic stresses with the given normal stress."""
    return np.column_stack([value if a == b else np.zeros_like(value) for a, b in COMPONENTS[dim]])


def stresses(moduli: Floats, strain: Floats) -> Floats:
    """Return the stresses (n_cells, components) of strains."""
    if len(moduli) != 2:
        return np.einsum("ckl,cl->ck", elastic_matrix(moduli), strain)
    lam, mu = moduli
    dim = 2 if strain.shape[1] == len(COMPONENTS[2]) else 3
    trace = strain[:, :dim].sum(axis=1)
    normal = [2 * mu * strain[:, a] + lam * trace for a in range(dim)]
    return np.column_stack([*normal, *(mu * shear for shear in strain[:, dim:].T)])


def tractions(sigma: Floats, normals: Floats) -> Floats:
    """Return the tractions sigma n (k, dim)."""
    force = np.zeros(normals.shape)
    for component, (a, b) in zip(sigma.T, COMPONENTS[normals.shape[1]], strict=True):
        force[:, a] += component * normals[:, b]
        if a != b:
            force[:, b] += component * normals[:, a]
    return force


def elastic_matrix(moduli: Floats, dim: int = 2) -> Floats:
    """Return the elastic matrices of cells."""
    if len(moduli) != 2:
        size = isqrt(2 * len(moduli))
        upper, C = np.triu_indices(size), np.zeros((moduli.shape[1], size, size))
        C[:, upper[0], upper[1]] = C[:, upper[1], upper[0]] = moduli.T
        return C
    (lam, mu), size = moduli, len(COMPONENTS[dim])
    C = np.zeros((len(lam), size, size))
    C[:, :dim, :dim] = lam[:, None, None]
    for a in range(size):
        C[:, a, a] += 2 * mu if a < dim else mu
    return C


AXISYMMETRIC = 10
"""The number of moduli of a body of revolution."""


def moduli_of_revolution(lam: Floats, mu: Floats) -> Floats:
    """Return the isotropic moduli (10, n_cells) of a body of revolution."""
    zero, normal = np.zeros_like(lam), lam + 2.0 * mu
    return np.stack([normal, lam, zero, lam, normal, zero, lam, mu, zero, normal])


def upper_triangle(C: Floats) -> Floats:
    """Return the upper triangles of elastic matrices, row by row."""
    rows, columns = np.triu_indices(C.shape[1])
    return np.ascontiguousarray(C[:, rows, columns].T)


def principal(stress: Floats) -> Floats:
    """Return the principal stresses (n, dim), the largest first."""
    dim = 3 if stress.shape[1] == len(COMPONENTS[3]) else 2
    tensor = np.empty((len(stress), dim, dim))
    for (a, b), component in zip(COMPONENTS[dim], stress.T, strict=True):
        tensor[:, a, b] = tensor[:, b, a] = component
    return np.ascontiguousarray(np.linalg.eigvalsh(tensor)[:, ::-1])


def equivalent(stress: Floats, out_of_plane: Floats | None = None) -> Floats:
    """Return von Mises' stress, with `out_of_plane` as zz in plane bodies."""
    xx, yy, *shear = stress.T
    zz = shear.pop(0) if out_of_plane is None else out_of_plane
    apart = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    squared: Floats = 0.5 * apart + 3.0 * sum(component**2 for component in shear)
    return np.sqrt(squared)
