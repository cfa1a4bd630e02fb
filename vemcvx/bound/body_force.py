"""Body forces in cells, what they make there alone, and what linear moments miss of loads.

Loads less their linear moments do no work on rigid motions of a triangle T, so that (l - l_1)(w) <= sum osc_T |w|_T,

    osc_T = h_T (K_T / s)^{1/2} ( |f - f_1|_T / pi + (1 / pi^2 + 1 / pi)^{1/2} (|e| / |T|)^{1/2} |t - t_1|_e ),

h_T the diameter, s the least shear modulus (2 mu): Payne and Weinberger's inequality on convex T, the divergence of
(x - a) w^2, a being the apex over the edge e, and Korn's |grad w|^2 <= K |eps(w)|^2 without mean rotation. K = 1 + 2 /
beta^2: the rotation p of w, of mean zero, is div phi of some phi that vanishes on the boundary, beta |grad phi| <= |p|,
and int p^2 = int eps(w) : M with |M| <= |grad phi|. In a triangle with rho the radius of the incircle, and R the
distance of its centre from the farthest corner,

    beta >= rho / (2^{1/2} R) (1 + (1 - rho^2 / R^2)^{1/2})^{-1/2},

the bound of C. O. Horgan and L. E. Payne (Arch. Ration. Mech. Anal. 82 (1983)). It does not hold for all
star-shaped domains, as M. Costabel and M. Dauge found (ibid. 217 (2015), arXiv 1303.6141), but does for polygons
with an incircle:

(i) h and g, conjugate harmonic, int h = 0, have |h|^2 <= G |g|^2. Take h less its value at the centre of the incircle,
from which angles and the boundary r = f(a) are measured; this only enlarges |h|. On each curve r = t f(a), t < 1,
Cauchy's formula for (h + i g)^2 says int (h^2 - g^2 + 2 h g T) da = -2 pi g(0)^2 <= 0, T = f' / f. With c f^2 < 1,

    c int f^2 h^2 da  <=  int (g^2 - 2 h g T - (1 - c f^2) h^2) da  <=  int g^2 (1 + T^2 / (1 - c f^2)) da,

and with t dt integrated, f^2 t dt da being an area, G <= max_a (1 + T^2 / (1 - c f^2)) / (c f^2). Sides that touch the
circle have f^2 = rho^2 (1 + T^2): with b = c rho^2 the fraction is (1 - b) / (b (1 - c f^2)), largest in the farthest
corner, and by the best of all b < rho^2 / R^2 it is G = (R / rho + (R^2 / rho^2 - 1)^{1/2})^2 there.

(ii) Of all phi with div phi = p that vanish on the boundary let phi have the least |grad phi|. Then Delta phi = grad q
for some q, so that s = curl phi and g = q - p are conjugate harmonic, |grad phi|^2 = |p|^2 + |s|^2 = int q p, hence
|s|^2 = int g p. By (i) for g without its mean, |s|^2 <= G^{1/2} |s| |p|: |grad phi|^2 <= (1 + G) |p|^2, and beta^2 >= 1
/ (1 + G), which is the bound.

rho / R is the sine of half the least angle a of the triangle, and the bound is sin(a / 4). By eigenvalues beta^2 is 1.4
to 2.2 times as large (test_inf_sup_constants_are_below_eigenvalues).

What is quadratic in f - f_1 and t - t_1 counts by the norm of a stress that balances it, and only the rest like that.

Body forces in time are combinations of few shapes: a load that grows is one, a wave that travels two. The first of each
is looked at by itself, and of its shape no more than what is at right angles to those before is kept; from a
combination on that is known already, all is combined: what is linear in f by the coefficients, squares by the products
of any two shapes, osc_T by the triangle inequality.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vemcvx.base.arrays import ROUNDING, Floats
from vemcvx.bound.displacement import (
    VALUES,
    FanDisplacement,
    fan_displacement,
    linear_loads,
    outline_forces,
    strains_at_stations,
)
from vemcvx.bound.fan import BARYCENTRIC, LINEAR_MASS_INVERSE, RULE, RULE_WEIGHTS, Fans, inner, monomials, stresses_of
from vemcvx.bound.stress import CUBIC_SHARES, CUBICS, PARABOLAS, FanStress, fan_stress, lifted, of_parabolas

MOST_SHAPES = 4
"""Shapes that are kept: each takes as much memory as its values at the points of the rule, 2 kB a hexagon."""


def _sides(fans: Fans) -> Floats:
    """(c, n, 3) the lengths of the sides of triangles, that on the edge of the cell first."""
    here, ahead = fans.corners, np.roll(fans.corners, -1, axis=1)
    return np.stack([np.linalg.norm(x, axis=2) for x in (ahead - here, ahead, here)], axis=2)


def inf_sup_squares(fans: Fans) -> Floats:
    """(c, n) bounds of beta^2 of the triangles of fans, by discs around their incentres."""
    sides, here, ahead = _sides(fans), fans.corners, np.roll(fans.corners, -1, axis=1)
    around = sides.sum(axis=2)
    # The incentre, the centre of the fan being the origin, and how far it is from the corners.
    middle = (sides[..., 1:2] * here + sides[..., 2:3] * ahead) / around[..., None]
    radius = np.max([np.linalg.norm(middle - x, axis=2) for x in (here, ahead, 0.0 * here)], axis=0)
    ratio = fans.doubled_areas / (around * radius)
    squares: Floats = 0.5 * ratio**2 / (1.0 + np.sqrt(np.maximum(1.0 - ratio**2, 0.0)))
    return squares


def oscillation_constants(fans: Fans) -> tuple[Floats, Floats]:
    """(c, n) by which |f - f_1|_T and |t - t_1|_e count on the triangles of fans, e being their outer edges."""
    sides, area = _sides(fans), 0.5 * fans.doubled_areas
    common = sides.max(axis=2) * np.sqrt((1.0 + 2.0 / inf_sup_squares(fans)) / fans.shear[:, None])
    return common / np.pi, common * np.sqrt((1.0 / np.pi**2 + 1.0 / np.pi) * sides[..., 0] / area)


def integrals(fans: Fans, functions: Floats, f: Floats) -> Floats:
    """(c, 2 j n) int f phi of body forces (c, n, 21, 2) and functions (21, j) at the points of the rule."""
    found: Floats = np.matmul((RULE_WEIGHTS[:, None] * functions).T, f) * fans.doubled_areas[..., None, None]
    return found.reshape(len(f), -1)


def missed_forces(f: Floats) -> tuple[Floats, Floats]:
    """Coefficients (c, n, 3, 2) of the parabolas in body forces f (c, n, 21, 2), given at the points of the rule.

    Besides, (c, n) the mean of |f - f_2|^2, exact for cubic f. Differences that are rounding count as zero.
    """
    rounding = ROUNDING * float(np.abs(f).max())
    weighed = RULE_WEIGHTS[:, None] * f
    bent = monomials(RULE.reshape(-1, 2)) @ PARABOLAS
    parabolas = np.matmul(bent.T, weighed)
    parabolas[np.abs(parabolas) <= rounding] = 0.0
    linear = BARYCENTRIC @ LINEAR_MASS_INVERSE @ BARYCENTRIC.T
    rest = f - np.matmul(linear, weighed) - np.matmul(bent, parabolas)
    rest[np.abs(rest) <= rounding] = 0.0
    squares = np.einsum("q,ctqd,ctqd->ct", RULE_WEIGHTS, rest, rest)
    cubic = np.matmul((RULE_WEIGHTS[:, None] * CUBICS).T, rest)
    return parabolas, 2.0 * (squares + np.einsum("k,ctkd,ctkd->ct", CUBIC_SHARES, cubic, cubic))


@dataclass(frozen=True, eq=False)
class Body:
    """Body forces f in a chunk of cells, and what they make alone."""

    edges: Floats
    """(c, 4 n) b_f"""
    mixed: Floats
    """(c, 4 n) L' b_f, and the work of f_1 on displacements of the outline"""
    outline: Floats
    """(c, 4 n) the work of f on these"""
    squares: Floats
    """(c,) |r_f|^2"""
    missed: Floats
    """(c, n) osc_T"""
    energy: float
    """|v_f|^2 of the displacement v_f that vanishes on outlines"""
    work: float
    """int f v_f"""


