"""Scaling of programs, independent of units, by two numbers: a stiffness kappa per run and a length alpha per step.

With d = alpha d^ the program of :mod:`vemcvx.program.step_program`, divided by kappa alpha^2, has

    K^ = K / kappa,  g^ = g / (kappa alpha),  w^ = w / (kappa alpha),  b^ = b / alpha,  e^ = e / alpha,  c^ = c kappa,

and lam = kappa alpha lam^, p = kappa alpha p^. kappa is the size of diag(K). alpha is the size of the data in the
energy norm, divided by the root of kappa. Both are powers of two, so that scaling is exact. In units in which data are
tiny, interior-point solvers without scaling report "solved" at 40-70 % energy error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vemcvx.base.arrays import Floats, power_of_two
from vemcvx.base.errors import SceneError
from vemcvx.linear import Factor
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import Answer, StepProgram

SMALLEST_NORM, LARGEST_NORM = 1e-125, 1e125
"""Range of energy norms: outside it their squares, or the much smaller gaps, overflow or underflow."""

OPEN_GAP = 1e4
"""Largest gap of a scaled program, relative to the motion of a row in a state with energy norm one."""


def check_norm(norm: float, t: float) -> float:
    """Return the energy norm of a step's data; raise SceneError if its square is close to overflow or underflow."""
    if SMALLEST_NORM <= norm <= LARGEST_NORM:
        return norm
    raise SceneError(
        f"data: loads and motions in the step to t = {t:.6g} have an energy norm of {norm:.1e}; it must be between "
        f"{SMALLEST_NORM:.0e} and {LARGEST_NORM:.0e}, or energies and errors overflow or underflow. Take other "
        "units of force or length, and zero for negligible loads and motions."
    )


class ScaledFactor(Factor):
    """A factor of K / kappa, made from a factor of K."""

    def __init__(self, factor: Factor, kappa: float):
        self._factor, self._kappa, self.exact = factor, kappa, factor.exact

    def solve(self, b: Floats) -> Floats:
        """Return x with K x = kappa b."""
        return self._kappa * self._factor.solve(b)


@dataclass(frozen=True, eq=False)
class Scaling:
    """The stiffness of a run, and the operators of its scaled programs."""

    operators: Operators
    kappa: float

    @classmethod
    def from_operators(cls, operators: Operators) -> Scaling:
        """Return the scaling by the size of K's diagonal."""
        kappa = float(power_of_two(operators.K.diagonal().max(initial=0.0)))
        dense = isinstance(operators.K, np.ndarray) and operators.anchor is None
        scaled = replace(
            operators,
            K=operators.K / kappa,
            anchor=None if operators.anchor is None else operators.anchor / kappa,
            compliance=operators.compliance * kappa,
            given_factor=None if dense else ScaledFactor(operators.factor, kappa),
        )
        return cls(scaled, kappa)

    def length(self, program: StepProgram) -> float:
        """Return the length alpha of a step; one if its data vanish."""
        size = program.size / np.sqrt(self.kappa)
        if self.operators.kernel is not None:  # A floating body moves as far as the ground that carries it.
            size = max(size, np.abs(program.b).max(initial=0.0))
        return float(power_of_two(size)) if size > 0 else 1.0

    def scale(self, program: StepProgram, alpha: float) -> StepProgram:
        """Return the scaled program of a step.

        If supports hold the body, gaps that it cannot close are reduced: interior-point methods fail on gaps of 1e20.
        """
        force, e = self.kappa * alpha, program.e / alpha
        if len(e) and self.operators.anchor is None:
            e = np.minimum(e, OPEN_GAP * np.maximum(np.sqrt(self.operators.limit_flexibility), 1.0))
        return StepProgram(self.operators, program.g / force, program.w / force, program.b / alpha, e)

    def restore(self, answer: Answer, alpha: float) -> Answer:
        """Return an answer of the scaled program in the units of the original program."""
        force = self.kappa * alpha
        return replace(answer, d=alpha * answer.d, lam=force * answer.lam, p=force * answer.p)

    def energy(self, value: float, alpha: float) -> float:
        """Return an energy in scaled units."""
        return value / (self.kappa * alpha * alpha)
