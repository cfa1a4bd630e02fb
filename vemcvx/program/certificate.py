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

Signs: friction acts on the body with the forces -B'lam, limits with -D'p.

The gap is linear in the slip of a term that sticks: with |lam| < w it is w|s| - lam.s. A slip of 1e-16, left by
rounding, makes a gap of that size, and certifies no more than its root, 1e-8. A move v that puts it in place enters
quadratically:

    Theorem 2.  For every v that leaves d - v within the bounds, with |r|^2 = r'K^{-1}r at d, and T(v) the parts of norm
    terms and limits in the gap at d - v,    |d - d*|_K <= 2 |v|_K + sqrt(|r|^2 + 2 T(v)).

Proof. |d - d*|_K <= |v|_K + |d - v - d*|_K. The residual at d - v is r + K v, and 1/2 |d - v - d*|_K^2 <=
1/2 |r + K v|^2 + T(v) by theorem 1, with |r + K v| <= |r| + |v|_K; at last sqrt((a + b)^2 + c) <= b +
sqrt(a^2 + c).  QED

It is used for rows whose part of the gap exceeds the energy of a move that puts them alone in place; the smaller bound
is taken.

Rounding of r = g - B'lam - D'p - K d hides up to ROUNDED a_i in its entries, with a the sum of the sizes of its terms,
and so an energy of floor = 1/2 sum_i (ROUNDED a_i)^2 f_i with f the diagonal of K^{-1}. Errors are bounded by error +
error_floor, the roots of twice the gap and of twice the floor. A condensed program sees the unknowns of its rows alone,
and its S is taken as it was computed; steps that are stored are certified by r and floor of all unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vemcvx.base.arrays import EPS, Floats, directions, lengths
from vemcvx.base.outline import ArrayRecord

BOUND_ROUNDING = 4 * EPS
"""Rounding of |w lam / |lam|| relative to w: a root, a quotient, a product, and a root again. A multiplier that near to
its bound counts as one on the bound, which few floats are exactly."""

ROUNDED = 8 * EPS
"""Rounding of a sum, relative to the sizes of its terms, of sixteen of them; parts of loads below it are dropped."""


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
    moved : float
        2 |v|_K of the move v that puts in place what holds still (theorem 2); the other parts are those after it.
    given_friction : bool
        Whether weights follow the answer: the bound is for those of its own pressure and slip.
    """

    equilibrium: float
    friction: Floats
    floor: float
    limits: Floats = field(default_factory=lambda: np.zeros(0))
    given_friction: bool = False
    moved: float = 0.0

    def away(self, error: float) -> Certificate:
        """Return the certificate of an answer whose error |d - d*|_K is known in another way than by the gap."""
        friction, limits = np.zeros_like(self.friction), np.zeros_like(self.limits)
        return replace(self, equilibrium=0.5 * error * error, friction=friction, limits=limits, moved=0.0)

    def in_full(self, equilibrium: float, floor: float) -> Certificate:
        """Return the certificate with these parts of all unknowns, of which a condensed program sees some."""
        return replace(self, equilibrium=max(equilibrium, self.equilibrium), floor=max(floor, self.floor))

    @cached_property
    def gap(self) -> float:
        """Primal minus dual objective, 1/2 |d - d*|_K^2 <= gap; infinite where it is no number."""
        gap = self.equilibrium + self.terms
        if not gap >= 0:
            return np.inf
        return 0.5 * (self.moved + float(np.sqrt(2.0 * gap))) ** 2 if self.moved else gap

    @property
    def terms(self) -> float:
        """The part of norm terms and limits in the gap."""
        return float(self.friction.sum() + self.limits.sum())

    @cached_property
    def error(self) -> float:
        """sqrt(2 gap): |d - d*|_K <= error + error_floor."""
        return float(np.sqrt(2.0 * self.gap))

    @property
    def error_floor(self) -> float:
        """The part of the error that the floor accounts for, sqrt(2 floor)."""
        return float(np.sqrt(2.0 * self.floor))

    @property
    def at_floor(self) -> bool:
        """True if round-off accounts for all of the error, so that no less can be asked for."""
        return self.gap <= self.floor


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


def limit_gaps(compliance: Floats, p: Floats, z: Floats) -> Floats:
    """(z_j)_+^2 / 2c_j + c_j p_j^2 / 2 - p_j z_j >= 0 for p >= 0, (r,); infinite beyond a bound.

    Without cancellation it is (z - c p)^2 / 2c where z > 0, and c p^2 / 2 + p |z| elsewhere.
    """
    if len(p) == 0:
        return p
    soft, above = compliance > 0, z > 0
    gap = 0.5 * compliance * p * p + p * np.abs(np.minimum(z, 0.0))
    both = soft & above
    gap[both] = (z[both] - compliance[both] * p[both]) ** 2 / (2 * compliance[both])
    gap[above & ~soft] = np.inf
    return gap
