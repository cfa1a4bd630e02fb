"""The conforming displacement inside polygons: virtual functions made explicit on the fan of each cell.

On the edges of the mesh it is what the virtual function is, linear between nodal values; inside, it minimises the
energy of the cell under its body force over continuous functions of degree 2 on the split fan, whose divergences are
as free as pressures are (Scott and Vogelius on the split of Alfeld). Functions of degree 1 on the fan lock: they gave
22 for an error of .026 at lambda = 1e6.

A triangle has ten nodes: three corners, the middles of its edges from corner k to corner k + 1, the centroid, and the
middles between corner k and the centroid. The last four are inside of it and answer to those around; of these the hub
of the cell, the centre of the fan and the middles of spokes, answers to the outline: the vertices, and the middles of
the polygon's edges. So half of the form of a cell is what is least of the energy less the work of its body force.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from vemcvx.base.arrays import Floats, Ints, read_only
from vemcvx.bound.fan import (
    COEFFICIENTS,
    LINEAR_MASS_INVERSE,
    MASS,
    RULE,
    RULE_WEIGHTS,
    STATIONS,
    Fans,
    condensed,
    monomial_slopes,
    monomials,
    of_outlines,
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
GRAM = np.einsum("ij,piak,pjbl->abkl", MASS, SLOPES.reshape(3, 6, 2, 10), SLOPES.reshape(3, 6, 2, 10))
"""(2, 2, 10, 10) int of products of slopes."""
_POINTS = RULE.reshape(-1, 2)
_BARYCENTRIC = np.column_stack([1.0 - _POINTS.sum(axis=1), _POINTS])
LOADS = LINEAR_MASS_INVERSE @ np.einsum("q,qk,qi->ki", RULE_WEIGHTS, _BARYCENTRIC, VALUES)
"""(3, 10) int f phi_i of a linear f from its F_k = int f lambda_k."""


def of_triangles(fans: Fans) -> Floats:
    """(c, n, 26, 26) the energy of triangles less the work of their forces: nodes inside (8), around (12), forces (6).

    As a quadratic form, of which half is meant.
    """
    c, n = fans.corners.shape[:2]
    C = np.einsum("prk,ckl,qsl->cprqs", VOIGT, fans.C, VOIGT)
    tensor = np.einsum("ct,ctar,ctbs,cprqs->ctpqab", fans.doubled_areas, fans.back, fans.back, C, optimize=True)
    # Functions of the triangle by components, ordered as nodal values are.
    each = (tensor.reshape(-1, 4) @ GRAM.reshape(4, 100)).reshape((c, n, 2, 2, 10, 10))
    form = np.zeros((c, n, 26, 26))
    form[..., :20, :20] = each.transpose((0, 1, 4, 2, 5, 3)).reshape(c, n, 20, 20)
    form[..., :20, 20:] = -np.kron(LOADS.T, np.eye(2))
    form[..., 20:, :20] = form[..., :20, 20:].swapaxes(2, 3)
    order = np.r_[12:20, 0:12, 20:26]
    found: Floats = form[..., order[:, None], order]
    return found


def _slots(n: int) -> Ints:
    """(n, 12) the unknowns of the nodes around a triangle among those of the cell: its hub, then its outline."""
    t, after = np.arange(n), (np.arange(n) + 1) % n
    nodes = np.column_stack([0 * t, 1 + n + t, 1 + n + after, 1 + t, 1 + 2 * n + t, 1 + after])
    return (2 * nodes[:, :, None] + np.arange(2)).reshape(n, 12)


def displacement_form(fans: Fans) -> Floats:
    """(k, 4 n + 6, 4 n + 6) of each shape the form of the values on its outline and its body force."""
    shapes = fans.shapes
    return of_outlines(shapes, condensed(of_triangles(shapes), 8), _slots(fans.n))


@dataclass(frozen=True, eq=False)
class OutlineValues:
    """A displacement on the outlines of cells: a linear one, and what is left, of which defects are made.

    That is smaller by a power of h, whose square an energy of both at once would lose in digits.
    """

    slopes: Floats
    """(c, 2, 2) of the linear part, the means over the cells"""
    bent: Floats
    """(c, 4 n) what is left"""

    @property
    def strain(self) -> Floats:
        """(c, 3) of the linear part."""
        off = self.slopes[:, 0, 1] + self.slopes[:, 1, 0]
        return np.column_stack([self.slopes[:, 0, 0], self.slopes[:, 1, 1], off])


def without_slopes(fans: Fans, outline: Floats) -> OutlineValues:
    """The parts of values (c, 4 n) at vertices and middles of edges."""
    c, n = fans.corners.shape[:2]
    values = outline.reshape(c, 2 * n, 2)
    slopes = np.matmul(values.transpose(0, 2, 1), fans.gradients)
    bent = values - np.matmul(fans.outline, slopes.transpose(0, 2, 1))
    bent -= np.matmul(np.full((1, n), 1.0 / n), bent[:, :n])
    return OutlineValues(slopes, bent.reshape(c, 4 * n))


@cache
def to_edges(n: int) -> Floats:
    """(4 n, 4 n) motions of outer edges from values at vertices and middles.

    Linear on each edge, they are such that linear tractions do the same work on both.
    """
    vertices, middles = np.split(np.eye(4 * n), 2, axis=1)
    here = vertices.reshape(-1, n, 2)
    ahead = np.roll(here, -1, axis=1)
    bubble = (middles.reshape(-1, n, 2) - 0.5 * (here + ahead)) / 1.5
    return read_only(np.stack([here + bubble, ahead + bubble], axis=2).reshape(4 * n, 4 * n).T)


def edge_forces(fans: Fans, stress: Floats) -> Floats:
    """(c, 4 n) int tau n phi at both ends of the outer edges, of constant stresses (c, 3)."""
    half = np.matmul(fans.normals, 0.5 * stress[:, [[0, 2], [2, 1]]])
    return np.repeat(half[:, :, None], 2, axis=2).reshape(len(stress), 4 * fans.n)
