"""Solvers that need no iteration, and which solver: the one asked for, else by the program."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.errors import NotAccepted
from vemcvx.program.operators import QUADRATIC, SECOND_ORDER_CONES, Operators
from vemcvx.program.step_program import Answer, StepProgram
from vemcvx.solvers.adapter import Solves, as_solver
from vemcvx.solvers.conic import OSQP, Clarabel
from vemcvx.solvers.newton import Newton
from vemcvx.solvers.solver import Solver

# No convex term left: the step is one linear system, K d = g.


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


# Which solver answers: the one asked for, if it accepts the program, else the smallest that does.


BY_SIZE: tuple[Solver, ...] = (Direct(), Newton(), OSQP(), Clarabel())
"""The solvers that come with the package, the smallest first."""

log = logging.getLogger("vemcvx")


def choose_solver(operators: Operators, given: Solver | Solves | None) -> Solver:
    """The solver for programs of `operators`.

    Raises
    ------
    NotAccepted
        The solver asked for cannot take a feature of the program.
    """
    if given is None:
        solver = next(s for s in BY_SIZE if operators.features <= s.accepts)
        log.info("solver: %s, the smallest that accepts %s", solver.name, words(operators.features))
        return solver
    asked = as_solver(given)
    missing = operators.features - asked.accepts
    if missing:
        able = ", ".join(s.name for s in BY_SIZE if operators.features <= s.accepts)
        raise NotAccepted(
            f"solver {asked.name}: the program has {words(missing)}, which it does not accept; "
            f"it accepts {words(asked.accepts)}. These accept the program: {able}."
            + (f" {asked.instead}" if asked.instead and SECOND_ORDER_CONES in missing else "")
        )
    return asked


def words(features: frozenset[str]) -> str:
    """Features in words."""
    return ", ".join(sorted(features))
