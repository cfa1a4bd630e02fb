"""The certificate: how far an answer is from the solution, whoever made it.

For the program of a step (``StepProgram``), any d within its bounds, any lam with |lam_i| <= w_i and p >= 0, let s =
B d - b, z = D d - e and r = g - B'lam - D'p - K d. Then

    gap = 1/2 r'K^{-1}r + sum_i (w_i |s_i| - lam_i . s_i) + sum_j ( (z_j)_+^2 / (2 c_j) + c_j p_j^2 / 2 - p_j z_j )

is primal minus dual objective, and

    Theorem 1.  1/2 |d - d*|_K^2 <= gap.

Proof. Write the terms as h(Ad) with their conjugate h*; of w|s|: 0 where |lam| <= w; of (z_+)^2 / 2c: c p^2 / 2 where
p >= 0 (c = 0: the bound z <= 0, and 0). With v = K^{-1}(g - B'lam - D'p) the dual value is
G = -1/2 v'Kv - lam.b - p.e - sum c p^2 / 2, the primal value P(d) = 1/2 d'Kd - g'd + sum w|s| + sum z_+^2 / 2c, and
P(d) - G is the gap, because g'd = v'Kd + lam.Bd + p.Dd. P is K-strongly convex with minimiser d*, so
P(d) >= P(d*) + 1/2 |d - d*|_K^2, and weak duality P(d*) >= G ends it.  QED

Where K has a kernel N (:mod:`vemcvx.program.kernel`) all this holds in the seminorm |.|_K, with K^{-1} any inverse of
K on balanced forces; where N'r does not vanish, the gap is infinite.

Signs: friction acts on the body with the forces -B'lam, limits with -D'p. Where friction is one-way its bias c is part
of the load: g contains -B'c, and a history's multipliers are lam + c, with lam those of the program, |lam_i| <= w_i.

The gap is linear in the slip of a term that sticks: with |lam| < w it is w|s| - lam.s. A slip of 1e-16, left by
rounding, makes a gap of that size, and certifies no more than its root, 1e-8. Where a row reads one unknown of its own
such slips are exact zeros; where it reads several they are not. A move v that puts them in place enters quadratically:

    Theorem 2.  For every field v that leaves d - v within the bounds, z_j(d - v) <= 0 where c_j = 0, with |r|^2 =
    r'K^{-1}r at d, and T(v) the parts of norm terms and limits in the gap at d - v,
    |d - d*|_K <= 2 |v|_K + sqrt(|r|^2 + 2 T(v)).

Proof. |d - d*|_K <= |v|_K + |d - v - d*|_K. The residual at d - v is r + K v, and 1/2 |d - v - d*|_K^2 <=
1/2 |r + K v|^2 + T(v) by theorem 1, with |r + K v| <= |r| + |K v| = |r| + |v|_K; at last sqrt((a + b)^2 + c) <=
b + sqrt(a^2 + c).  QED

Of v nothing else is assumed, and where it oversteps a bound T(v) is infinite, as (z_j)_+^2 / 2c_j is for c_j = 0: the
theorem then says nothing. (K = I, g = (10, 0), d_1 <= 0, d = (0, 1), p = 10, v = (-.05, 0): without that T(v) would be
-p z = -.5 and the bound .1, of the true error 1.) An excess below the rounding of D d - e counts as none. With v = 0 it
is the gap itself, and the smaller bound is taken. v solves A v = x on the rows A of terms that seem to stick and of
limits that seem to act, x their slips s and their excesses z - c p over what they press:  v = K^{-1}A'y,
A K^{-1}A'y = x.  Rows that depend on others make that singular; least squares then puts in
place what can be, and the rest stays in T.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from vemcvx.arrays import EPS, Floats, directions, lengths
from vemcvx.outline import ArrayRecord

BOUND_ROUNDING = 4 * EPS
"""Rounding of |w lam / |lam|| relative to w: a root, a quotient, a product, and a root again. A multiplier that near to
its bound counts as one on the bound, which few floats are exactly."""


@dataclass(frozen=True, repr=False, eq=False)
class Certificate(ArrayRecord):
    """A bound on the error of one answer.

    Parameters
    ----------
    equilibrium : float
        1/2 r'K^{-1}r.
    friction : (m,) array
        w_i |s_i| - lam_i . s_i, term by term: where on the boundary the answer is not converged.
    floor : float
        What round-off alone may hide in, or add to, the gap.
    limits : (r,) array
        The part of every limit.
    distance : float
        1/2 |d - d'|_K^2 to a solution d' that is at hand, where weights depend on the answer and no gap bounds it
        (:mod:`vemcvx.stepping.fixed_point`).
    estimate : bool
        Whether that is an estimate, not a bound.
    moved : float
        2 |v|_K of the move v that puts in place what sticks (theorem 2); the other parts are those after it.
    """

    equilibrium: float
    friction: Floats
    floor: float
    limits: Floats = field(default_factory=lambda: np.zeros(0))
    distance: float = 0.0
    estimate: bool = False
    moved: float = 0.0

    def times(self, unit: float) -> Certificate:
        """The same certificate in other units of energy."""
        parts = unit * self.equilibrium, unit * self.friction, unit * self.floor, unit * self.limits
        return Certificate(*parts, unit * self.distance, self.estimate, float(np.sqrt(unit)) * self.moved)

    def away(self, error: float, estimate: bool | None = None) -> Certificate:
        """The certificate of an answer whose error |d - d*|_K is known in another way than by the gap."""
        friction, limits = np.zeros_like(self.friction), np.zeros_like(self.limits)
        kind = self.estimate if estimate is None else estimate
        return Certificate(0.0, friction, self.floor, limits, distance=0.5 * error * error, estimate=kind)

    @cached_property
    def gap(self) -> float:
        """1/2 |d - d*|_K^2 <= gap (up to `floor`); infinite where it is no number, which certifies nothing.

        Primal minus dual objective; where `moved` > 0 it bounds the error alone (theorem 2).
        """
        gap = self.equilibrium + float(self.friction.sum()) + float(self.limits.sum()) + self.distance
        return moved_gap(self.moved, gap) if gap >= 0 else np.inf

    @cached_property
    def error(self) -> float:
        """|d - d*|_K <= error = sqrt(2 gap)."""
        return float(np.sqrt(2.0 * self.gap))

    @property
    def error_floor(self) -> float:
        """The part of the error that the floor accounts for, sqrt(2 floor)."""
        return float(np.sqrt(2.0 * self.floor))

    @property
    def at_floor(self) -> bool:
        """True if round-off accounts for all of the error, so that no less can be asked for."""
        return self.gap <= self.floor


def moved_gap(moved: float, gap: float) -> float:
    """Half the square of moved + sqrt(2 gap), an error."""
    return 0.5 * (moved + float(np.sqrt(2.0 * gap))) ** 2 if moved else gap


def norm_gaps(w: Floats, lam: Floats, s: Floats) -> Floats:
    """w_i |s_i| - lam_i . s_i >= 0 for |lam_i| <= w_i, (m,).

    Without cancellation it is (w - |lam|)|s| + |lam||s| |lam/|lam| - s/|s||^2 / 2.
    """
    size, slip = lengths(lam), lengths(s)
    # Where one of them vanishes it takes the direction out of the sum, whatever that is.
    apart = directions(lam, size) - directions(s, slip)
    short = np.where(size >= (1.0 - BOUND_ROUNDING) * w, 0.0, w - size)
    gaps: Floats = short * slip + 0.5 * size * slip * np.einsum("ij,ij->i", apart, apart)
    return gaps


def limit_gaps(compliance: Floats, p: Floats, z: Floats, blur: Floats) -> Floats:
    """(z_j)_+^2 / 2c_j + c_j p_j^2 / 2 - p_j z_j >= 0 for p >= 0, (r,); infinite beyond a bound by more than `blur`.

    Without cancellation it is (z - c p)^2 / 2c where z > 0, and c p^2 / 2 + p |z| elsewhere.
    """
    if len(p) == 0:
        return p
    soft, above = compliance > 0, z > 0
    gap = 0.5 * compliance * p * p + p * np.abs(np.minimum(z, 0.0))
    both = soft & above
    gap[both] = (z[both] - compliance[both] * p[both]) ** 2 / (2 * compliance[both])
    gap[above & ~soft & (z > blur)] = np.inf
    return gap
