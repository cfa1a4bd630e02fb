"""Solvers and linear solvers by name on the command line. FILE.py:NAME is a solver in a user's file."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vemcvx.base.arrays import brief
from vemcvx.base.errors import ProblemError
from vemcvx.cli.problem_file import execute_file, run_user_code
from vemcvx.linear import Iterative, LinearSolver, Pardiso, PETSc, SuperLU, all_ranks, serve
from vemcvx.solvers import OSQP, Clarabel, Direct, Newton, Solver, ThroughCvxpy, as_solver, interfaces, list_installed

LINEAR: dict[str, type[LinearSolver]] = {"superlu": SuperLU, "pardiso": Pardiso, "iterative": Iterative, "petsc": PETSc}
NAMES: dict[str, type[Solver]] = {"newton": Newton, "clarabel": Clarabel, "osqp": OSQP, "direct": Direct}


def make_solver(name: str, accuracy: float | None, option: str = "--solver") -> Solver:
    """Return the solver called `name`."""
    if ":" in name:
        made = load_from_file(name, option, "solver", "solve(program, target)", _solves)
        solver: Solver = run_user_code(Path(name.rpartition(":")[0]), name, lambda: as_solver(made))
        solver = solver if accuracy is None else solver.with_accuracy(accuracy)
        solver.check_accuracy()
        return solver
    if name.lower() not in NAMES and not any(name.upper() in known for known in interfaces()):
        raise ProblemError(
            f"{option}: there is no solver {name!r}; there are {', '.join(NAMES)}, those that cvxpy finds here "
            f"({', '.join(list_installed())}), and your own (FILE.py:CLASS)."
        )
    given: dict[str, Any] = {} if accuracy is None else {"accuracy": accuracy}
    kind = NAMES.get(name.lower())
    return ThroughCvxpy(name.upper(), **given) if kind is None else kind(**given)


def load_from_file(typed: str, option: str, noun: str, has: str, fits: Callable[[type], bool]) -> Any:
    """Return the object NAME of FILE.py, or an object of the class NAME."""
    file, _, name = typed.rpartition(":")
    path = Path(file)
    module = execute_file(path, f"file of a {noun}")
    if not hasattr(module, name):
        there_are = sorted(key for key, value in vars(module).items() if isinstance(value, type) and fits(value))
        raise ProblemError(f"{option}: {path} has no {name!r}; its {noun}s are {', '.join(there_are) or 'none'}.")
    found = getattr(module, name)
    if not fits(found if isinstance(found, type) else type(found)):
        raise ProblemError(f"{option}: {path}: {name} is {brief(found)}; wanted a class (or object) with {has}.")
    return run_user_code(path, f"{name}()", found) if isinstance(found, type) else found


def _solves(kind: type) -> bool:
    return callable(getattr(kind, "solve", None)) or issubclass(kind, Solver)


def _factorises(kind: type) -> bool:
    return issubclass(kind, LinearSolver) and not inspect.isabstract(kind)


def make_linear_solver(name: str | None) -> LinearSolver | None:
    """Return the linear solver called `name`, or None."""
    if name is None:
        return None
    if ":" in name:
        return load_from_file(name, "--linear", "linear solver", "the base vemcvx.LinearSolver", _factorises)
    if name.lower() not in LINEAR:
        raise ProblemError(
            f"--linear: there is no linear solver {name!r}; there are {', '.join(LINEAR)}, and your own, FILE.py:CLASS."
        )
    return LINEAR[name.lower()]()


def serve_ranks(linear: str | None, runs: int = 1) -> bool:
    """Serve PETSc on ranks above 0; return True on these ranks."""
    if linear is None or linear.lower() != "petsc":
        return False
    if runs > 1 and all_ranks().comm.size > 1:
        raise ProblemError("--set: several runs cannot share the ranks of mpiexec; start them one by one.")
    return serve()
