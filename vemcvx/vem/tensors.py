r"""Symmetric tensors by components: moduli, stresses, tractions, principal and equivalent stresses.

Components of symmetric tensors have the order xx, yy, xy in the plane and xx, yy, zz, xy, yz, xz in space; shear
strains are 2 e_xy and so on. A body of revolution has rr, zz, rz, and the hoop component as a fourth. Moduli are
arrays with one column per cell. Two rows are Lame's lam (reduced in plane stress) and mu; more rows are the upper
triangle of the elastic matrix C by rows: 6 in the plane (xx-xx, xx-yy, xx-xy, yy-yy, yy-xy, xy-xy), 21 in space, 10 in
a body of revolution. With xx for sigma_xx, the principal stresses in the plane and von Mises' stress are

$$ \sigma_{1,2} = \tfrac{xx + yy}2 \pm \sqrt{\big(\tfrac{xx - yy}2\big)^2 + xy^2} \quad \text{(Mohr's circle, 1882)}, \\
\sigma_v^2 = \tfrac12 \big( (xx - yy)^2 + (yy - zz)^2 + (zz - xx)^2 \big) + 3 (xy^2 + yz^2 + xz^2)
\quad \text{(von Mises, 1913)}. $$

The out-of-plane stress zz is the third principal stress: 0 in plane stress; in plane strain lam (e_xx + e_yy), plus
thermal stress.
"""

from __future__ import annotations

from math import isqrt

import numpy as np

from vemcvx.base.arrays import Floats

COMPONENTS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}
"""Axes of the components of symmetric tensors in dim dimensions."""


def component_names(dim: int) -> tuple[str, ...]:
    """Return the names of the components of symmetric tensors.

    Parameters
    ----------
    dim : int

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> vx.vem.component_names(2)
    ('xx', 'yy', 'xy')
    """
    return tuple("xyz"[a] + "xyz"[b] for a, b in COMPONENTS[dim])


def isotropic_stress(value: Floats, dim: int) -> Floats:
    """Return stresses that are equal in all directions.

    Parameters
    ----------
    value : (k,) array
    dim : int

    Returns
    -------
    (k, components) array

    Examples
    --------
    >>> vx.vem.isotropic_stress(np.array([5.0]), 2)
    array([[5., 5., 0.]])
    """
    return np.column_stack([value if a == b else np.zeros_like(value) for a, b in COMPONENTS[dim]])


def stresses(moduli: Floats, strain: Floats) -> Floats:
    """Return the stresses of strains.

    Parameters
    ----------
    moduli : (2, n_cells), (6, n_cells), (10, n_cells) or (21, n_cells) array
        Force per area.
    strain : (n_cells, components) array

    Returns
    -------
    (n_cells, components) array
        Force per area.

    Examples
    --------
    >>> vx.vem.stresses(np.array([[1.0], [2.0]]), np.array([[0.1, 0.0, 0.2]]))
    array([[0.5, 0.1, 0.4]])
    """
    if len(moduli) != 2:
        return np.einsum("ckl,cl->ck", elastic_matrix(moduli), strain)
    lam, mu = moduli
    dim = 2 if strain.shape[1] == len(COMPONENTS[2]) else 3
    trace = strain[:, :dim].sum(axis=1)
    normal = [2 * mu * strain[:, a] + lam * trace for a in range(dim)]
    return np.column_stack([*normal, *(mu * shear for shear in strain[:, dim:].T)])


def tractions(sigma: Floats, normals: Floats) -> Floats:
    """Return the tractions sigma n.

    Parameters
    ----------
    sigma : (k, components) array
        Stresses.
    normals : (k, dim) array
        Normals of any length.

    Returns
    -------
    (k, dim) array

    Examples
    --------
    >>> vx.vem.tractions(np.array([[1.0, 2.0, 3.0]]), np.array([[1.0, 0.0]]))
    array([[1., 3.]])
    """
    force = np.zeros(normals.shape)
    for component, (a, b) in zip(sigma.T, COMPONENTS[normals.shape[1]], strict=True):
        force[:, a] += component * normals[:, b]
        if a != b:
            force[:, b] += component * normals[:, a]
    return force


