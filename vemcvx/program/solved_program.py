"""A step's program with its certified answer: what is handed to other solvers, and what theirs is held against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import EPS
from vemcvx.program.answer import Answer
from vemcvx.program.certificate import Certificate
from vemcvx.program.step_program import StepProgram


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SolvedProgram(StepProgram):
    """The program of one step of a run as it was solved, and the answer.

    In the units of the scene; where weights depend on pressures (Coulomb) they are those of the solved step. Signs and
    methods are those of :class:`vemcvx.program.step_program.StepProgram`.

    Parameters
    ----------
    answer : Answer
        Increments d, and multipliers lam and p.
    step : int
        1 is the first after the initial instant.
    t : float
        The instant at which the step ends.
    slope : (m, r) sparse matrix, optional
        Where weights follow the forces of the limits: their derivative at the answer; coefficients of friction.
    origin : mapping
        What it is the program of, in words and numbers: "scene", "mesh", "solver".
    """

    answer: Answer
    step: int
    t: float
    slope: sp.csr_matrix | None = None
    origin: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, program: StepProgram, answer: Answer, step: int, t: float) -> SolvedProgram:
        """A program with its answer."""
        return cls(program.operators, *program.data, answer=answer, step=step, t=t)

    @cached_property
    def certificate(self) -> Certificate:
        """The certificate of the answer as the answer to this very program."""
        return self.certify(self.answer.d, self.answer.lam, self.answer.p)

    @cached_property
    def norm(self) -> float:
        """|d|_K, the energy norm of the increments: what errors may be held against."""
        return self.operators.energy_norm(self.answer.d)

    @cached_property
    def bounds(self) -> tuple[float, float]:
        """Below and above the least value of the objective: that of the answer less the gap, and that of the answer.

        Rounding included: the certificate's floor, and that of sums of n terms, at most n eps of their sizes.
        """
        value, d = self.objective(self.answer.d), np.abs(self.answer.d)
        terms = 0.5 * d @ (self.operators.absolute @ d) + np.abs(self.g) @ d
        blur = self.certificate.floor + (len(d) + 2) * EPS * float(terms + np.abs(value))
        return value - self.certificate.gap - blur, value + blur
