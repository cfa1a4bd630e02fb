"""The conforming displacement inside polygons: virtual functions made explicit on the fan of each cell.

On the edges of the mesh it is what the virtual function is, linear between nodal values; inside, it minimises the
energy of the cell under its body force over continuous functions of degree 2 on the split fan, whose divergences are
as free as pressures are (Scott and Vogelius on the split of Alfeld). Functions of degree 1 on the fan lock: they gave
22 for an error of .026 at lambda = 1e6.

A triangle has ten nodes: three corners, the middles of its edges from corner k to corner k + 1, the centroid, and the
middles between corner k and the centroid. In the cell these are the centre of the fan, the middles of spokes and the
last four of every triangle, which are inside, and the outline: the vertices, and the middles of the polygon's edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.bound.fan import (
    BARYCENTRIC,
    COEFFICIENTS,
    LINEAR_MASS_INVERSE,
    MASS,
    RULE,
    RULE_WEIGHTS,
    STATIONS,
    Fans,
    monomial_slopes,
    monomials,
)
from vemcvx.bound.stress import VOIGT

NODES = np.array([[k, (k + 1) % 3, 6, 3 + k, 7 + (k + 1) % 3, 7 + k] for k in range(3)])
"""(3, 6) the nodes of a triangle at the stations of each part."""


def _spread(values: Floats, part: int) -> Floats:
    """(..., 10) functions of the triangle from Lagrange functions (..., 6) of a part."""
    found = np.zeros((*values.shape[:-1], 10))
    found[..., NODES[part]] = values
    return found


VALUES = np.concatenate([_spread(monomials(RULE[k]) @ COEFFICIENTS[k], k) for k in range(3)])
"""(21, 10) the functions at the points of the rule."""
SLOPES = np.concatenate([_spread(monomial_slopes(STATIONS[k]) @ COEFFICIENTS[k], k) for k in range(3)])
"""(18, 2, 10) their gradients at the stations."""
_SLOPES = SLOPES.reshape(36, 10)
GRAM = np.einsum("ij,piak,pjbl->abkl", MASS, SLOPES.reshape(3, 6, 2, 10), SLOPES.reshape(3, 6, 2, 10))
"""(2, 2, 10, 10) int of products of slopes."""
LOADS = LINEAR_MASS_INVERSE @ np.einsum("q,qk,qi->ki", RULE_WEIGHTS, BARYCENTRIC, VALUES)
"""(3, 10) int f phi_i of a linear f from its F_k = int f lambda_k."""


@dataclass(frozen=True, eq=False)
class FanDisplacement:
    """Displacements inside cells from those of their outlines, and the energy of the latter."""

    fans: Fans
    inside: Floats
    """(k, 10 n + 2, 4 n) nodal values inside from those on the outline; for each of the k shapes"""
    of_body: Floats | None
    """(k, 10 n + 2, 6 n) likewise from body forces; None if there are none"""
    stiffness: Floats
    """(k, 4 n, 4 n) the energy |v|_a^2 as a quadratic form of values on the outline"""

    def nodal(self, outline: Floats, force: Floats | None = None) -> Floats:
        """(c, n, 20) values at the nodes of triangles, from (c, 4 n) and body forces (c, 6 n)."""
        inside = self.fans.apply(self.inside, outline)
        if self.of_body is not None and force is not None:
            inside = inside + self.fans.apply(self.of_body, force)
        return np.concatenate([inside, outline], axis=1)[:, _slots(self.fans.n)]

    def on_outline(self, forces: Floats) -> Floats:
        """(c, 4 n) the work of forces (c, n, 20) at nodes of triangles on motions of the outline."""
        c, n, _ = forces.shape
        total, place = np.zeros((c, 14 * n + 2)), _slots(n)
        for t in range(n):
            total[:, place[t]] += forces[:, t]
        inner, outer = np.split(total, [10 * n + 2], axis=1)
        return outer + self.fans.apply(self.inside.transpose(0, 2, 1), inner)


def _slots(n: int) -> Ints:
    """(n, 20) the unknowns of a triangle's nodes among those of the cell, the outline last."""
    t = np.arange(n)
    after = (t + 1) % n
    first = 5 * n + 1
    edges = [0 * t, first + t, first + after, 1 + t, first + n + t, 1 + after]
    nodes = np.column_stack([*edges, *(1 + n + 4 * t + k for k in range(4))])
    return (2 * nodes[:, :, None] + np.arange(2)).reshape(n, 20)


