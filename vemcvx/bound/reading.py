"""The reading of loads: bounds know these at points, and a second, finer reading tells how well.

Moments of body forces are read at 21 points of a triangle of a fan, those of tractions at three of each piece of the
boundary. Both rules are exact for cubic functions on the triangles, or the pieces, times the quadratic displacements
there, and for such loads bounds are theorems. For all others they are theorems for the loads *as read*. The second
reading has four times as many points inside, twice as many on the boundary. The difference of the works of both on
displacements is a functional d(w); that of the exact load, e(w), is taken for no more than SAFETY times as large,
triangle by triangle. On edges a jump may lie between two points of both rules; e(w) has there also the steps between
neighbouring points, of what is left of the load without its best polynomial of degree DEGREE, times their distance.

Answers to two loads are no farther apart than eta = sup e(w) / |w|, also with friction and contact, and what a step
minimises no farther than |e(v)| + eta |u - v| + eta^2 / 2. eta is estimated as in :mod:`.data_oscillation`. So
allowances are estimates, and what is narrower than the distance of points may be missed by both readings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from vemcvx.base.arrays import ROUNDING, Floats, totals
from vemcvx.bound.data_oscillation import POINCARE, DataOscillation
from vemcvx.bound.displacement import VALUES, spread
from vemcvx.bound.fan import COEFFICIENTS, RULE_WEIGHTS, TRIANGLES, Fans, monomials
from vemcvx.bound.surface import GAUSS, GAUSS_WEIGHTS, Boundary
from vemcvx.meshes.polygons import RADON_POINTS, RADON_WEIGHTS

SAFETY = 2.0
"""With this exact quantities took .65 of their allowance at most: 60 body forces with jumps, strips and peaks at random
places, on squares, triangles, hexagons and Voronoi cells, a force and a mean displacement of each."""
DEGREE = 2 * len(GAUSS) - 3
"""The degree of loads that both rules integrate exactly beside a quadratic displacement."""

_MIDDLES = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]]) / 2.0
_QUARTERS = np.stack([_MIDDLES, *(np.stack([np.eye(3)[k], _MIDDLES[k], _MIDDLES[k - 1]]) for k in range(3))])
POINTS = np.stack([np.concatenate([RADON_POINTS @ one @ part for one in _QUARTERS]) for part in TRIANGLES])
"""(3, 28, 2) the finer rule: Radon's points in the quarters of each part of the reference triangle."""
_FINE = np.stack([spread(monomials(POINTS[k]) @ COEFFICIENTS[k], k) for k in range(3)])
_FINE = np.tile(RADON_WEIGHTS / 24.0, 4)[:, None] * _FINE
_COARSE = (RULE_WEIGHTS[:, None] * VALUES).reshape(3, 7, 10)
TWICE = np.concatenate([0.5 * (GAUSS - 1.0), 0.5 * (GAUSS + 1.0)])
"""(6,) points of the finer rule on pieces, in [-1, 1]."""


@dataclass(frozen=True, eq=False)
class Reading:
    """The difference of two readings of the loads at an instant."""

    boundary: Boundary
    fans: tuple[Fans, ...]
    body: tuple[Floats, ...]
    """(c, n, 3, 10, 2) of each chunk of cells the work on the ten functions of triangles, by parts of these"""
    edges: Floats
    """(b, 3, 2) the work on linear functions from either end of edges, and on the parabola"""
    unseen: Floats
    """(b, 2) on edges what may lie between points"""

    @property
    def exact(self) -> bool:
        """True where the readings agree to rounding: loads are polynomials as far as the points tell."""
        return not (self.edges.any() or self.unseen.any() or any(one.any() for one in self.body))

    def __sub__(self, other: Reading) -> Reading:
        """The part of the difference that is new since another instant."""
        body = tuple(a - b for a, b in zip(self.body, other.body, strict=True))
        unseen = np.abs(self.unseen - other.unseen)
        return Reading(self.boundary, self.fans, body, self.edges - other.edges, unseen)

    def work(self, values: Sequence[Floats], ends: Floats, bent: Floats | float = 0.0) -> float:
        """|e(w)| of w with values (c, n, 20) in triangles, (b, 2, 2) at the ends of edges, bent by parabolas (b, 2)."""
        parts = [
            np.abs(np.einsum("ctpid,ctid->ctp", one, v.reshape(*one.shape[:2], 10, 2))).sum()
            for one, v in zip(self.body, values, strict=False)
        ]
        along = np.abs(np.sum(self.edges[:, :2] * ends, axis=(1, 2)) + np.sum(self.edges[:, 2] * bent, axis=1))
        largest = np.abs(ends).max(axis=1) + np.abs(bent)
        return SAFETY * float(sum(parts) + along.sum() + np.sum(self.unseen * largest))

    @cached_property
    def energy(self) -> float:
        """eta."""
        if self.exact:
            return 0.0
        edges, oscillation = self.boundary.edges, self.boundary.oscillation
        cells, local = np.zeros((len(edges.areas), 2)), np.zeros(len(edges.areas))
        for fans, one in zip(self.fans, self.body, strict=False):
            forces = one.sum(axis=3)
            cells[fans.cells] = forces.sum(axis=(1, 2))
            local[fans.cells] = np.sum(6.0 * forces**2 / fans.doubled_areas[..., None, None], axis=(1, 2, 3))
        local *= POINCARE * edges.sizes**2 / edges.shear
        compliant = 1.0 / (2.0 * edges.shear[edges.outer])
        squares = float(local.sum() + np.sum(compliant[:, None, None] * self.edges[:, :2] ** 2))
        seen = squares + _of_the_body(oscillation, self.edges[:, :2].sum(axis=1), cells)
        between = float(np.sum(compliant[:, None] * self.unseen**2))
        between += _of_the_body(oscillation, self.unseen, 0.0 * cells)
        return SAFETY * float(np.sqrt(seen) + np.sqrt(between))