@dataclass(frozen=True, eq=False)
class _Shapes:
    """Shapes of body forces in a chunk of cells: the fields of :class:`Body` of each, and products of any two."""

    edges: Floats
    mixed: Floats
    outline: Floats
    """(m, c, ...)"""
    missed: Floats
    """(m, c, n)"""
    squares: Floats
    """(m, m, c)"""
    energy: Floats
    work: Floats
    """(m, m)"""

    def combined(self, s: Floats) -> Body:
        """The combination by coefficients s (m,)."""
        return Body(
            edges=np.tensordot(s, self.edges, 1),
            mixed=np.tensordot(s, self.mixed, 1),
            outline=np.tensordot(s, self.outline, 1),
            missed=np.tensordot(np.abs(s), self.missed, 1),
            squares=np.tensordot(s, np.tensordot(s, self.squares, 1), 1),
            energy=float(s @ self.energy @ s),
            work=float(s @ self.work @ s),
        )


@dataclass(frozen=True, eq=False)
class BodyForces:
    """Body forces on a mesh, and those that were asked for before."""

    fans: tuple[Fans, ...]
    known: list[Floats] = field(default_factory=list)
    """densities, chunk after chunk, of shapes at right angles to each other"""
    made: list[tuple[_Shapes, ...]] = field(default_factory=list)
    """what all of them make, chunk by chunk, once that was asked for"""

    def of(self, densities: Sequence[Floats]) -> tuple[Body, ...]:
        """The fields of body forces (c, n, 21, 2) of each chunk; none where there are no forces."""
        if not densities:
            return ()
        f = np.concatenate([density.ravel() for density in densities])
        s = np.array([f @ shape / (shape @ shape) for shape in self.known])
        left, largest = f.copy(), np.abs(f).max()
        for part, shape in zip(s, self.known, strict=True):
            left -= part * shape
        if self.known and np.abs(left).max() <= ROUNDING * largest:
            if not self.made:
                self.made.append(self._shapes(self.known))
            return tuple(one.combined(s) for one in self.made[0])
        found = self._shapes([f])
        if largest > 0.0:
            self.made.clear()
            if len(self.known) in (0, MOST_SHAPES):
                self.known.clear()
                self.made.append(found)
                left = f
            self.known.append(left)
        return tuple(one.combined(np.ones(1)) for one in found)

    def _shapes(self, densities: Sequence[Floats]) -> tuple[_Shapes, ...]:
        """The fields of some densities, chunk by chunk."""
        ends = np.cumsum([one.nodes.size for one in self.fans])[:-1]
        parts = [np.split(f.reshape(-1, 21, 2), ends) for f in densities]
        return tuple(
            _shapes(one, [part.reshape(*one.nodes.shape, 21, 2) for part in each])
            for one, *each in zip(self.fans, *parts, strict=True)
        )