def fan_displacement(fans: Fans, loaded: bool = True) -> FanDisplacement:
    """The FanDisplacement of these fans; `loaded` by body forces or not."""
    shapes = fans.shapes
    c, n = shapes.corners.shape[:2]
    back, place, m = shapes.back, _slots(n), 10 * n + 2
    C = np.einsum("prk,ckl,qsl->cprqs", VOIGT, shapes.C, VOIGT)
    tensor = np.einsum("ct,ctar,ctbs,cprqs->ctpaqb", shapes.doubled_areas, back, back, C, optimize=True)
    # Functions of the triangle by components, ordered as nodal values are.
    each = (tensor.transpose((0, 1, 2, 4, 3, 5)).reshape(-1, 4) @ GRAM.reshape(4, 100)).reshape((c, n, 2, 2, 10, 10))
    each = each.transpose((0, 1, 4, 2, 5, 3)).reshape(c, n, 20, 20)
    K = np.zeros((c, m + 4 * n, m + 4 * n))
    for t in range(n):
        K[:, place[t][:, None], place[t]] += each[:, t]
    right = np.zeros((c, m, 10 * n if loaded else 4 * n))
    right[:, :, : 4 * n] = -K[:, :m, m:]
    of_forces = np.kron(LOADS.T, np.eye(2))
    for t in range(n) if loaded else ():
        inner = place[t] < m
        right[:, place[t][inner], 4 * n + 6 * t : 4 * n + 6 * t + 6] += of_forces[inner]
    # Solved at once: eliminating triangle by triangle, by inverses, lost all but five digits at lambda = 1e6.
    found = np.linalg.solve(K[:, :m, :m], right)
    inside, of_body = (np.ascontiguousarray(part) for part in np.split(found, [4 * n], axis=2))
    energies = K[:, m:, m:] + K[:, m:, :m] @ inside
    stiffness = 0.5 * (energies + energies.transpose(0, 2, 1))
    return FanDisplacement(fans, inside, of_body if loaded else None, stiffness)


def strains_at_stations(fans: Fans, v: Floats) -> Floats:
    """(c, n, 18, 3) e_xx, e_yy, 2 e_xy at the stations of all triangles, of nodal values (c, n, 20)."""
    c, n, _ = v.shape
    # Along the axes of the reference triangle, station by station.
    along = np.matmul(_SLOPES, v.reshape(c, n, 10, 2)).reshape(c, n, 18, 2, 2)
    slopes = np.matmul(fans.back.transpose(0, 1, 3, 2)[:, :, None], along)
    return np.stack([slopes[..., 0, 0], slopes[..., 1, 1], slopes[..., 0, 1] + slopes[..., 1, 0]], axis=3)


def forces_of(fans: Fans, sigma: Floats) -> Floats:
    """(c, n, 20) int sigma : eps(phi) of stresses (c, n, 18, 3) at the stations."""
    c, n = sigma.shape[:2]
    weighed = np.matmul(MASS, sigma.reshape(c, n, 3, 6, 3)).reshape(c, n, 18, 3) * fans.doubled_areas[..., None, None]
    tensor = weighed[..., [[0, 2], [2, 1]]]
    along = np.matmul(fans.back[:, :, None], tensor).reshape(c, n, 36, 2)
    forces: Floats = np.matmul(_SLOPES.T, along).reshape(c, n, 20)
    return forces