def elastic_matrix(moduli: Floats, dim: int = 2) -> Floats:
    """Return the elastic matrix of each cell.

    Parameters
    ----------
    moduli : (2, n_cells), (6, n_cells), (10, n_cells) or (21, n_cells) array
        Lame's constants, or the upper triangle of the elastic matrix by rows.
    dim : int
        The dimension, if `moduli` are Lame's constants; otherwise the number of moduli determines the dimension.

    Returns
    -------
    (n_cells, 3, 3) array, in space (n_cells, 6, 6), in a body of revolution (n_cells, 4, 4)

    Examples
    --------
    >>> vx.vem.elastic_matrix(np.array([[1.0], [2.0]])).tolist()
    [[[5.0, 1.0, 0.0], [1.0, 5.0, 0.0], [0.0, 0.0, 2.0]]]
    """
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
"""The number of moduli of a cell in a body of revolution: the upper triangle of a matrix (4, 4)."""


def moduli_of_revolution(lam: Floats, mu: Floats) -> Floats:
    """Return the moduli (10, n_cells) of an isotropic body of revolution, from Lame's constants.

    Parameters
    ----------
    lam, mu : (n_cells,) array

    Returns
    -------
    (10, n_cells) array
        The upper triangle of the elastic matrix for e_rr, e_zz, 2 e_rz and the hoop strain.

    Examples
    --------
    >>> print(vx.vem.moduli_of_revolution(np.array([1.0]), np.array([2.0])).T)
    [[5. 1. 0. 1. 5. 0. 1. 2. 0. 5.]]
    """
    zero, normal = np.zeros_like(lam), lam + 2.0 * mu
    return np.stack([normal, lam, zero, lam, normal, zero, lam, mu, zero, normal])


def upper_triangle(C: Floats) -> Floats:
    """Return the moduli of elastic matrices: their upper triangles by rows.

    Parameters
    ----------
    C : (n_cells, 3, 3) array, in space (n_cells, 6, 6)

    Returns
    -------
    (6, n_cells) array, in space (21, n_cells)

    Examples
    --------
    >>> print(vx.vem.upper_triangle(np.eye(3)[None]).T)
    [[1. 0. 0. 1. 0. 1.]]
    """
    rows, columns = np.triu_indices(C.shape[1])
    return np.ascontiguousarray(C[:, rows, columns].T)


def principal(stress: Floats) -> Floats:
    """Return the principal stresses; in two dimensions, only the two in-plane ones.

    Parameters
    ----------
    stress : (n, components) array

    Returns
    -------
    (n, dim) array
        The largest first.

    Examples
    --------
    >>> vx.vem.principal(np.array([[0.0, 0.0, 2.0]]))
    array([[ 2., -2.]])
    """
    dim = 3 if stress.shape[1] == len(COMPONENTS[3]) else 2
    tensor = np.empty((len(stress), dim, dim))
    for (a, b), component in zip(COMPONENTS[dim], stress.T, strict=True):
        tensor[:, a, b] = tensor[:, b, a] = component
    return np.ascontiguousarray(np.linalg.eigvalsh(tensor)[:, ::-1])


def equivalent(stress: Floats, out_of_plane: Floats | None = None) -> Floats:
    """Return von Mises' equivalent stress.

    Parameters
    ----------
    stress : (n, 6) array; in the plane (n, 3)
    out_of_plane : (n,) array; in the plane only
        The stress zz.

    Returns
    -------
    (n,) array

    Examples
    --------
    >>> vx.vem.equivalent(np.array([[3.0, 0.0, 0.0]]), np.array([0.0]))
    array([3.])
    """
    xx, yy, *shear = stress.T
    zz = shear.pop(0) if out_of_plane is None else out_of_plane
    apart = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    squared: Floats = 0.5 * apart + 3.0 * sum(component**2 for component in shear)
    return np.sqrt(squared)
