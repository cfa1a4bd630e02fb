"""Stresses in equilibrium on the fan of a polygon (Johnson and Mercier), from tractions on its edges.

On a triangle split at its centroid the symmetric stresses that are linear on the three parts, with tractions that go
on across the inner edges, are determined by the tractions on the three edges, linear there, and the divergences on
the parts: 12 + 6 numbers with three conditions, balance (C. Johnson and B. Mercier, Numer. Math. 30 (1978)). By

    tau = B tau^ B' / det B,    |e| tau n = B |e^| tau^ n^,    div tau = B div^ tau^ / det B

one reference triangle gives all. Body forces f enter by F_k = int f lambda_k: constants on the parts with the same
moments against linear functions, and for the rest, f_1 less these constants, a stress of degree 2 on the parts that
has no traction on the edges of the triangle (four of them, for the four linear parts of a vector). So div tau = -f_1
exactly.

The stress of a triangle whose tractions, balanced by its body force, minimise

    |tau|^2 / 2 in C^-1  -  sum over edges  int tau n . m,      m (motion) linear on each edge,

is linear in m and f, and its nine numbers in balance are found from them. Triangles have in common with their
neighbours m. The spokes of a fan move so that the tractions of both sides cancel, and answer to its outer edges; the
stress of least energy in a body is that of the m of all edges whose tractions agree (:mod:`.equilibrium`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from vemcvx.base.arrays import Floats, Ints
from vemcvx.bound.fan import (
    COEFFICIENTS,
    CORNERS,
    LINEAR_MASS_INVERSE,
    MASS,
    RULE,
    RULE_WEIGHTS,
    STATIONS,
    Fans,
    monomial_slopes,
    monomials,
    summed,
)
from vemcvx.meshes.polygons import right_of

VOIGT = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]])
"""(2, 2, 3) entries of a symmetric tensor by its components xx, yy, xy."""


def _rows(part: int, x: Floats, n: Floats | None = None) -> Floats:
    """(2 q, 54) the vectors tau n at points (q, 2), or div tau, from the values of tau at all stations."""
    along = monomial_slopes(x) if n is None else n[:, None] * monomials(x)[:, None]
    found = np.zeros((len(x), 2, 3, 6, 3))
    found[:, :, part] = np.einsum("qbi,abk->qaik", along @ COEFFICIENTS[part], VOIGT)
    return found.reshape(2 * len(x), 54)


def _conditions(count: int) -> tuple[Floats, Floats, Floats]:
    """Rows of outer tractions, of jumps across inner edges and of divergences at `count` points an edge."""
    outer, jumps, inside = [], [], []
    centre = CORNERS.mean(axis=0)
    for k in range(3):
        start, stop = CORNERS[k], CORNERS[(k + 1) % 3]
        outer.append(_rows(k, np.linspace(start, stop, count), right_of(stop - start)))
        # From corner k to the centroid run the parts k and k - 1.
        x, n = np.linspace(start, centre, count), right_of(centre - start)
        jumps.append(_rows(k, x, n) - _rows((k - 1) % 3, x, n))
        inside.append(_rows(k, STATIONS[k, :3]))
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
    values = np.stack([1.0 - STATIONS[..., :3, :].sum(axis=2), STATIONS[..., :3, 0], STATIONS[..., :3, 1]], axis=2)
    linear = values.reshape(9, 3) @ LINEAR_MASS_INVERSE - np.repeat(constants, 3, axis=0)
    found[:, 12:] += _least(np.concatenate([np.zeros((36, 6)), -np.kron(linear, two)]))
    return found


def _least(data: Floats) -> Floats:
    """(54, j) the stresses of degree 2 and least mean square that meet the conditions at three points by data."""
    stacked = np.concatenate(_conditions(3))
    half = np.kron(np.eye(3), np.kron(np.linalg.cholesky(MASS), np.diag([1.0, 1.0, np.sqrt(2.0)])))
    weighed = np.linalg.inv(half).T
    found: Floats = weighed @ np.linalg.pinv(stacked @ weighed) @ data
    return found


# What linear moments miss: quadratic parts of body forces, and of tractions on the outer edge of a fan triangle, from
# corner 1 to corner 2. Stresses that balance these and nothing else tell what they count.

_ORDER = np.polynomial.legendre.leggauss(4)
_A, _B = (0.5 + 0.5 * one.ravel() for one in np.meshgrid(_ORDER[0], _ORDER[0]))
_POINTS, _WEIGHTS = np.column_stack([_A, _B * (1.0 - _A)]), 0.25 * np.outer(_ORDER[1], _ORDER[1]).ravel() * (1.0 - _A)
"""A rule on the reference triangle that is exact for degree 6."""


_CUBICS = monomials(_POINTS, 3)
_ORTHONORMAL = np.linalg.inv(np.linalg.cholesky(np.einsum("q,qi,qj->ij", _WEIGHTS, _CUBICS, _CUBICS))).T
PARABOLAS = _ORTHONORMAL[:6, 3:6]
"""(6, 3) monomials of quadratic functions, orthonormal, and orthogonal to linear ones."""


def _cubic_shares() -> tuple[Floats, Floats]:
    """Cubic functions orthogonal to quadratic ones, whose squares the rule of 21 points, of degree 5, underrates.

    They are (21, 4) values at the points, orthonormal by the rule, beside (4,) the excess of the integrals of their
    squares over one: .02 to .58.
    """
    values = monomials(RULE.reshape(-1, 2), 3) @ _ORTHONORMAL[:, 6:]
    read, axes = np.linalg.eigh(np.einsum("q,qi,qj->ij", RULE_WEIGHTS, values, values))
    return values @ axes / np.sqrt(read), 1.0 / read - 1.0


CUBICS, CUBIC_SHARES = _cubic_shares()


@cache
def of_parabolas() -> Floats:
    """(3, 3, 6, 6) int of products of components of the cubic stresses that balance parabolas in the triangle."""
    rows = []
    for k in range(3):
        x, n = np.linspace(CORNERS[k], CORNERS[(k + 1) % 3], 4), right_of(CORNERS[(k + 1) % 3] - CORNERS[k])
        rows.append(np.einsum("qi,abk,b->qaik", monomials(x, 3), VOIGT, n).reshape(8, 30))
    x = STATIONS[:, [0, 3]].reshape(6, 2)
    rows.append(np.einsum("qbi,abk->qaik", monomial_slopes(x, 3), VOIGT).reshape(12, 30))
    data = np.concatenate([np.zeros((24, 6)), -np.kron(monomials(x) @ PARABOLAS, np.eye(2))])
    fields = (np.linalg.pinv(np.concatenate(rows)) @ data).reshape(10, 3, 6)
    at = np.einsum("qi,ika->qka", _CUBICS, fields)
    found: Floats = np.einsum("q,qka,qlb->klab", _WEIGHTS, at, at)
    return found


@cache
def of_edge() -> Floats:
    """(3, 3, 2, 2) likewise of stresses that balance the tractions 1 - 6 s (1 - s) on the outer edge."""
    data = np.zeros((54, 2))
    data[6:12] = np.kron([[1.0], [-0.5], [1.0]], np.eye(2))
    at = _least(data).reshape(3, 6, 3, 2)
    found: Floats = np.einsum("ij,piak,pjbl->abkl", MASS, at, at)
    return found


def lifted(fans: Fans, gram: Floats, data: Floats) -> Floats:
    """(c, n) norms in C^-1 of stresses on all triangles by the vectors (c, n, j, 2) that they balance.

    These are |T| / 2 times the coefficients of parabolas, or |e| times those of tractions on outer edges.
    """
    hat = np.matmul(data, fans.back.transpose(0, 1, 3, 2)).reshape(*data.shape[:2], -1)
    squares = np.einsum("ctab,abkl,ctk,ctl->ct", _compliances(fans), gram, hat, hat, optimize=True)
    norms: Floats = np.sqrt(np.maximum(squares, 0.0))
    return norms


def _compliances(fans: Fans) -> Floats:
    """(c, n, 3, 3) by which squares in C^-1 are made of components of stresses in the reference triangle."""
    M = piola(fans.B)
    form: Floats = np.matmul(M.transpose(0, 1, 3, 2), np.matmul(fans.D[:, None], M))
    return form / fans.doubled_areas[..., None, None]


def piola(B: Floats) -> Floats:
    """(..., 3, 3) the components xx, yy, xy of B tau^ B' from those of tau^."""
    (a, b), (c, d) = np.moveaxis(B, (-2, -1), (0, 1))
    rows = [[a * a, b * b, 2.0 * a * b], [c * c, d * d, 2.0 * c * d], [a * c, b * d, a * d + b * c]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@cache
def _balanced() -> Floats:
    """(18, 15) data of the reference triangle in balance: nine tractions alone, and six that bear a force each."""
    ends = np.array([CORNERS[k] for edge in range(3) for k in (edge, (edge + 1) % 3)])
    x = np.concatenate([ends, CORNERS])
    rows = np.stack([np.tile([1.0, 0.0], 9), np.tile([0.0, 1.0], 9), np.column_stack([-x[:, 1], x[:, 0]]).ravel()])
    found = np.zeros((18, 15))
    found[:12, :9] = np.linalg.svd(rows[:, :12])[2][3:].T
    found[:12, 9:], found[12:, 9:] = -np.linalg.pinv(rows[:, :12]) @ rows[:, 12:], np.eye(6)
    return found


@cache
def _energies() -> Floats:
    """(9, 225) int of products of components of the stresses of these."""
    parts = (reference() @ _balanced()).reshape(3, 6, 3, 15)
    found: Floats = np.einsum("ij,piak,pjbl->abkl", MASS, parts, parts)
    return found.reshape(9, 225)


def _condensed(fans: Fans, loaded: bool) -> tuple[Floats, Floats]:
    """Data in balance of the stresses of least energy on triangles, in the reference triangle: the nine without forces.

    From the motions of the three edges (c, n, 9, 12), and from forces int f lambda_k (c, n, 9, 6).
    """
    c, n = fans.corners.shape[:2]
    A, N = (_compliances(fans).reshape(-1, 9) @ _energies()).reshape(c, n, 15, 15), _balanced()[:12, :9]
    # Motions work in the reference triangle as B' m.
    moved = np.matmul(N.reshape(6, 2, 9).transpose(0, 2, 1), fans.B.transpose(0, 1, 3, 2)[:, :, None])
    moved = moved.transpose(0, 1, 3, 2, 4).reshape(c, n, 9, 12)
    if loaded:
        moved = np.concatenate([moved, -np.matmul(A[..., :9, 9:], _hat(fans))], axis=3)
    found = np.asarray(np.linalg.solve(A[..., :9, :9], moved), dtype=np.float64)
    return found[..., :12], found[..., 12:]


def _hat(fans: Fans) -> Floats:
    """(c, n, 6, 6) forces in the reference triangle, B^-1 of each, from those of triangles."""
    return np.kron(np.eye(3), np.ones((2, 2))).astype(np.float64) * np.tile(fans.back, (3, 3))


def _tractions(fans: Fans, data: Floats) -> Floats:
    """(c, n, 12, j) forces of tractions from those in the reference triangle (c, n, 12, j): b = B b^."""
    c, n, _, j = data.shape
    found: Floats = np.matmul(fans.B[:, :, None], data.reshape(c, n, 6, 2, j)).reshape(c, n, 12, j)
    return found


def _slots(n: int) -> Ints:
    """(n, 12) the motions of the edges of each triangle among those of the cell: spokes, then outer edges; 4 n each.

    Spoke i runs from the centre to vertex i; edge 2 of a triangle runs from the vertex to the centre.
    """
    t = np.arange(n)[:, None]
    after = 4 * ((t + 1) % n)
    return np.concatenate([4 * t + np.arange(4), 4 * (n + t) + np.arange(4), after + np.array([2, 3, 0, 1])], axis=1)


@dataclass(frozen=True, eq=False)
class FanStress:
    """The stresses of least energy on fans, as functions of the motion of their edges and of body forces."""

    fans: Fans
    spokes: Floats
    """(k, 4 n, 4 n) motions of both ends of the spokes from those of outer edges; for each of the k shapes"""
    of_body: Floats
    """(k, 8 n, 6 n) motions of spokes, and forces on outer edges, from body forces; (k, 8 n, 0) if there are none"""
    stiffness: Floats
    """(k, 4 n, 4 n) forces on outer edges from their motion, symmetric"""
    triangles: tuple[Floats, Floats] | None
    """data in balance of triangles (k, n, 9, 12) from the motions of their edges, and (k, n, 9, 6) from forces; None if
    there are none"""

    def at_stations(self, motion: Floats, force: Floats | None = None) -> Floats:
        """(c, n, 18, 3) tau at the stations of triangles, from motions of outer edges (c, 4 n) and forces (c, 6 n)."""
        fans, spokes = self.fans, self.fans.apply(self.spokes, motion)
        c, n = fans.corners.shape[:2]
        of_motion, of_force = self.triangles or _condensed(fans.shapes, False)
        of_motion, of_force = fans.of_cells(of_motion), fans.of_cells(of_force)
        if force is not None:
            spokes = spokes + fans.apply(self.of_body[:, : 4 * n], force)
        around = np.concatenate([spokes, motion], axis=1)[:, _slots(n)]
        tau = np.matmul(of_motion, around[..., None])[..., 0] @ (reference() @ _balanced()[:, :9]).T
        if force is not None:
            body = force.reshape(c, n, 6, 1)
            own = np.concatenate([np.matmul(of_force, body), np.matmul(_hat(fans), body)], axis=2)
            tau += own[..., 0] @ (reference() @ _balanced()).T
        back = piola(fans.B).transpose(0, 1, 3, 2) / fans.doubled_areas[..., None, None]
        found: Floats = np.matmul(tau.reshape(c, n, 18, 3), back)
        return found

    def on_edges(self, force: Floats) -> Floats:
        """(c, 4 n) forces of tractions on outer edges that do not move, from body forces (c, 6 n)."""
        return self.fans.apply(self.of_body[:, 4 * self.fans.n :], force)


def fan_stress(fans: Fans, loaded: bool = True) -> FanStress:
    """The FanStress of these fans; `loaded` by body forces or not."""
    shapes = fans.shapes
    c, n = shapes.corners.shape[:2]
    place, N, (of_motion, of_force) = _slots(n), _balanced()[:12], _condensed(shapes, loaded)
    stiffness = _tractions(shapes, np.matmul(N[:, :9], of_motion))
    K, F, m = summed(stiffness, place, place, (8 * n, 8 * n)), np.zeros((c, 8 * n, 0)), 4 * n
    if loaded:
        forces = _tractions(shapes, np.matmul(N[:, :9], of_force) + np.matmul(N[:, 9:], _hat(shapes)))
        F = summed(forces, place, np.arange(6 * n).reshape(n, 6), (8 * n, 6 * n))
    found = -np.linalg.solve(K[:, :m, :m], np.concatenate([K[:, :m, m:], F[:, :m]], axis=2))
    spokes, moved = (np.ascontiguousarray(one) for one in np.split(found, [m], axis=2))
    G = K[:, m:, m:] + K[:, m:, :m] @ spokes
    G = 0.5 * (G + G.transpose(0, 2, 1))
    of_body = np.concatenate([moved, F[:, m:] + K[:, m:, :m] @ moved], axis=1)
    return FanStress(fans, spokes, of_body, G, (of_motion, of_force) if loaded else None)
