"""The conforming displacement inside polygons: virtual functions made explicit on the fan of each cell.

On the edges of the mesh it is what the virtual function is, linear between nodal values; inside, it minimises the
energy of the cell under its body force over continuous functions of degree 2 on the split fan, whose divergences are
as free as pressures are (Scott and Vogelius on the split of Alfeld). Functions of degree 1 on the fan lock: they gave
22 for an error of .026 at lambda = 1e6.

A triangle has ten nodes: three corners, the middles of its edges from corner k to corner k + 1, the centroid, and the
middles between corner k and the centroid. The last four are inside of it and answer to those around; of these the hub
of the cell, the centre of the fan and the middles of spokes, answers to the outline: the vertices, and the middles of
the polygon's edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from vemcvx.base.arrays import Floats, Ints, read_only
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
    summed,
)
from vemcvx.bound.stress import VOIGT

NODES = np.array([[k, (k + 1) % 3, 6, 3 + k, 7 + (k + 1) % 3, 7 + k] for k in range(3)])
"""(3, 6) the nodes of a triangle at the stations of each part."""


def spread(values: Floats, part: int) -> Floats:
    """(..., 10) functions of the triangle from Lagrange functions (..., 6) of a part."""
    found = np.zeros((*values.shape[:-1], 10))
    found[..., NODES[part]] = values
    return found


VALUES = np.concatenate([spread(monomials(RULE[k]) @ COEFFICIENTS[k], k) for k in range(3)])
"""(21, 10) the functions at the points of the rule."""
SLOPES = np.concatenate([spread(monomial_slopes(STATIONS[k]) @ COEFFICIENTS[k], k) for k in range(3)])
"""(18, 2, 10) their gradients at the stations."""
GRAM = np.einsum("ij,piak,pjbl->abkl", MASS, SLOPES.reshape(3, 6, 2, 10), SLOPES.reshape(3, 6, 2, 10))
"""(2, 2, 10, 10) int of products of slopes."""
LOADS = LINEAR_MASS_INVERSE @ np.einsum("q,qk,qi->ki", RULE_WEIGHTS, BARYCENTRIC, VALUES)
"""(3, 10) int f phi_i of a linear f from its F_k = int f lambda_k."""


@dataclass(frozen=True, eq=False)
class FanDisplacement:
    """Displacements inside cells from those of their outlines, and the energy of the latter.

    A cell's hub, its centre and the middles of its spokes, answers to the outline, and four nodes inside a triangle to
    those around it.
    """

    fans: Fans
    hub: Floats
    """(k, 2 n + 2, 4 n) values on the hub from those on the outline; for each of the k shapes"""
    of_body: Floats
    """(k, 2 n + 2, 6 n) likewise from body forces; (k, 2 n + 2, 0) if there are none"""
    stiffness: Floats
    """(k, 4 n, 4 n) the energy |v|_a^2 as a quadratic form of values on the outline"""
    triangles: tuple[Floats, Floats] | None
    """values at nodes inside triangles (k, n, 8, 12) from those around, and (k, n, 8, 8) from loads on them; None if
    there are none"""

    def nodal(self, outline: Floats, force: Floats | None = None) -> Floats:
        """(c, n, 20) values at the nodes of triangles, from (c, 4 n) and body forces (c, 6 n)."""
        hub, (within, of_loads) = self.fans.apply(self.hub, outline), self._within()
        hub = hub if force is None else hub + self.fans.apply(self.of_body, force)
        around = np.concatenate([hub, outline], axis=1)[:, _slots(self.fans.n)]
        inner = np.matmul(within, around[..., None])
        if force is not None:
            inner += np.matmul(of_loads, linear_loads(force)[:, :, 12:, None])
        return np.concatenate([around, inner[..., 0]], axis=2)

    def on_outline(self, forces: Floats) -> Floats:
        """(c, 4 n) the work of forces (c, n, 20) at nodes of triangles on motions of the outline."""
        c, n, _ = forces.shape
        total, place, (within, _) = np.zeros((c, 6 * n + 2)), _slots(n), self._within()
        around = forces[..., :12] + np.matmul(forces[:, :, None, 12:], within)[:, :, 0]
        for t in range(n):
            total[:, place[t]] += around[:, t]
        inner, outer = np.split(total, [2 * n + 2], axis=1)
        return outer + self.fans.apply(self.hub.transpose(0, 2, 1), inner)

    def _within(self) -> tuple[Floats, Floats]:
        """The same of all cells, anew where they are not kept."""
        within, of_loads = self.triangles or _condensed(self.fans.shapes, False)[:2]
        return self.fans.of_cells(within), self.fans.of_cells(of_loads)


def _slots(n: int) -> Ints:
    """(n, 12) the unknowns of the nodes around a triangle among those of the cell: its hub, then its outline."""
    t, after = np.arange(n), (np.arange(n) + 1) % n
    nodes = np.column_stack([0 * t, 1 + n + t, 1 + n + after, 1 + t, 1 + 2 * n + t, 1 + after])
    return (2 * nodes[:, :, None] + np.arange(2)).reshape(n, 12)


def _condensed(fans: Fans, loaded: bool) -> tuple[Floats, Floats, Floats]:
    """The triangles of a FanDisplacement, and the stiffness (c, n, 12, 12) of the nodes around them."""
    c, n = fans.corners.shape[:2]
    C = np.einsum("prk,ckl,qsl->cprqs", VOIGT, fans.C, VOIGT)
    tensor = np.einsum("ct,ctar,ctbs,cprqs->ctpqab", fans.doubled_areas, fans.back, fans.back, C, optimize=True)
    # Functions of the triangle by components, ordered as nodal values are.
    each = (tensor.reshape(-1, 4) @ GRAM.reshape(4, 100)).reshape((c, n, 2, 2, 10, 10))
    K = each.transpose((0, 1, 4, 2, 5, 3)).reshape(c, n, 20, 20)
    # Solved with: by inverses all but five digits were lost at lambda = 1e6, and so 1e-15 of the largest entry.
    right = -K[..., 12:, :12]
    if loaded:
        right = np.concatenate([right, np.broadcast_to(np.eye(8), (c, n, 8, 8))], axis=3)
    inner = np.linalg.solve(K[..., 12:, 12:], right)
    within, of_loads = inner[..., :12], inner[..., 12:]
    return within, of_loads, K[..., :12, :12] + np.matmul(K[..., :12, 12:], within)


def fan_displacement(fans: Fans, loaded: bool = True) -> FanDisplacement:
    """The FanDisplacement of these fans; `loaded` by body forces or not."""
    shapes = fans.shapes
    c, n = shapes.corners.shape[:2]
    place, m = _slots(n), 2 * n + 2
    within, of_loads, each = _condensed(shapes, loaded)
    K, right = summed(each, place, place, (6 * n + 2, 6 * n + 2)), np.zeros((c, m, 0))
    if loaded:
        of_forces = np.kron(LOADS.T, np.eye(2))
        loads = of_forces[:12] + np.matmul(within.transpose(0, 1, 3, 2), of_forces[12:])
        right = summed(loads, place, np.arange(6 * n).reshape(n, 6), (6 * n + 2, 6 * n))[:, :m]
    found = np.linalg.solve(K[:, :m, :m], np.concatenate([-K[:, :m, m:], right], axis=2))
    hub, of_body = (np.ascontiguousarray(one) for one in np.split(found, [4 * n], axis=2))
    S = K[:, m:, m:] + K[:, m:, :m] @ hub
    S = 0.5 * (S + S.transpose(0, 2, 1))
    return FanDisplacement(fans, hub, of_body, S, (within, of_loads) if loaded else None)


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
def _to_edges(n: int) -> Floats:
    """(4 n, 4 n) the motions of outer edges from values at vertices and middles: see edge_motions."""
    vertices, middles = np.split(np.eye(4 * n), 2, axis=1)
    here = vertices.reshape(-1, n, 2)
    ahead = np.roll(here, -1, axis=1)
    bubble = (middles.reshape(-1, n, 2) - 0.5 * (here + ahead)) / 1.5
    return read_only(np.stack([here + bubble, ahead + bubble], axis=2).reshape(4 * n, 4 * n))


def edge_motions(outline: Floats) -> Floats:
    """(c, 4 n) motions of outer edges, linear on each, on which linear tractions do the work that they do on these."""
    motions: Floats = outline @ _to_edges(outline.shape[1] // 4)
    return motions


def outline_forces(forces: Floats) -> Floats:
    """(c, 4 n) the work of forces (c, 4 n) at both ends of outer edges on values at vertices and middles."""
    work: Floats = forces @ _to_edges(forces.shape[1] // 4).T
    return work


def edge_forces(fans: Fans, stress: Floats) -> Floats:
    """(c, 4 n) int tau n phi at both ends of the outer edges, of constant stresses (c, 3)."""
    half = np.matmul(fans.normals, 0.5 * stress[:, [[0, 2], [2, 1]]])
    return np.repeat(half[:, :, None], 2, axis=2).reshape(len(stress), 4 * fans.n)


def linear_loads(force: Floats) -> Floats:
    """(c, n, 20) the work of body forces (c, 6 n), linear in each triangle, on its functions."""
    found: Floats = np.matmul(LOADS.T, force.reshape(len(force), -1, 3, 2)).reshape(len(force), -1, 20)
    return found


def strains_at_stations(fans: Fans, v: Floats) -> Floats:
    """(c, n, 18, 3) e_xx, e_yy, 2 e_xy at the stations of all triangles, of nodal values (c, n, 20)."""
    c, n, _ = v.shape
    # Along the axes of the reference triangle, station by station.
    along = np.matmul(SLOPES.reshape(36, 10), v.reshape(c, n, 10, 2)).reshape(c, n, 18, 2, 2)
    slopes = np.matmul(fans.back.transpose(0, 1, 3, 2)[:, :, None], along)
    return np.stack([slopes[..., 0, 0], slopes[..., 1, 1], slopes[..., 0, 1] + slopes[..., 1, 0]], axis=3)
