"""The conforming displacement inside polygons: explicit functions, on the fan of each cell, in place of virtual ones.

The displacement is linear on the edges of the mesh, like the virtual function. In a cell it minimises energy minus
work of the body force over continuous functions of degree 2 on the split fan (:mod:`.fan`). Degree 2 does not lock
(Scott and Vogelius on the split of Alfeld); degree 1 does.

A triangle has ten nodes in this order: three corners, the middles of the three edges (edge k goes from corner k to
corner k + 1), the centroid, and the middles between corners and centroid. The last four are inside, and are condensed.
Then the centre of the fan and the middles of spokes (edges to the centre) are condensed. The outline remains: vertices
and middles of the polygon's edges. With a cell's form M (:mod:`.fan`), x'M x / 2 is the minimum of energy minus work.
"""

from __future__ import annotations

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
    condense,
    condense_to_outlines,
    monomial_slopes,
    monomials,
)
from vemcvx.bound.stress import VOIGT

NODES = np.array([[k, (k + 1) % 3, 6, 3 + k, 7 + (k + 1) % 3, 7 + k] for k in range(3)])
"""The numbers (3, 6) of the nodes at the six stations of each part, see :mod:`.fan`."""


def _extend(values: Floats, part: int) -> Floats:
    """Return values (..., 10) of the triangle's functions, given values (..., 6) of a part's Lagrange functions."""
    found = np.zeros((*values.shape[:-1], 10))
    found[..., NODES[part]] = values
    return found


VALUES = np.concatenate([_extend(monomials(RULE[k]) @ COEFFICIENTS[k], k) for k in range(3)])
"""The ten Lagrange functions phi_i of the triangle at the points of `RULE`, (21, 10)."""
SLOPES = np.concatenate([_extend(monomial_slopes(STATIONS[k]) @ COEFFICIENTS[k], k) for k in range(3)])
"""The gradients (18, 2, 10) of the functions at the stations."""
GRAM = np.einsum("ij,piak,pjbl->abkl", MASS, SLOPES.reshape(3, 6, 2, 10), SLOPES.reshape(3, 6, 2, 10))
"""The integrals (2, 2, 10, 10) of products of slopes."""
_POINTS = RULE.reshape(-1, 2)
_BARYCENTRIC = np.column_stack([1.0 - _POINTS.sum(axis=1), _POINTS])
LOADS = LINEAR_MASS_INVERSE @ np.einsum("q,qk,qi->ki", RULE_WEIGHTS, _BARYCENTRIC, VALUES)
"""The matrix (3, 10) that maps the moments int f lambda_k of a linear function f to int f phi_i."""


def triangle_forms(fans: Fans) -> Floats:
    """Return the symmetric matrices M (c, n, 26, 26) of triangles: energy minus work of forces is x' M x / 2.

    The unknowns x are the values at inner nodes (8) and at outer nodes (12), and the forces (6).
    """
    c, n = fans.corners.shape[:2]
    C = np.einsum("prk,ckl,qsl->cprqs", VOIGT, fans.C, VOIGT)
    tensor = np.einsum("ct,ctar,ctbs,cprqs->ctpqab", fans.doubled_areas, fans.back, fans.back, C, optimize=True)
    # The unknowns are ordered by node, then by component.
    each = (tensor.reshape(-1, 4) @ GRAM.reshape(4, 100)).reshape((c, n, 2, 2, 10, 10))
    form = np.zeros((c, n, 26, 26))
    form[..., :20, :20] = each.transpose((0, 1, 4, 2, 5, 3)).reshape(c, n, 20, 20)
    form[..., :20, 20:] = -np.kron(LOADS.T, np.eye(2))
    form[..., 20:, :20] = form[..., :20, 20:].swapaxes(2, 3)
    order = np.r_[12:20, 0:12, 20:26]
    return np.asarray(form[..., order[:, None], order])


def _slots(n: int) -> Ints:
    """Return positions (n, 12) of outer unknowns of triangles in a cell's vector: centre and spokes, then outline."""
    t, after = np.arange(n), (np.arange(n) + 1) % n
    nodes = np.column_stack([0 * t, 1 + n + t, 1 + n + after, 1 + t, 1 + 2 * n + t, 1 + after])
    return (2 * nodes[:, :, None] + np.arange(2)).reshape(n, 12)


def displacement_form(fans: Fans) -> Floats:
    """Return the forms (k, 4 n + 6, 4 n + 6) of the k shapes, for vectors of outline values and body force."""
    shapes = fans.shapes
    return condense_to_outlines(shapes, condense(triangle_forms(shapes), 8), _slots(fans.n))


def split_outline(fans: Fans, outline: Floats) -> tuple[Floats, Floats]:
    """Return the mean strains (c, 3) of outlines (c, 4 n), and the outlines minus linear displacements, (c, 4 n)."""
    c, n = fans.corners.shape[:2]
    values = outline.reshape(c, 2 * n, 2)
    slopes = np.matmul(values.transpose(0, 2, 1), fans.gradients)
    bent = values - np.matmul(fans.outline, slopes.transpose(0, 2, 1))
    bent -= np.matmul(np.full((1, n), 1.0 / n), bent[:, :n])
    strain = np.column_stack([slopes[:, 0, 0], slopes[:, 1, 1], slopes[:, 0, 1] + slopes[:, 1, 0]])
    return strain, bent.reshape(c, 4 * n)


@cache
def to_edges(n: int) -> Floats:
    """Return the matrix L (4 n, 4 n) from outlines to the edge motions on which linear tractions do the same work."""
    vertices, middles = np.split(np.eye(4 * n), 2, axis=1)
    here = vertices.reshape(-1, n, 2)
    ahead = np.roll(here, -1, axis=1)
    bubble = (middles.reshape(-1, n, 2) - 0.5 * (here + ahead)) / 1.5
    return read_only(np.stack([here + bubble, ahead + bubble], axis=2).reshape(4 * n, 4 * n).T)
