"""Stresses in equilibrium on the fan of a polygon (Johnson and Mercier), from tractions on its edges.

On a triangle split at its centroid the symmetric stresses that are linear on the three parts, with tractions that go
on across the inner edges, are determined by the tractions on the three edges, linear there, and the divergences on
the parts: 12 + 6 numbers with three conditions, balance (C. Johnson and B. Mercier, Numer. Math. 30 (1978)). By

    tau = B tau^ B' / det B,    |e| tau n = B |e^| tau^ n^,    div tau = B div^ tau^ / det B

one reference triangle gives all. Body forces f enter by F_k = int f lambda_k: constants on the parts with the same
moments against linear functions, and for the rest, f_1 less these constants, a stress of degree 2 on the parts that
has no traction on the edges of the triangle (four of them, for the four linear parts of a vector). So div tau = -f_1
exactly.

In a fan the forces x of tractions on spokes and outer edges, balanced on every triangle by the body's, minimise

    |tau|^2 / 2 in C^-1  -  sum over outer edges  int tau n . m,      m (motion) linear on each edge,

so that they are linear in m and f. What the triangles have in common with their neighbours is m: the stress of least
energy in a body is that of the m whose tractions agree (:mod:`.equilibrium`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.bound.fan import (
    ALL,
    COEFFICIENTS,
    CORNERS,
    LINEAR_MASS_INVERSE,
    MASS,
    STATIONS,
    Fans,
    monomial_slopes,
    monomials,
)

VOIGT = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]])
"""(2, 2, 3) entries of a symmetric tensor by its components xx, yy, xy."""


def _rows(part: int, x: Floats, n: Floats) -> Floats:
    """(2 q, 54) the vectors tau n at points (q, 2), from the values of tau at all stations."""
    basis = monomials(x) @ COEFFICIENTS[part]
    found = np.zeros((len(x), 2, 3, 6, 3))
    found[:, :, part] = np.einsum("qi,abk,b->qaik", basis, VOIGT, n)
    return found.reshape(2 * len(x), 54)


def _divergence_rows(part: int, x: Floats) -> Floats:
    """(2 q, 54) likewise div tau."""
    slopes = monomial_slopes(x) @ COEFFICIENTS[part]
    found = np.zeros((len(x), 2, 3, 6, 3))
    found[:, :, part] = np.einsum("qbi,abk->qaik", slopes, VOIGT)
    return found.reshape(2 * len(x), 54)


def _between(one: Floats, other: Floats, count: int) -> Floats:
    """(count, 2) points from one place to another."""
    s = np.linspace(0.0, 1.0, count)[:, None]
    points: Floats = (1.0 - s) * one + s * other
    return points


def _turned(edge: Floats) -> Floats:
    """The normal on the right of an edge, as long as it."""
    return np.array([edge[1], -edge[0]])


def _conditions(count: int) -> tuple[Floats, Floats, Floats]:
    """Rows of outer tractions, of jumps across inner edges and of divergences at `count` points an edge."""
    outer, jumps, inside = [], [], []
    centre = CORNERS.mean(axis=0)
    for k in range(3):
        start, stop = CORNERS[k], CORNERS[(k + 1) % 3]
        outer.append(_rows(k, _between(start, stop, count), _turned(stop - start)))
        # From corner k to the centroid run the parts k and k - 1.
        x, n = _between(start, centre, count), _turned(centre - start)
        jumps.append(_rows(k, x, n) - _rows((k - 1) % 3, x, n))
        inside.append(_divergence_rows(k, STATIONS[k, :3]))
    return np.concatenate(outer), np.concatenate(jumps), np.concatenate(inside)


@cache
def reference() -> Floats:
    """(54, 18) stresses at the stations of the reference triangle, from 12 numbers of tractions and 6 of forces.

    Tractions are int tau n phi at both ends of the edges from corner k to corner k + 1, forces int f lambda_k; on data
    that are in balance the stress is in equilibrium with them.
    """
    outer, jumps, inside = _conditions(2)
    middles = np.zeros((3, 3, 3, 3, 6, 3))
    for part, side, component in np.ndindex(3, 3, 3):
        row = middles[part, side, component, part, :, component]
        row[3 + side], row[side], row[(side + 1) % 3] = 1.0, -0.5, -0.5
    two = np.eye(2)
    # A traction that is linear on an edge is |e| t = 4 b - 2 b' at the end with the force b = int t phi.
    of_ends = np.kron(np.eye(3), np.kron([[4.0, -2.0], [-2.0, 4.0]], two))
    shares = (1.0 / 3.0 + np.array([[1, 0, 1], [1, 1, 0], [0, 1, 1]])) / 18.0
    constants = np.linalg.inv(shares)
    stacked = np.concatenate([outer, jumps, inside, middles.reshape(27, 54)])
    data = np.zeros((len(stacked), 18))
    data[:12, :12] = of_ends
    data[24:42, 12:] = -np.kron(np.repeat(constants, 3, axis=0), two)
    found: Floats = np.linalg.pinv(stacked) @ data
    outer, jumps, inside = _conditions(3)
    values = np.stack([1.0 - STATIONS[..., :3, :].sum(axis=2), STATIONS[..., :3, 0], STATIONS[..., :3, 1]], axis=2)
    linear = values.reshape(9, 3) @ LINEAR_MASS_INVERSE - np.repeat(constants, 3, axis=0)
    half = np.kron(np.eye(3), np.kron(np.linalg.cholesky(MASS), np.diag([1.0, 1.0, np.sqrt(2.0)])))
    weighed = np.linalg.inv(half).T
    stacked = np.concatenate([outer, jumps, inside])
    data = np.concatenate([np.zeros((36, 6)), -np.kron(linear, two)])
    found[:, 12:] += weighed @ np.linalg.pinv(stacked @ weighed) @ data
    return found


@cache
def _gram() -> Floats:
    """(3, 3, 18, 18) int of products of components of such stresses."""
    parts = reference().reshape(3, 6, 3, 18)
    found: Floats = np.einsum("ij,piak,pjbl->abkl", MASS, parts, parts)
    return found


# What linear moments miss: quadratic parts of body forces, and of tractions on the outer edge of a fan triangle, from
# corner 1 to corner 2. Stresses that balance these and nothing else tell what they count.

_ORDER = np.polynomial.legendre.leggauss(4)
_A, _B = (0.5 + 0.5 * one.ravel() for one in np.meshgrid(_ORDER[0], _ORDER[0]))
_POINTS, _WEIGHTS = np.column_stack([_A, _B * (1.0 - _A)]), 0.25 * np.outer(_ORDER[1], _ORDER[1]).ravel() * (1.0 - _A)
"""A rule on the reference triangle that is exact for degree 6."""


def _cubics(x: Floats) -> tuple[Floats, Floats]:
    """Monomials (q, 10) up to degree 3, and their gradients (q, 2, 10)."""
    powers = [(i, j) for k in range(4) for i, j in zip(range(k, -1, -1), range(k + 1), strict=True)]
    one, two = x.T
    values = np.column_stack([one**i * two**j for i, j in powers])
    along = [np.column_stack([i * one ** max(i - 1, 0) * two**j for i, j in powers])]
    along += [np.column_stack([j * one**i * two ** max(j - 1, 0) for i, j in powers])]
    return values, np.stack(along, axis=1)


def _parabolas() -> Floats:
    """(6, 3) monomials of quadratic functions, orthonormal, and orthogonal to linear ones."""
    factor = np.linalg.cholesky(np.einsum("q,qi,qj->ij", _WEIGHTS, monomials(_POINTS), monomials(_POINTS)))
    found: Floats = np.linalg.inv(factor).T[:, 3:]
    return found


PARABOLAS = _parabolas()


@cache
def of_parabolas() -> Floats:
    """(3, 3, 6, 6) int of products of components of the cubic stresses that balance parabolas in the triangle."""
    rows = []
    for k in range(3):
        x, n = _between(CORNERS[k], CORNERS[(k + 1) % 3], 4), _turned(CORNERS[(k + 1) % 3] - CORNERS[k])
        rows.append(np.einsum("qi,abk,b->qaik", _cubics(x)[0], VOIGT, n).reshape(8, 30))
    x = _between(CORNERS[0], CORNERS[1], 3)
    x = np.concatenate([x, _between(CORNERS[0], CORNERS[2], 3)[1:], [[0.5, 0.5]]])
    rows.append(np.einsum("qbi,abk->qaik", _cubics(x)[1], VOIGT).reshape(12, 30))
    data = np.concatenate([np.zeros((24, 6)), -np.kron(monomials(x) @ PARABOLAS, np.eye(2))])
    fields = (np.linalg.pinv(np.concatenate(rows)) @ data).reshape(10, 3, 6)
    at = np.einsum("qi,ika->qka", _cubics(_POINTS)[0], fields)
    found: Floats = np.einsum("q,qka,qlb->klab", _WEIGHTS, at, at)
    return found


@cache
def of_edge() -> Floats:
    """(3, 3, 2, 2) likewise of stresses that balance the tractions 1 - 6 s (1 - s) on the outer edge."""
    stacked, data = np.concatenate(_conditions(3)), np.zeros((54, 2))
    data[6:12] = np.kron([[1.0], [-0.5], [1.0]], np.eye(2))
    half = np.kron(np.eye(3), np.kron(np.linalg.cholesky(MASS), np.diag([1.0, 1.0, np.sqrt(2.0)])))
    weighed = np.linalg.inv(half).T
    at = (weighed @ np.linalg.pinv(stacked @ weighed) @ data).reshape(3, 6, 3, 2)
    found: Floats = np.einsum("ij,piak,pjbl->abkl", MASS, at, at)
    return found


def lifted(fans: Fans, gram: Floats, data: Floats) -> Floats:
    """(c, n) norms in C^-1 of stresses on all triangles by the vectors (c, n, j, 2) that they balance.

    These are |T| / 2 times the coefficients of parabolas, or |e| times those of tractions on outer edges.
    """
    M = piola(fans.B)
    form = np.matmul(M.transpose(0, 1, 3, 2), np.matmul(fans.D[:, None], M))
    hat = np.matmul(data, fans.back.transpose(0, 1, 3, 2)).reshape(*data.shape[:2], -1)
    squares = np.einsum("ctab,abkl,ctk,ctl->ct", form, gram, hat, hat, optimize=True) / fans.doubled_areas
    norms: Floats = np.sqrt(np.maximum(squares, 0.0))
    return norms


def _slots(n: int) -> tuple[Ints, Floats]:
    """Where the 18 data of each triangle of a fan stand among those of the cell, (n, 18), and their signs (n, 18).

    Of a cell these are the forces of tractions on spokes, then on outer edges, then of the body: 4 n, 4 n and 6 n.
    Spoke i runs from the centre to vertex i, its forces act on triangle i, and the other way on triangle i - 1.
    """
    place, sign = np.zeros((n, 18), dtype=np.int64), np.ones((n, 18))
    for t in range(n):
        after = (t + 1) % n
        place[t, :4] = 4 * t + np.arange(4)
        place[t, 4:8] = 4 * n + 4 * t + np.arange(4)
        # Edge 2 of the triangle runs from the vertex to the centre.
        place[t, 8:12] = 4 * after + np.array([2, 3, 0, 1])
        sign[t, 8:12] = -1.0
        place[t, 12:] = 8 * n + 6 * t + np.arange(6)
    return place, sign


@dataclass(frozen=True, eq=False)
class FanStress:
    """The stresses of least energy on fans, as functions of the motion of their edges and of body forces."""

    fans: Fans
    forces: Floats
    """(k, 8 n, 4 n) forces of tractions on spokes, then on outer edges, from the motion of both ends of these; for each
    of the k shapes"""
    of_body: Floats | None
    """(k, 8 n, 6 n) likewise from body forces; None if there are none"""
    stiffness: Floats
    """(k, 4 n, 4 n) forces on outer edges from their motion, symmetric"""

    def tractions(self, motion: Floats, force: Floats | None = None, rows: Ints | slice = ALL) -> Floats:
        """(c, 8 n) forces of some cells from motions (c, 4 n) and body forces (c, 6 n)."""
        found = self.fans.apply(self.forces, motion, rows)
        return found if self.of_body is None or force is None else found + self.fans.apply(self.of_body, force, rows)


def triangle_energies(fans: Fans) -> Floats:
    """(c, n, 18, 18) |tau|^2 in C^-1 on each triangle, as a quadratic form of its data."""
    B, det = fans.B, fans.doubled_areas
    M = piola(B)
    D = fans.D
    form = np.matmul(M.transpose(0, 1, 3, 2), np.matmul(D[:, None], M)) / det[..., None, None]
    reference = np.einsum("ctab,abkl->ctkl", form, _gram(), optimize=True)
    back = fans.back
    shape = (*det.shape, 9, 2, 9, 2)
    # b^ = B^-1 b of every force.
    found: Floats = np.einsum("ctipjq,ctpr,ctqs->ctirjs", reference.reshape(shape), back, back, optimize=True)
    return found.reshape(reference.shape)


def piola(B: Floats) -> Floats:
    """(..., 3, 3) the components xx, yy, xy of B tau^ B' from those of tau^."""
    (a, b), (c, d) = np.moveaxis(B, (-2, -1), (0, 1))
    rows = [[a * a, b * b, 2.0 * a * b], [c * c, d * d, 2.0 * c * d], [a * c, b * d, a * d + b * c]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def fan_stress(fans: Fans, loaded: bool = True) -> FanStress:
    """The FanStress of these fans; `loaded` by body forces or not."""
    shapes = fans.shapes
    c, n = shapes.corners.shape[:2]
    place, sign = _slots(n)
    energies = triangle_energies(shapes)
    count = 14 * n if loaded else 8 * n
    H = np.zeros((c, count, count))
    for t in range(n):
        mine = np.flatnonzero(place[t] < count)
        at, signs = place[t][mine], sign[t][mine]
        H[:, at[:, None], at] += signs[:, None] * signs * energies[:, t, mine[:, None], mine]
    balance = _balance(shapes, place, sign)
    # Energies and balance are brought to one size, lest the system be badly scaled.
    unit = (np.einsum("cii->c", H[:, : 8 * n, : 8 * n]) / (8 * n))[:, None, None]
    system = np.zeros((c, 11 * n, 11 * n))
    system[:, : 8 * n, : 8 * n] = H[:, : 8 * n, : 8 * n] / unit
    system[:, 8 * n :, : 8 * n] = balance[:, :, : 8 * n]
    system[:, : 8 * n, 8 * n :] = balance[:, :, : 8 * n].transpose(0, 2, 1)
    right = np.zeros((c, 11 * n, count - 4 * n))
    right[:, 4 * n : 8 * n, : 4 * n] = np.eye(4 * n) / unit
    if loaded:
        right[:, : 8 * n, 4 * n :] = -H[:, : 8 * n, 8 * n :] / unit
        right[:, 8 * n :, 4 * n :] = -balance[:, :, 8 * n :]
    found = np.linalg.solve(system, right)[:, : 8 * n]
    parts = [np.ascontiguousarray(part) for part in np.split(found, [4 * n], axis=2)]
    K = parts[0][:, 4 * n :]
    return FanStress(fans, parts[0], parts[1] if loaded else None, 0.5 * (K + K.transpose(0, 2, 1)))


def _balance(fans: Fans, place: Ints, sign: Floats) -> Floats:
    """(c, 3 n, 14 n) force, and moment about the centre over the cell's size, of all data on every triangle."""
    c, n = fans.corners.shape[:2]
    size = np.sqrt(0.5 * fans.doubled_areas.sum(axis=1))
    here, ahead, centre = fans.corners, np.roll(fans.corners, -1, axis=1), np.zeros((c, n, 2))
    at = np.stack([centre, here, here, ahead, ahead, centre, centre, here, ahead], axis=2) / size[:, None, None, None]
    found = np.zeros((c, n, 3, 14 * n))
    for t in range(n):
        for slot in range(9):
            x, y = place[t, 2 * slot], place[t, 2 * slot + 1]
            found[:, t, 0, x] += sign[t, 2 * slot]
            found[:, t, 1, y] += sign[t, 2 * slot]
            found[:, t, 2, x] -= sign[t, 2 * slot] * at[:, t, slot, 1]
            found[:, t, 2, y] += sign[t, 2 * slot] * at[:, t, slot, 0]
    return found.reshape(c, 3 * n, 14 * n)


def stresses_at_stations(fans: Fans, tractions: Floats, force: Floats | None = None) -> Floats:
    """(c, n, 18, 3) tau at the stations of all triangles, from forces (c, 8 n) and (c, 6 n) in balance."""
    place, sign = _slots(fans.n)
    body = np.zeros((len(tractions), 6 * fans.n)) if force is None else force
    of_triangles = np.concatenate([tractions, body], axis=1)[:, place] * sign
    c, n = of_triangles.shape[:2]
    B = fans.B
    hat = np.matmul(of_triangles.reshape(c, n, 9, 2), fans.back.transpose(0, 1, 3, 2)).reshape(c, n, 18)
    tau = (hat @ reference().T).reshape(c, n, 18, 3)
    found: Floats = np.matmul(tau, piola(B).transpose(0, 1, 3, 2)) / fans.doubled_areas[..., None, None]
    return found