def alone(fans: Fans, f: Floats) -> tuple[Floats, Floats]:
    """v_f (c, n, 20) and r_f (c, n, 18, 3) at stations, of body forces (c, n, 21, 2)."""
    return _alone(fan_displacement(fans), fan_stress(fans), integrals(fans, BARYCENTRIC, f))


def _alone(displacement: FanDisplacement, stress: FanStress, F: Floats) -> tuple[Floats, Floats]:
    """The same from their moments (c, 6 n)."""
    fans, still = displacement.fans, np.zeros((len(F), 4 * displacement.fans.n))
    v = displacement.nodal(still, F)
    return v, stress.at_stations(still, F) - stresses_of(fans, strains_at_stations(fans, v))


def _shapes(fans: Fans, densities: Sequence[Floats]) -> _Shapes:
    """The _Shapes of some densities.

    The matrices by which fans answer to body forces are made here and let go: of hexagons they take 33 kB a cell.
    """
    displacement, stress, fields, defects = fan_displacement(fans), fan_stress(fans), [], []
    for f in densities:
        F, loads = integrals(fans, BARYCENTRIC, f), integrals(fans, VALUES, f).reshape(*f.shape[:2], 20)
        (v, r), linear, edges = _alone(displacement, stress, F), linear_loads(F), stress.on_edges(F)
        mixed, outline = outline_forces(edges) + displacement.on_outline(linear), displacement.on_outline(loads)
        fields.append((edges, mixed, outline, _missed(fans, f), linear, loads, v))
        defects.append(r)
    edges, mixed, outline, missed, linear, loads, v = map(np.stack, zip(*fields, strict=True))
    strained = [np.matmul(r, fans.D[:, None]) for r in defects]
    return _Shapes(
        edges=edges,
        mixed=mixed,
        outline=outline,
        missed=missed,
        squares=np.array([[inner(fans, r, other).sum(axis=1) for other in strained] for r in defects]),
        energy=np.einsum("icta,jcta->ij", linear, v),
        work=np.einsum("icta,jcta->ij", loads, v),
    )


def _missed(fans: Fans, f: Floats) -> Floats:
    """(c, n) osc_T of body forces (c, n, 21, 2)."""
    parabolas, rest = missed_forces(f)
    missed = oscillation_constants(fans)[0] * np.sqrt(0.5 * fans.doubled_areas * rest)
    return missed + lifted(fans, of_parabolas(), fans.doubled_areas[..., None, None] * parabolas)
