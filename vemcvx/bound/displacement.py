"""Explicit displacements inside polygons, in place of virtual functions.

A polygon is divided into triangles, and each triangle into three parts (:mod:`.fan`). The displacement is continuous,
and quadratic on each part. Quadratic functions do not lock on these parts (Scott and Vogelius). The *outline* is the
vector of values at the vertices and edge midpoints of the polygon. For a given outline, the displacement minimises the
energy minus the work of the body force.

Each triangle has ten nodes: corners 0 to 2, edge midpoints 3 to 5, centroid 6, and midpoints 7 to 9 between corners and
centroid. Edge k goes from corner k to corner k + 1. The vector x contains the outline and the coefficients of the body
force. The minimal value is x'M x / 2 with a matrix M.
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
"""The six nodes (3, 6) of each part."""


def _extend(values: Floats, part: int) -> Floats:
    found = np.zeros((*values.shape[:-1], 10))
    found[..., NODES[part]] = values
    return found


VALUES = np.concatenate([_extend(monomials(RULE[k]) @ COEFFICIENTS[k], k) for k in range(3)])
"""The values (21, 10) of the ten Lagrange functions phi_i at the points of `RULE`."""
SLOPES = np.concatenate([_extend(monomial_slopes(STATIONS[k]) @ COEFFICIENTS[k], k) for k in range(3)])
"""The gradients (18, 2, 10) of phi_i at the six nodes of each part."""
GRAM = np.einsum("ij,piak,pjbl->abkl", MASS, SLOPES.reshape(3, 6, 2, 10), SLOPES.reshape(3, 6, 2, 10))
"""The integrals (2, 2, 10, 10) of products of derivatives of phi_i."""
_POINTS = RULE.reshape(-1, 2)
_BARYCENTRIC = np.column_stack([1.0 - _POINTS.sum(axis=1), _POINTS])
LOADS = LINEAR_MASS_INVERSE @ np.einsum("q,qk,qi->ki", RULE_WEIGHTS, _BARYCENTRIC, VALUES)
"""The matrix (3, 10) from int f lambda_k to int f phi_i, for linear f and barycentric coordinates lambda_k."""


def triangle_forms(fans: Fans) -> Floats:
    """Return the energy matrices (c, n, 26, 26) of the n triangles in each of c cells."""
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
    t, after = np.arange(n), (np.arange(n) + 1) % n
    # Order in the cell: centre, midpoints between centre and vertices, vertices, edge midpoints.
    nodes = np.column_stack([0 * t, 1 + n + t, 1 + n + after, 1 + t, 1 + 2 * n + t, 1 + after])
    return (2 * nodes[:, :, None] + np.arange(2)).reshape(n, 12)


def displacement_form(fans: Fans) -> Floats:
    """Return the matrices M (k, 4 n + 6, 4 n + 6) of k cell shapes with n vertices."""
    shapes = fans.shapes
    return condense_to_outlines(shapes, condense(triangle_forms(shapes), 8), _slots(fans.n))


def split_outline(fans: Fans, outline: Floats) -> tuple[Floats, Floats]:
    """Split outlines into mean strains (c, 3) and remainders (c, 4 n)."""
    c, n = fans.corners.shape[:2]
    values = outline.reshape(c, 2 * n, 2)
    slopes = np.matmul(values.transpose(0, 2, 1), fans.gradients)
    bent = values - np.matmul(fans.outline, slopes.transpose(0, 2, 1))
    bent -= np.matmul(np.full((1, n), 1.0 / n), bent[:, :n])
    strain = np.column_stack([slopes[:, 0, 0], slopes[:, 1, 1], slopes[:, 0, 1] + slopes[:, 1, 0]])
    return strain, bent.reshape(c, 4 * n)


@cache
def to_edges(n: int) -> Floats:
    """Return the matrix L (4 n, 4 n) from outlines to edge motions (:mod:`.equilibrium`)."""
    vertices, middles = np.split(np.eye(4 * n), 2, axis=1)
    here = vertices.reshape(-1, n, 2)
    ahead = np.roll(here, -1, axis=1)
    bubble = (middles.reshape(-1, n, 2) - 0.5 * (here + ahead)) / 1.5
    return read_only(np.stack([here + bubble, ahead + bubble], axis=2).reshape(4 * n, 4 * n).T)
