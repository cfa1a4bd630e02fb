"""Solvers by the names that the command line gives them."""

from __future__ import annotations

from vemcvx.errors import ProblemError
from vemcvx.solvers import OSQP, Clarabel, Direct, Newton, Solver, ThroughCvxpy

NAMES = {"newton": Newton, "clarabel": Clarabel, "osqp": OSQP, "direct": Direct}


def named_solver(name: str, accuracy: float | None) -> Solver:
    """One of ours, in any case of letters, or a name in capitals for cvxpy to find.

    Raises
    ------
    ProblemError
        It is neither; whether cvxpy finds it shows when it is prepared.
    """
    settings = {} if accuracy is None else {"accuracy": accuracy}
    if name.lower() in NAMES:
        return NAMES[name.lower()](**settings)
    if name != name.upper():
        raise ProblemError(
            f"--solver: there is no solver {name!r}; there are {', '.join(NAMES)}, and those that cvxpy finds, "
            "in capitals: SCS, HIGHS, ..."
        )
    return ThroughCvxpy(name, **settings)
