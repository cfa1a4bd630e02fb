"""Solvers by the names that the command line gives them."""

from __future__ import annotations

from collections.abc import Callable

from vemcvx.errors import ProblemError
from vemcvx.linear import LinearSolver, Multigrid, Pardiso, SuperLU
from vemcvx.solvers import OSQP, Clarabel, Direct, Newton, Solver, ThroughCvxpy

LINEAR: dict[str, Callable[[], LinearSolver]] = {"superlu": SuperLU, "pardiso": Pardiso, "multigrid": Multigrid}
NAMES: dict[str, Callable[..., Solver]] = {"newton": Newton, "clarabel": Clarabel, "osqp": OSQP, "direct": Direct}


def named_solver(name: str, accuracy: float | None, option: str = "--solver") -> Solver:
    """One of ours, in any case of letters, or a name in capitals for cvxpy to find; `option` asked for it.

    Raises
    ------
    ProblemError
        It is neither; whether cvxpy finds it shows when it is prepared.
    """
    if name.lower() in NAMES:
        solver = NAMES[name.lower()]
        return solver() if accuracy is None else solver(accuracy=accuracy)
    if name != name.upper():
        raise ProblemError(
            f"{option}: there is no solver {name!r}; there are {', '.join(NAMES)}, and those that cvxpy finds, "
            "in capitals: SCS, HIGHS, ..."
        )
    return ThroughCvxpy(name) if accuracy is None else ThroughCvxpy(name, accuracy)


def named_linear(name: str | None) -> LinearSolver | None:
    """The linear solver of that name; None leaves the choice to the number of unknowns.

    Raises
    ------
    ProblemError
        There is none of that name.
    """
    if name is None:
        return None
    if name.lower() not in LINEAR:
        raise ProblemError(f"--linear: there is no linear solver {name!r}; there are {', '.join(LINEAR)}.")
    return LINEAR[name.lower()]()
