"""One program in every system of units: scaled by powers of two, so that scaling itself rounds nothing.

With d = alpha delta d^, delta a diagonal matrix, and s_i = alpha sigma_i s^_i the program of
:mod:`vemcvx.program.step_program`, divided by kappa alpha^2, has

    K^ = delta K delta / kappa,  g^ = delta g / (kappa alpha),  B^ = B delta / sigma,  b^ = b / (alpha sigma),
    w^ = w sigma / (kappa alpha),  and lam = kappa alpha lam^ / sigma;

limits likewise with tau in place of sigma: D^ = D delta / tau, e^ = e / (alpha tau), c^ = c kappa / tau^2,
p = kappa alpha p^ / tau.

kappa is the size of diag(K), delta that of diag(K / kappa)^{-1/2}, sigma and tau those of the rows of B delta and
D delta, all fixed for a run; alpha is the energy norm of the frictionless answer, (g'K^{-1}g / kappa)^{1/2}, step by
step.

Weights far above every multiplier are lowered (friction that never slips; loads near zero). Where each row of B reads
one unknown of its own, K^_ii < 2 and coefficients are >= 1/2; with v = K^{-1}g, |v|_K <= 1, and d_b the field that
moves with b alone,

    |d* - v|_K <= |d_b - v|_K  gives  |lam_i*| <= 2 (|g_i| + |K d*|_i) < 9 + 8 |b|_1  for every component,

whatever w is (without limits). So w_i may be lowered to 16 (1 + |b|_1) a component without changing the solution, or
what a certificate says of it; the gap, linear in w, then no longer magnifies a slip of rounding size.

Without this, interior-point solvers stop at 40-70 % energy error in small units and say "solved".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, power_of_two
from vemcvx.errors import SceneError
from vemcvx.linear import Congruent, Matrix, Scaled
from vemcvx.program.operators import OnceForEach, Operators, PressureLaw
from vemcvx.program.step_program import Answer, StepProgram

SMALLEST_NORM, LARGEST_NORM = 1e-125, 1e125
"""Energy norms outside have squares that are no numbers any more, or gaps beneath them that are not. Scaled weights and
gaps of limits beyond the largest are as good as infinite."""


def checked_norm(norm: float, t: float) -> float:
    """The energy norm of what drives a step; SceneError if its square leaves no room for errors beside it."""
    if SMALLEST_NORM <= norm <= LARGEST_NORM:
        return norm
    raise SceneError(
        f"data: what drives the step to t = {t:.6g} has an energy norm of {norm:.1e}; between {SMALLEST_NORM:.0e} "
        f"and {LARGEST_NORM:.0e} energies, and errors beside them, are numbers. Take other units of force or length, "
        "or zero for loads and motions that are meant to be none."
    )


@dataclass(frozen=True)
class Scaling:
    """The scales of a run, and the scaled operators of its programs."""

    operators: Operators
    kappa: float
    delta: Floats
    sigma: Floats
    tau: Floats

    def scale(self, program: StepProgram, alpha: float, unheld: float = 0.0) -> StepProgram:
        """The scaled program of a step; `unheld` is the energy norm of its frictionless answer where alpha is less."""
        force, e = self.kappa * alpha, program.e
        with np.errstate(over="ignore"):
            w = np.minimum(program.w * self.sigma / force, LARGEST_NORM)
            if len(e):
                e = np.minimum(np.maximum(e / (alpha * self.tau), -LARGEST_NORM), LARGEST_NORM)
        b = (self.operators.blocks(program.b) / (alpha * self.sigma[:, None])).ravel()
        if self.operators.rows.columns is not None and self.operators.kernel is None and len(e) == 0:
            w = np.minimum(w, 16.0 * np.sqrt(self.operators.block) * (max(1.0, unheld / alpha) + np.abs(b).sum()))
        return StepProgram(self.operators, self.delta * program.g / force, w, b, e)

    def restore(self, answer: Answer, alpha: float) -> Answer:
        """An answer of the scaled program in the units of the unscaled one."""
        lam = self.kappa * alpha * answer.lam / self.sigma[:, None]
        p = self.kappa * alpha * answer.p / self.tau
        return Answer(
            alpha * self.delta * answer.d, lam, answer.iterations, answer.status, safeguards=answer.safeguards, p=p
        )

    def shrink(self, d: Floats, alpha: float) -> Floats:
        """Increments (n,) in scaled units."""
        return d / (alpha * self.delta)

    def guess(self, lam: Floats, p: Floats, alpha: float) -> tuple[Floats, Floats]:
        """Multipliers (m, block) and (r,) in scaled units."""
        force = self.kappa * alpha
        return lam * self.sigma[:, None] / force, p * self.tau / force

    def law(self, law: PressureLaw, alpha: float) -> PressureLaw:
        """A law of weights in scaled units. Its slope is the same for every alpha: weights and forces have one unit."""
        force = self.kappa * alpha
        up, down = self.sigma / force, force / self.tau
        return PressureLaw(lambda p: up * law.weights(down * p), lambda p: self._slope(law.slope(down * p)))

    @cached_property
    def _slope(self) -> OnceForEach:
        """A slope in scaled units."""
        return OnceForEach(lambda J: J.scaled(self.sigma, 1.0 / self.tau))

    @property
    def factor(self) -> Scaled:
        """The factor of the scaled operators in the units of the unscaled ones."""
        return Scaled(self.operators.factor, 1.0 / self.delta, 1.0 / self.kappa)

    def energy(self, value: float, alpha: float) -> float:
        """An energy in scaled units."""
        return value / (self.kappa * alpha * alpha)

    def size(self, program: StepProgram) -> float:
        """alpha of a step; 0 where nothing moves it."""
        scaled = self.delta * program.g / self.kappa
        top = np.abs(scaled).max(initial=0.0)
        size = 0.0
        if len(program.e):
            # A limit that moves in by x does at most 1/2 K_ii x^2 on the unknown that it meets; rows are of size tau.
            inward = (np.maximum(-program.e, 0.0) / self.tau).max()
            size = float(power_of_two(inward)) if inward > 0 else 0.0
        if top > 0:
            unit = scaled / power_of_two(top)
            answer = power_of_two(np.sqrt(self.operators.factor.energy(unit)))
            size = max(size, float(power_of_two(top) * answer))
        else:
            pushed = float(program.w @ np.linalg.norm(self.operators.blocks(program.b), axis=1)) / self.kappa
            size = max(size, float(power_of_two(np.sqrt(pushed))) if pushed > 0 else 0.0)
        return size


def scaling(operators: Operators) -> Scaling:
    """Choose the scales of a run from K, B and the limits."""
    diagonal = _diagonal(operators)
    kappa, delta = unit_diagonal(diagonal)
    sigma = power_of_two(operators.blocks(_size(operators.B, delta)).max(axis=1)) if operators.count else np.zeros(0)
    tau = power_of_two(_size(operators.D, delta))
    B = _between(1.0 / np.repeat(sigma, operators.block), operators.B, delta)
    D = _between(1.0 / tau, operators.D, delta)
    kernel, anchor = operators.kernel, operators.anchor
    if kernel is not None and anchor is not None:
        kernel, anchor = np.linalg.qr(kernel / delta[:, None])[0], delta * anchor * delta / kappa
    dense = isinstance(operators.K, np.ndarray)
    scaled = Operators(
        K=_scaled(operators, delta, kappa),
        B=B,
        block=operators.block,
        # A dense matrix is factorised in these units, in which its roots are those of the same numbers.
        given_factor=None if dense else Scaled(operators.factor, delta, kappa),
        kernel=kernel,
        anchor=anchor,
        D=D,
        compliance=operators.compliance * kappa / tau**2,
    )
    return Scaling(scaled, kappa, delta, sigma, tau)


def unit_diagonal(diagonal: Floats) -> tuple[float, Floats]:
    """kappa and delta (n,), powers of two, with which delta K delta / kappa has a diagonal between 1/2 and 2."""
    kappa = float(power_of_two(diagonal.max(initial=0.0)))
    return kappa, np.ldexp(1.0, -(np.frexp(diagonal / kappa)[1] // 2))


def _scaled(operators: Operators, delta: Floats, kappa: float) -> Matrix:
    """delta K delta / kappa; in products, without a second K, where these are all that is asked for."""
    K = operators.K
    if isinstance(K, np.ndarray):
        scaled = delta[:, None] * K
        scaled *= delta / kappa
        return scaled
    if not operators.factor.exact:
        return (K if isinstance(K, Congruent) else Congruent.of(K)).scaled(delta, 1.0 / kappa)
    return _between(delta, K, delta / kappa)


def _between(left: Floats, rows: sp.csr_matrix, right: Floats) -> sp.csr_matrix:
    """The product of a matrix with two diagonal ones."""
    product = rows.copy()
    product.data *= np.repeat(left, np.diff(rows.indptr)) * right[rows.indices]
    return product


def _diagonal(operators: Operators) -> Floats:
    """The diagonal of K; with the anchors' stiffness at unknowns that these alone hold, where K has rounding only."""
    own, anchored = operators.K.diagonal(), operators.regular.K.diagonal()
    return np.where(own > 2.0**-40 * anchored, own, anchored)


def _size(rows: sp.csr_matrix, delta: Floats) -> Floats:
    """(k,) the largest entry of each row of rows delta."""
    if 0 in rows.shape:  # Rows that read nothing leave no unknowns.
        return np.zeros(rows.shape[0])
    return abs(_between(np.ones(rows.shape[0]), rows, delta)).max(axis=1).toarray().ravel()
