"""The certificate: how far an answer is from the solution, whoever made it.

For the program of :mod:`vemcvx.program`, any d, and any lam with |lam_i| <= w_i, let s = B d - b and
r = g - B'lam - K d. Then

    gap = 1/2 r'K^{-1}r + sum_i (w_i |s_i| - lam_i . s_i)

is primal minus dual objective, and

    Theorem.  1/2 |d - d*|_K^2 <= gap.

Proof. With v = K^{-1}(g - B'lam) the dual value is D(lam) = -1/2 v'Kv - lam.b, and the primal value is
P(d) = 1/2 d'Kd - g'd + sum w|s|. P(d) - D(lam) = 1/2 |v - d|_K^2 + sum (w|s| - lam.s), because
-g'd = -v'Kd - lam.Bd; this is the gap. P is K-strongly convex with minimiser d*, so
P(d) >= P(d*) + 1/2 |d - d*|_K^2, and weak duality P(d*) >= D(lam) ends it.  QED

Every summand is >= 0 and belongs to one place of the boundary. The norm part is evaluated without
cancellation, w|s| - lam.s = (w - |lam|)|s| + |lam||s| |lam/|lam| - s/|s||^2 / 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.program import StepProgram

Floats = NDArray[np.float64]
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Certificate:
    """A bound on the error of one answer.

    Parameters
    ----------
    equilibrium : float
        1/2 r'K^{-1}r.
    friction : (m,) array
        w_i |s_i| - lam_i . s_i, term by term: where on the boundary the answer is not converged.
    floor : float
        What round-off alone may hide in, or add to, the gap: see :func:`certify`.
    """

    equilibrium: float
    friction: Floats
    floor: float

    def times(self, unit: float) -> Certificate:
        """The same certificate in other units of energy."""
        return Certificate(unit * self.equilibrium, unit * self.friction, unit * self.floor)

    @property
    def gap(self) -> float:
        """1/2 |d - d*|_K^2 <= gap (up to `floor`)."""
        return self.equilibrium + float(self.friction.sum())

    @property
    def error(self) -> float:
        """|d - d*|_K <= error = sqrt(2 gap)."""
        return float(np.sqrt(2.0 * self.gap))

    @property
    def error_floor(self) -> float:
        """The part of the error that the floor accounts for, sqrt(2 floor)."""
        return float(np.sqrt(2.0 * self.floor))


def certify(program: StepProgram, d: Floats, lam: Floats) -> Certificate:
    """Certify the increments `d` (n,) with the multipliers `lam` (m, block), projected first.

    The floor follows the rounding of the two parts: r is known to eps (|g| + |B'||lam| + |K||d|), measured in
    the norm of K^{-1}; s_i to eps (|B_i||d| + |b_i|), except where a row of B has one entry and b_i = 0:
    there a sticking s_i = 0 is exact. In blocks of two and more |lam_i| = w_i holds to 2 eps w_i only.
    """
    lam = program.project(lam)
    s = program.slip(d)
    r = program.residual(d, lam)
    factor = program.form.factor
    equilibrium = 0.5 * float(r @ factor.solve(r))
    blur = _residual_blur(program, d, lam)
    floor = 0.5 * float(blur @ np.abs(factor.solve(blur))) + float(program.w @ _slip_blur(program, d, s))
    return Certificate(max(equilibrium, 0.0), norm_gaps(program.w, lam, s), floor)


def norm_gaps(w: Floats, lam: Floats, s: Floats) -> Floats:
    """w_i |s_i| - lam_i . s_i >= 0 for |lam_i| <= w_i, without cancellation; (m,)."""
    size, slip = np.linalg.norm(lam, axis=1), np.linalg.norm(s, axis=1)
    both = (size > 0) & (slip > 0)
    direction = np.zeros_like(lam)
    direction[both] = lam[both] / size[both, None] - s[both] / slip[both, None]
    turned = np.einsum("ij,ij->i", direction, direction)
    return np.maximum(w - size, 0.0) * slip + 0.5 * size * slip * turned


def _residual_blur(program: StepProgram, d: Floats, lam: Floats) -> Floats:
    form = program.form
    return EPS * (np.abs(program.g) + abs(form.B).T @ np.abs(lam.ravel()) + _absolute(form.K) @ np.abs(d))


def _slip_blur(program: StepProgram, d: Floats, s: Floats) -> Floats:
    form = program.form
    rounding = abs(form.B) @ np.abs(d) * (np.diff(form.B.indptr) > 1) + np.abs(program.b)
    length = 2 * np.linalg.norm(s, axis=1) if form.block > 1 else 0.0
    return EPS * (form.blocks(rounding).sum(axis=1) + length)


def _absolute(K: Floats | sp.csr_matrix) -> Floats | sp.csr_matrix:
    return abs(K) if sp.issparse(K) else np.abs(K)