def _of_the_body(oscillation: DataOscillation, on_edges: Floats, in_cells: Floats) -> float:
    return float(np.sum(oscillation.of_the_body(on_edges, in_cells)))


def reading(boundary: Boundary, fans: tuple[Fans, ...], densities: Sequence[Floats], t: float) -> Reading:
    """The Reading of the loads at an instant, whose body forces are (c, n, 21, 2) at the points of the first rule."""
    loads, body = boundary.oscillation.body_loads, []
    if any(callable(load.value) for load in loads):
        for one, first in zip(fans, densities, strict=True):
            c, n = first.shape[:2]
            x = one.points(POINTS).reshape(-1, 2)
            f = np.sum([load.at(x, t) for load in loads], axis=0).reshape(c, n, 3, 28, 2)
            apart = np.matmul(_FINE.transpose(0, 2, 1), f)
            apart -= np.matmul(_COARSE.transpose(0, 2, 1), first.reshape(c, n, 3, 7, 2))
            apart[np.abs(apart) <= ROUNDING * max(np.abs(f).max(), np.abs(first).max())] = 0.0
            body.append(apart * one.doubled_areas[..., None, None, None])
    return Reading(boundary, fans, tuple(body), *_on_edges(boundary, t))


def _on_edges(boundary: Boundary, t: float) -> tuple[Floats, Floats]:
    """The differences (b, 3, 2) on edges, and (b, 2) what may lie between points."""
    count = len(boundary.edges.outer)
    if not any(callable(load.value) for part in boundary.oscillation.parts for load in part.loads):
        return np.zeros((count, 3, 2)), np.zeros((count, 2))
    owner, lengths = boundary.fine.piece_owner, boundary.edges.lengths
    s, weights = boundary.rule(TWICE, 0.5 * np.tile(GAUSS_WEIGHTS, 2))
    fine, first = boundary.tractions(t, s), boundary.tractions(t, boundary.gauss)
    rounding = ROUNDING * max(np.abs(fine).max(), np.abs(first).max())
    apart = boundary.works(s, weights, fine) - boundary.moments(first)
    apart[np.abs(apart) <= rounding * lengths[:, None, None]] = 0.0
    # The points of all edges one after the other, as pieces are; without the best polynomial of each.
    edge, place, rest = np.repeat(owner, len(TWICE)), s.ravel(), fine.reshape(-1, 2).copy()
    legendre = np.polynomial.legendre.legvander(2.0 * place - 1.0, DEGREE) * np.sqrt(2.0 * np.arange(DEGREE + 1) + 1.0)
    weighed = legendre * (weights.ravel() / lengths[edge])[:, None]
    # The rule is not quite exact for products of these; what one projection leaves the next ones take.
    for _, component in product(range(3), range(2)):
        best = np.stack([totals(edge, one * rest[:, component], count) for one in weighed.T], axis=1)
        rest[:, component] -= np.einsum("qj,qj->q", legendre, best[edge])
    rest[np.abs(rest) <= 10.0 * rounding] = 0.0
    same = (edge[1:] == edge[:-1])[:, None]
    steps = np.where(same, np.abs(np.diff(rest, axis=0)) * np.abs(np.diff(place))[:, None], 0.0)
    unseen = np.stack([totals(edge[1:], one, count) for one in steps.T], axis=1) * lengths[:, None]
    return apart, unseen
