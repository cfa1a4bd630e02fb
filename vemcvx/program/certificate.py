r"""The certificate: a bound on the distance of any answer from the solution (proofs: docs/theory/certificate.md).

Let $d^*$ be the solution of a step's program with the data $K, g, w, B, b, D, e, c$ (``StepProgram``). Take any $d$
that obeys the bounds $D_j d \le e_j$ for $c_j = 0$, and any $|\lambda_i| \le w_i$ and $p \ge 0$. With $s = B d - b$,
$z = D d - e$ and $r = g - B' \lambda - D' p - K d$ let

$$ \text{gap} = \tfrac12 r' K^{-1} r + \sum_i (w_i |s_i| - \lambda_i \cdot s_i)
+ \sum_j \Big( \frac{(z_j)_+^2}{2 c_j} + \frac{c_j p_j^2}{2} - p_j z_j \Big) . $$

Theorem 1: $\tfrac12 |d - d^*|_K^2 \le \text{gap}$ in the norm $|v|_K^2 = v' K v$. If $K$ has a kernel $N$, $|v|_K$ is a
seminorm, and the gap is infinite unless $N' r = 0$ (:mod:`vemcvx.program.kernel`).

Theorem 2: for any vector $v$, let $T(v)$ be the sums over $i$ and $j$ in the gap, with $s$ and $z$ at $d - v$. If
$d - v$ obeys the bounds, $|d - d^*|_K \le 2 |v|_K + \sqrt{r' K^{-1} r + 2 T(v)}$. We choose $v$ such that tiny slips
and tiny $z$ vanish at $d - v$ (``StepProgram.zero_levels``), and take the smaller bound.

Let $a_i$ be the sum of the absolute values of all terms of $r_i$. Rounding can change $r_i$ by up to ROUNDED $a_i$. The
corresponding energy is $\text{floor} = \frac12 \sum_i (\text{ROUNDED} \, a_i)^2 f_i$, where $f_i = (K^{-1})_{ii}$.
Then $|d - d^*|_K \le \sqrt{2 \, \text{gap}} + \sqrt{2 \, \text{floor}}$, which is `error + error_floor`.

Friction acts on the body with the forces $-B' \lambda$. The limits act on the body with the forces $-D' p$.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vemcvx.base.arrays import EPS, Floats, directions, lengths
from vemcvx.base.outline import ArrayRecord

BOUND_ROUNDING = 4 * EPS
"""Largest w - |lam| that counts as zero, relative to w."""

ROUNDED = 8 * EPS
"""Rounding error of a sum of sixteen numbers, relative to the sum of absolute values."""


@dataclass(frozen=True, repr=False, eq=False)
class Certificate(ArrayRecord):
    """A bound on the error of one answer.

    Parameters
    ----------
    equilibrium : float
        1/2 r'K^{-1}r.
    friction : (m,) array
        w_i |s_i| - lam_i . s_i of each norm term.
    floor : float
        Energy by which rounding may change the gap.
    limits : (r,) array
        The term of each limit in the gap.
    moved : float
        2 |v|_K for theorem 2. `friction` and `limits` are then values at d - v.
    given_friction : bool
        True if weights depend on pressures or fall with slip. The bound then holds for the weights at the answer.

    Examples
    --------
    >>> program = vx.StepProgram(vx.Operators(K=np.eye(1), B=np.eye(1)), g=[3.0], w=[1.0], b=[0.0])
    >>> program.certify(d=[2.1], lam=[1.0]).error
    0.10000000000000009
    """

    equilibrium: float
    friction: Floats
    floor: float
    limits: Floats = field(default_factory=lambda: np.zeros(0))
    given_friction: bool = False
    moved: float = 0.0

    def away(self, error: float) -> Certificate:
        """Return a certificate with gap = error^2 / 2."""
        friction, limits = np.zeros_like(self.friction), np.zeros_like(self.limits)
        return replace(self, equilibrium=0.5 * error * error, friction=friction, limits=limits, moved=0.0)

    @cached_property
    def gap(self) -> float:
        """The bound of theorem 1 or 2 on 1/2 |d - d*|_K^2."""
        gap = self.equilibrium + self.terms
        if not gap >= 0:
            return np.inf
        return 0.5 * (self.moved + float(np.sqrt(2.0 * gap))) ** 2 if self.moved else gap

    @property
    def terms(self) -> float:
        """The sum of `friction` and `limits`."""
        return float(self.friction.sum() + self.limits.sum())

    @cached_property
    def error(self) -> float:
        """The bound sqrt(2 gap): |d - d*|_K <= error + error_floor."""
        return float(np.sqrt(2.0 * self.gap))

    @property
    def error_floor(self) -> float:
        """The rounding error sqrt(2 floor) in the energy norm."""
        return float(np.sqrt(2.0 * self.floor))

    @property
    def at_floor(self) -> bool:
        """True if rounding may cause the whole error."""
        return self.gap <= self.floor


def norm_gaps(w: Floats, lam: Floats, s: Floats) -> Floats:
    """Return w_i |s_i| - lam_i . s_i for |lam_i| <= w_i, computed without cancellation."""
    size, slip = lengths(lam), lengths(s)
    apart = directions(lam, size) - directions(s, slip)
    short = np.where((size >= (1.0 - BOUND_ROUNDING) * w) | (slip == 0.0), 0.0, w - size)
    gaps: Floats = short * slip + 0.5 * size * slip * np.einsum("ij,ij->i", apart, apart)
    return gaps


def limit_gaps(compliance: Floats, p: Floats, z: Floats) -> Floats:
    """Return (z_j)_+^2 / 2c_j + c_j p_j^2 / 2 - p_j z_j for p >= 0, computed without cancellation."""
    if len(p) == 0:
        return p
    soft, above = compliance > 0, z > 0
    gap = 0.5 * compliance * p * p + p * np.abs(np.minimum(z, 0.0))
    both = soft & above
    gap[both] = (z[both] - compliance[both] * p[both]) ** 2 / (2 * compliance[both])
    gap[above & ~soft] = np.inf
    return gap
