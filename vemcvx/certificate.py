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

Where K has a kernel N (:mod:`vemcvx.kernel`) all this holds in the seminorm |.|_K, with K^{-1} any inverse of K on
balanced forces; where N'r does not vanish, the gap is infinite.

Every summand is >= 0 and belongs to one place of the boundary. The norm part is evaluated without
cancellation, w|s| - lam.s = (w - |lam|)|s| + |lam||s| |lam/|lam| - s/|s||^2 / 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
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

    The floor (:func:`rounding_floor`) follows the rounding of the two parts: r is known to
    eps (|g| + |B'||lam| + |K||d|), measured in the norm of K^{-1}; s_i to eps (|B_i||d| + |b_i|), except where a row
    of B has one entry and b_i = 0: there a sticking s_i = 0 is exact. In blocks of two and more |lam_i| = w_i holds to
    2 eps w_i only.
    """
    lam = program.project(lam)
    equilibrium, friction = _parts(program, d, lam)
    return Certificate(equilibrium, friction, rounding_floor(program, d, lam))


def duality_gap(program: StepProgram, d: Floats, lam: Floats) -> float:
    """The gap alone, for an admissible lam: what solvers measure their progress by."""
    equilibrium, friction = _parts(program, d, lam)
    return equilibrium + float(friction.sum())


def _parts(program: StepProgram, d: Floats, lam: Floats) -> tuple[float, Floats]:
    r = program.residual(d, lam)
    equilibrium = 0.5 * float(r @ program.form.factor.solve(r))
    if program.form.kernel is not None:
        left, blur = _imbalance(program, lam)
        equilibrium = np.inf if (np.abs(left) > blur).any() else equilibrium
    return max(equilibrium, 0.0), norm_gaps(program.w, lam, program.slip(d))


def _imbalance(program: StepProgram, lam: Floats) -> tuple[Floats, Floats]:
    """N'(g - B'lam), (k,), which is N'r because N'K = 0; and what rounding may leave of it."""
    kernel, grip = program.form.kernel, program.form.grip
    left = kernel.T @ program.g - np.einsum("ijk,ij->k", grip, lam)  # type: ignore[union-attr]
    size = np.abs(kernel).T @ np.abs(program.g) + np.einsum("ijk,ij->k", np.abs(grip), np.abs(lam))
    return left, 8 * EPS * size


def _blur(program: StepProgram, d: Floats, lam: Floats) -> Floats:
    """(n,) the rounding of r."""
    form = program.form
    pulled = form.rows.absolute.pull(np.abs(lam.ravel()))
    return EPS * (np.abs(program.g) + pulled + form.absolute @ np.abs(d))


def rounding_floor(program: StepProgram, d: Floats, lam: Floats) -> float:
    """What round-off alone may hide in, or add to, the gap at (d, lam)."""
    form, s = program.form, program.slip(d)
    rows, size = form.rows.absolute, np.abs(d)
    blur = _blur(program, d, lam)
    slip = np.where(rows.single, 0.0, rows.read(size)) + np.abs(program.b)
    slip_blur = EPS * form.blocks(slip).sum(axis=1)
    if form.block > 1:
        slip_blur += 2 * EPS * np.linalg.norm(s, axis=1)
    floor = 0.5 * float(blur @ np.abs(form.factor.solve(blur))) + float(program.w @ slip_blur)
    if form.kernel is not None:
        # A load off balance by so much moves the answer along N, and does work on that motion.
        floor += float(_imbalance(program, lam)[1] @ np.abs(form.kernel.T @ d))
    return floor


def norm_gaps(w: Floats, lam: Floats, s: Floats) -> Floats:
    """w_i |s_i| - lam_i . s_i >= 0 for |lam_i| <= w_i, without cancellation; (m,)."""
    size, slip = np.linalg.norm(lam, axis=1), np.linalg.norm(s, axis=1)
    both = (size > 0) & (slip > 0)
    direction = np.zeros_like(lam)
    direction[both] = lam[both] / size[both, None] - s[both] / slip[both, None]
    turned = np.einsum("ij,ij->i", direction, direction)
    return np.maximum(w - size, 0.0) * slip + 0.5 * size * slip * turned
