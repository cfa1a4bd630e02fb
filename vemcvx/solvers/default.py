"""Which solver answers: the one asked for, if it accepts the program, else the smallest that does."""

from __future__ import annotations

import logging

from vemcvx.errors import NotAccepted
from vemcvx.program.operators import SECOND_ORDER_CONES, Operators
from vemcvx.solvers.adapter import Solves, as_solver
from vemcvx.solvers.conic import OSQP, Clarabel
from vemcvx.solvers.direct import Direct
from vemcvx.solvers.newton import Newton
from vemcvx.solvers.solver import Solver

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
