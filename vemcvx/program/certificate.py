"""The certificate: how far an answer is from the solution, whoever made it.

For the program of a step (``StepProgram``), any d within its bounds, any lam with |lam_i| <= w_i and p >= 0, let s =
B d - b, z = D d - e and r = g - B'lam - D'p - K d. Then

    gap = 1/2 r'K^{-1}r + sum_i (w_i |s_i| - lam_i . s_i) + sum_j ( (z_j)_+^2 / (2 c_j) + c_j p_j^2 / 2 - p_j z_j )

is primal minus dual objective, and

    Theorem.  1/2 |d - d*|_K^2 <= gap.

Proof. Write the terms as h(Ad) with their conjugate h*; of w|s|: 0 where |lam| <= w; of (z_+)^2 / 2c: c p^2 / 2 where
p >= 0 (c = 0: the bound z <= 0, and 0). With v = K^{-1}(g - B'lam - D'p) the dual value is
G = -1/2 v'Kv - lam.b - p.e - sum c p^2 / 2, the primal value P(d) = 1/2 d'Kd - g'd + sum w|s| + sum z_+^2 / 2c, and
P(d) - G is the gap, because g'd = v'Kd + lam.Bd + p.Dd. P is K-strongly convex with minimiser d*, so
P(d) >= P(d*) + 1/2 |d - d*|_K^2, and weak duality P(d*) >= G ends it.  QED

Where K has a kernel N (:mod:`vemcvx.program.kernel`) all this holds in the seminorm |.|_K, with K^{-1} any inverse of
K on balanced forces; where N'r does not vanish, the gap is infinite.

Signs: friction acts on the body with the forces -B'lam, limits with -D'p. Where friction is one-way its bias c is part
of the load, g contains -B'c, and lam is what is left of the multipliers: a history's are lam + c, |lam_i - c_i| <= w_i.

Every summand is >= 0 and belongs to one place of the boundary. The norm part is evaluated without
cancellation, w|s| - lam.s = (w - |lam|)|s| + |lam||s| |lam/|lam| - s/|s||^2 / 2, that of limits as
(z - c p)^2 / 2c where z >= 0, c p^2 / 2 + p |z| elsewhere. A multiplier within BOUND_ROUNDING w of its bound stands for
the one on it, w lam / |lam|, which is admissible, too, and as few floats are: the gap is that one's. What the step
between them does to r is of the size of what rounding does to B'lam anyway, which the floor counts, of second order.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from vemcvx.arrays import EPS, Floats, directions, lengths
from vemcvx.outline import ArrayRecord

BOUND_ROUNDING = 4 * EPS
"""What the length of w lam / |lam| may lack of w: a root, a quotient, a product, and a root again."""


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
        2 |v|_K of the move v that puts in place what sticks (:mod:`vemcvx.program.in_place`); the other parts are those
        after it.
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
        """1/2 |d - d*|_K^2 <= gap (up to `floor`); infinite where it is no number, which certifies nothing."""
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
    """w_i |s_i| - lam_i . s_i >= 0 for |lam_i| <= w_i, without cancellation; (m,)."""
    size, slip = lengths(lam), lengths(s)
    # Where one of them vanishes it takes the direction out of the sum, whatever that is.
    apart = directions(lam, size) - directions(s, slip)
    turned = np.einsum("ij,ij->i", apart, apart)
    short = np.where(size >= (1.0 - BOUND_ROUNDING) * w, 0.0, w - size)
    gaps: Floats = short * slip + 0.5 * size * slip * turned
    return gaps


def limit_gaps(compliance: Floats, p: Floats, z: Floats, blur: Floats) -> Floats:
    """(z_j)_+^2 / 2c_j + c_j p_j^2 / 2 - p_j z_j >= 0 for p >= 0, without cancellation; infinite beyond a bound."""
    if len(p) == 0:
        return p
    soft = compliance > 0
    gap = 0.5 * compliance * p * p + p * np.abs(np.minimum(z, 0.0))
    above = z > 0
    both = soft & above
    gap[both] = (z[both] - compliance[both] * p[both]) ** 2 / (2 * compliance[both])
    gap[above & ~soft & (z > blur)] = np.inf
    return gap
