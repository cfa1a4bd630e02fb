"""No convex term left: the step is one linear system, K d = g."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.program.answer import Answer
from vemcvx.program.operators import QUADRATIC, Operators
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.solver import Solver


@dataclass(frozen=True)
class Direct(Solver):
    """One back-substitution a step; takes programs without terms only."""

    accuracy: float = 1e-8

    accepts: ClassVar[frozenset[str]] = frozenset({QUADRATIC})

    def prepare(self, operators: Operators) -> Direct:
        return self

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        """Answer one scaled step."""
        d = program.operators.factor.solve(program.g)
        return Answer(d, np.zeros_like(lam), 1, "solved", p=np.zeros_like(program.e))
