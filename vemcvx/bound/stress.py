"""Stresses in equilibrium in a polygon, from tractions on the edges (Johnson and Mercier).

A polygon is divided into a fan of triangles, and each triangle into three parts (:mod:`.fan`). Stresses are symmetric
and linear on each part, with continuous tractions between parts. Linear tractions on the edges of a triangle (12
numbers) and divergences on the parts (6 numbers) determine a stress if they are in balance (C. Johnson and B. Mercier,
Numer. Math. 30 (1978)). The matrix B of :mod:`.fan` maps a stress tau^ on the reference triangle to tau. Let n^ and n
be the normals of an edge e^ and of the image e. Then

    tau = B tau^ B' / det B,    |e| tau n = B |e^| tau^ n^,    div tau = B div^ tau^ / det B.

Two integrals int t phi determine a linear traction t on an edge, with linear functions phi that are 1 at one end and 0
at the other. The integrals F_k = int f lambda_k determine a linear body force f, with barycentric coordinates lambda_k.
On each part, f is the sum of a constant force and a rest. The constant forces have the same F_k as f. The rest causes
stresses of degree 2 without tractions on edges.

Let m be edge motions, linear on each edge, and C the elastic tensor. The stress of a triangle maximises

    sum over edges  int tau n . m  -  (tau, C^-1 tau) / 2

among the stresses in balance with f. The maximum is half a quadratic form of m and F_k. On an edge between two
triangles, the tractions of both triangles must cancel. This condition eliminates the motions of the edge.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from vemcvx.base.arrays import Floats, Ints
from vemcvx.bound.fan import (
    COEFFICIENTS,
    CORNERS,
    LINEAR_MASS_INVERSE,
    MASS,
    STATIONS,
    Fans,
    condense_to_outlines,
    monomial_slopes,
    monomials,
)
from vemcvx.meshes.polygons import right_of

VOIGT = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]])
"""The matrices (2, 2, 3) from components xx, yy, xy to symmetric tensors."""


def _rows(part: int, x: Floats, n: Floats | None = None) -> Floats:
    """Return the matrix from nodal values of tau to tau n or div tau."""
    along = monomial_slopes(x) if n is None else n[:, None] * monomials(x)[:, None]
    found = np.zeros((len(x), 2, 3, 6, 3))
    found[:, :, part] = np.einsum("qbi,abk->qaik", along @ COEFFICIENTS[part], VOIGT)
    return found.reshape(2 * len(x), 54)


def _conditions(count: int) -> tuple[Floats, Floats, Floats]:
    """Return matrices for tractions on outer edges, jumps on inner edges, and div tau."""
    outer, jumps, inside = [], [], []
    centre = CORNERS.mean(axis=0)
    for k in range(3):
        start, stop = CORNERS[k], CORNERS[(k + 1) % 3]
        outer.append(_rows(k, np.linspace(start, stop, count), right_of(stop - start)))
        # The inner edge from corner k to the centroid separates the parts k and k - 1.
        x, n = np.linspace(start, centre, count), right_of(centre - start)
        jumps.append(_rows(k, x, n) - _rows((k - 1) % 3, x, n))
        inside.append(_rows(k, STATIONS[k, :3]))
    return np.concatenate(outer), np.concatenate(jumps), np.concatenate(inside)


@cache
def reference() -> Floats:
    """Return the matrix (54, 18) from tractions and forces to nodal stresses."""
    outer, jumps, inside = _conditions(2)
    middles = np.zeros((3, 3, 3, 3, 6, 3))
    for part, side, component in np.ndindex(3, 3, 3):
        row = middles[part, side, component, part, :, component]
        row[3 + side], row[side], row[(side + 1) % 3] = 1.0, -0.5, -0.5
    two = np.eye(2)
    # The integrals b and b' for both ends of e give |e| t = 4 b - 2 b' and 4 b' - 2 b at the ends.
    end_values = np.kron(np.eye(3), np.kron([[4.0, -2.0], [-2.0, 4.0]], two))
    shares = (1.0 / 3.0 + np.array([[1, 0, 1], [1, 1, 0], [0, 1, 1]])) / 18.0
    constants = np.linalg.inv(shares)
    stacked = np.concatenate([outer, jumps, inside, middles.reshape(27, 54)])
    data = np.zeros((len(stacked), 18))
    data[:12, :12] = end_values
    data[24:42, 12:] = -np.kron(np.repeat(constants, 3, axis=0), two)
    found: Floats = np.linalg.pinv(stacked) @ data
    values = np.stack([1.0 - STATIONS[..., :3, :].sum(axis=2), STATIONS[..., :3, 0], STATIONS[..., :3, 1]], axis=2)
    linear = values.reshape(9, 3) @ LINEAR_MASS_INVERSE - np.repeat(constants, 3, axis=0)
    found[:, 12:] += _least(np.concatenate([np.zeros((36, 6)), -np.kron(linear, two)]))
    return found


def _least(data: Floats) -> Floats:
    """Return quadratic stresses tau of least norm with `_conditions` @ tau = `data`."""
    stacked = np.concatenate(_conditions(3))
    half = np.kron(np.eye(3), np.kron(np.linalg.cholesky(MASS), np.diag([1.0, 1.0, np.sqrt(2.0)])))
    weighed = np.linalg.inv(half).T
    return np.asarray(weighed @ np.linalg.pinv(stacked @ weighed) @ data)


def _piola(B: Floats) -> Floats:
    """Return the matrices from tau^ to B tau^ B', for components xx, yy, xy."""
    (a, b), (c, d) = np.moveaxis(B, (-2, -1), (0, 1))
    rows = [[a * a, b * b, 2.0 * a * b], [c * c, d * d, 2.0 * c * d], [a * c, b * d, a * d + b * c]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@cache
def _balance_data() -> Floats:
    """Return a basis (18, 15) of the tractions and forces in balance."""
    ends = np.array([CORNERS[k] for edge in range(3) for k in (edge, (edge + 1) % 3)])
    x = np.concatenate([ends, CORNERS])
    rows = np.stack([np.tile([1.0, 0.0], 9), np.tile([0.0, 1.0], 9), np.column_stack([-x[:, 1], x[:, 0]]).ravel()])
    found = np.zeros((18, 15))
    found[:12, :9] = np.linalg.svd(rows[:, :12])[2][3:].T
    found[:12, 9:], found[12:, 9:] = -np.linalg.pinv(rows[:, :12]) @ rows[:, 12:], np.eye(6)
    return found


@cache
def _energies() -> Floats:
    """Return the integrals (9, 225) of products of two stresses."""
    parts = (reference() @ _balance_data()).reshape(3, 6, 3, 15)
    found: Floats = np.einsum("ij,piak,pjbl->abkl", MASS, parts, parts)
    return found.reshape(9, 225)


def triangle_forms(fans: Fans) -> Floats:
    """Return the matrices (c, n, 18, 18) of the quadratic forms of triangles."""
    c, n = fans.corners.shape[:2]
    M = _piola(fans.B)
    compliances = np.matmul(M.swapaxes(2, 3), np.matmul(np.linalg.inv(fans.C)[:, None], M))
    compliances /= fans.doubled_areas[..., None, None]
    A = (compliances.reshape(-1, 9) @ _energies()).reshape(c, n, 15, 15)
    # In the reference triangle, motions are B' m, and forces are B^-1 F.
    moved = np.matmul(_balance_data()[:12].reshape(6, 2, 15).swapaxes(1, 2), fans.B.swapaxes(2, 3)[:, :, None])
    moved = moved.swapaxes(2, 3).reshape(c, n, 15, 12)
    hat = np.kron(np.eye(3), np.ones((2, 2))) * np.tile(fans.back, (3, 3))
    free = np.concatenate([moved[:, :, :9], -np.matmul(A[..., :9, 9:], hat)], axis=3)
    form = np.matmul(free.swapaxes(2, 3), np.linalg.solve(A[..., :9, :9], free))
    mixed = np.matmul(moved[:, :, 9:].swapaxes(2, 3), hat)
    form[..., :12, 12:] += mixed
    form[..., 12:, :12] += mixed.swapaxes(2, 3)
    form[..., 12:, 12:] -= np.matmul(hat.swapaxes(2, 3), np.matmul(A[..., 9:, 9:], hat))
    return np.asarray(form)


def _slots(n: int) -> Ints:
    # The last edge of a triangle is the first edge of the next triangle, with ends exchanged.
    t = np.arange(n)[:, None]
    after = 4 * ((t + 1) % n)
    return np.concatenate([4 * t + np.arange(4), 4 * (n + t) + np.arange(4), after + np.array([2, 3, 0, 1])], axis=1)


def stress_form(fans: Fans) -> Floats:
    """Return one matrix per cell shape, for edge motions and body force."""
    shapes = fans.shapes
    return condense_to_outlines(shapes, triangle_forms(shapes), _slots(fans.n))
