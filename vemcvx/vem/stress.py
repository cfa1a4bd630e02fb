"""Strains of Pi u, stresses from them, and the motions without strain."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.vem.space import Space
from vemcvx.vem.stiffness_matrix import CHUNK

# Strains of Pi u, and the motions without strain.


def strains(space: Space, u: Floats) -> Floats:
    """The mean strain of a virtual function on each cell, eps(Pi u), (3.13): (n_cells, components).

    These are e_xx, e_yy and 2 e_xy in the plane, and e_xx, e_yy, e_zz, 2 e_xy, 2 e_yz, 2 e_xz in space. u are nodal
    displacements, (n_nodes, dim) or (n_u,).
    """
    dim = space.mesh.points.shape[1]
    u = np.reshape(u, (-1, dim))
    result = np.empty((space.mesh.n_cells, len(COMPONENTS[dim])))
    for group in space.groups:
        for chunk in group.chunks(CHUNK):
            measures, g = chunk.gradients()
            v = u[chunk.nodes]
            # Differences from a vertex: a rigid translation much larger than the deformation costs no digits.
            v -= v[:, :1]
            slope = np.matmul(v.transpose(0, 2, 1), g) / measures[:, None, None]
            for k, (a, b) in enumerate(COMPONENTS[dim]):
                result[chunk.cells, k] = slope[:, a, a] if a == b else slope[:, a, b] + slope[:, b, a]
    return result


def rigid_modes(points: Floats) -> Floats:
    """The infinitesimal rigid motions (n_u, 3 or 6): translations along the axes, then rotations about the origin.

    In the plane the rotation is (-y, x), in space they are (0, -z, y), (z, 0, -x) and (-y, x, 0).
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
    """The translation and the rotation, one number in the plane and three in space, of a sum of rigid modes."""
    return (mode[:2], mode[2:]) if len(mode) == 3 else (mode[:3], mode[3:])


# Stresses from strains, cell by cell, and what of them does not depend on the axes.
#
# Components of symmetric tensors are in the order xx, yy, xy in the plane and xx, yy, zz, xy, yz, xz in space; of
# strains those across are 2 e_xy and so on. Moduli are rows over cells: (2, n_cells) Lame's lam (in the plane as it
# acts there) and mu, or, in the plane, (6, n_cells) the upper triangle of the elastic matrix C row by row: xx-xx,
# xx-yy, xx-xy, yy-yy, yy-xy, xy-xy. Principal stresses in the plane, and von Mises' equivalent stress:
#
#     sigma_1,2 = (xx + yy) / 2 +- sqrt(((xx - yy) / 2)^2 + xy^2)                                 Mohr's circle (1882)
#     sigma_v^2 = ((xx - yy)^2 + (yy - zz)^2 + (zz - xx)^2) / 2 + 3 (xy^2 + yz^2 + xz^2)          von Mises (1913)
#
# zz, across the plane, is the third principal stress: 0 in plane stress, lam (e_xx + e_yy) and more in plane strain.


UPPER = np.triu_indices(3)
COMPONENTS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}
"""Of symmetric tensors in dim dimensions, axis by axis."""


def component_names(dim: int) -> tuple[str, ...]:
    """The names of components: xx, yy, xy ..."""
    return tuple("xyz"[a] + "xyz"[b] for a, b in COMPONENTS[dim])


def isotropic_stress(value: Floats, dim: int) -> Floats:
    """(k, components) of a stress (k,) in all directions."""
    return np.column_stack([value if a == b else np.zeros_like(value) for a, b in COMPONENTS[dim]])


def stresses(moduli: Floats, strain: Floats) -> Floats:
    """Stresses (n_cells, components) of strains of these components."""
    if len(moduli) == len(UPPER[0]):
        stress: Floats = np.einsum("ckl,cl->ck", elastic_matrix(moduli), strain)
        return stress
    lam, mu = moduli
    dim = 2 if strain.shape[1] == len(COMPONENTS[2]) else 3
    trace = strain[:, 0] + strain[:, 1] if dim == 2 else strain[:, 0] + strain[:, 1] + strain[:, 2]
    normal = [2 * mu * strain[:, a] + lam * trace for a in range(dim)]
    return np.column_stack([*normal, *(mu * shear for shear in strain[:, dim:].T)])


def elastic_matrix(moduli: Floats) -> Floats:
    """C (n_cells, 3, 3) of moduli in either form, in the plane."""
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
    """Principal stresses (n, dim), those in the plane or all three, the largest first, of stresses (n, components)."""
    if stress.shape[1] == len(COMPONENTS[3]):
        tensor = np.empty((len(stress), 3, 3))
        for (a, b), component in zip(COMPONENTS[3], stress.T, strict=True):
            tensor[:, a, b] = tensor[:, b, a] = component
        return np.ascontiguousarray(np.linalg.eigvalsh(tensor)[:, ::-1])
    xx, yy, xy = stress.T
    centre, radius = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    return np.column_stack([centre + radius, centre - radius])


def equivalent(stress: Floats, out_of_plane: Floats | None = None) -> Floats:
    """Von Mises' stress (n,) of stresses (n, 6), or (n, 3) in the plane and (n,), zz, across it."""
    if out_of_plane is None:
        xx, yy, zz, *shear = stress.T
    else:
        xx, yy, *shear = stress.T
        zz = out_of_plane
    apart = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    squared: Floats = 0.5 * apart + 3.0 * sum(component**2 for component in shear)
    return np.sqrt(squared)
