"""Solvers and linear solvers by the names that the command line gives them: ours, cvxpy's, and FILE.py:NAME."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from vemcvx.base.arrays import brief
from vemcvx.base.errors import ProblemError
from vemcvx.cli.problem_file import executed, literal, own_errors
from vemcvx.linear import Iterative, LinearSolver, Pardiso, PETSc, SuperLU, all_ranks, serve
from vemcvx.solvers import (
    OSQP,
    TUNED,
    Clarabel,
    Direct,
    Newton,
    Solver,
    ThroughCvxpy,
    as_solver,
    interfaces,
    list_installed,
)

LINEAR: dict[str, Callable[[], LinearSolver]] = {
    **{"superlu": SuperLU, "pardiso": Pardiso, "iterative": Iterative, "petsc": PETSc},
}
NAMES: dict[str, type[Solver]] = {"newton": Newton, "clarabel": Clarabel, "osqp": OSQP, "direct": Direct}


def named_solver(
    name: str, accuracy: float | None, option: str = "--solver", settings: Mapping[str, Any] | None = None
) -> Solver:
    """One of ours, one that cvxpy knows, in any case of letters, or the NAME in a file; `option` asked for it.

    A solver that cvxpy knows and does not find here raises later, when it is prepared.
    """
    given = dict(settings or {})
    if ":" in name:
        made = in_file(name, option, "solver", "solve(program, target)", _solves, **given)
        solver: Solver = own_errors(Path(name.rpartition(":")[0]), name, lambda: as_solver(made))
        solver = solver if accuracy is None else solver.with_accuracy(accuracy)
        solver.check_accuracy()
        return solver
    if name.lower() not in NAMES and not any(name.upper() in known for known in interfaces()):
        raise ProblemError(
            f"{option}: there is no solver {name!r}; there are {', '.join(NAMES)}, those that cvxpy finds here, "
            f"{', '.join(list_installed())}, and your own, FILE.py:CLASS."
        )
    if accuracy is not None:
        given["accuracy"] = accuracy
    kind = NAMES.get(name.lower(), ThroughCvxpy)
    own = [key for key in inspect.signature(kind).parameters if key not in ("solver", "options", "tuned")]
    others = {key: given.pop(key) for key in list(given) if key not in own}
    # Settings that are none of ours are those of the solver's library.
    if kind is ThroughCvxpy:
        return ThroughCvxpy(name.upper(), **given, options=others)
    if issubclass(kind, ThroughCvxpy):
        return kind(**given, options=others)
    if others:
        raise ProblemError(f"--option: {name} has no setting {min(others)!r}; it has {', '.join(own)}.")
    return kind(**given)


def completions() -> list[str]:
    """The names that shells complete: ours, and those of solvers that are tuned here."""
    return sorted({*NAMES, *(name.lower() for name in TUNED)})


def read_options(typed: Sequence[str], names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Settings by the names of solvers as they were typed, from words such as "clarabel.max_iter=200"."""
    called = {name.rpartition(":")[2].lower(): name for name in names}
    found: dict[str, dict[str, Any]] = {}
    for words in typed:
        key, equals, text = words.partition("=")
        solver, dot, setting = key.strip().partition(".")
        if not (equals and dot and solver and setting):
            raise ProblemError(f"--option: found {words!r}; wanted SOLVER.NAME=VALUE, such as clarabel.max_iter=200.")
        if solver.lower() not in called:
            raise ProblemError(f"--option: {solver!r} is none of the solvers asked for, {', '.join(called)}.")
        found.setdefault(called[solver.lower()], {})[setting] = literal(text)
    return found


def in_file(typed: str, option: str, noun: str, has: str, fits: Callable[[type], bool], **settings: Any) -> Any:
    """The solver FILE.py:NAME in a file of the user's: of a class, made with the settings given, or an object.

    Its class has what is said by `has`, and `fits`.
    """
    file, _, name = typed.rpartition(":")
    path = Path(file)
    module = executed(path, f"file of a {noun}")
    if not hasattr(module, name):
        there_are = sorted(key for key, value in vars(module).items() if isinstance(value, type) and fits(value))
        raise ProblemError(f"{option}: {path} has no {name!r}; its {noun}s are {', '.join(there_are) or 'none'}.")
    found = getattr(module, name)
    if not fits(found if isinstance(found, type) else type(found)):
        raise ProblemError(f"{option}: {path}: {name} is {brief(found)}; wanted a class with {has}, or its object.")
    if not isinstance(found, type):
        if settings:
            raise ProblemError(f"--option: {path}: {name} is an object, which takes no settings; name its class.")
        return found
    words = ", ".join(f"{key}={value!r}" for key, value in settings.items())
    return own_errors(path, f"{name}({words})", partial(found, **settings))


def _solves(kind: type) -> bool:
    return callable(getattr(kind, "solve", None)) or issubclass(kind, Solver)


def _factorises(kind: type) -> bool:
    return issubclass(kind, LinearSolver) and not inspect.isabstract(kind)


def named_linear(name: str | None) -> LinearSolver | None:
    """The linear solver of that name, or that in a file; None leaves the choice to the number of unknowns."""
    if name is None:
        return None
    if ":" in name:
        return in_file(name, "--linear", "linear solver", "the base vemcvx.LinearSolver", _factorises)
    if name.lower() not in LINEAR:
        raise ProblemError(
            f"--linear: there is no linear solver {name!r}; there are {', '.join(LINEAR)}, and your own, FILE.py:CLASS."
        )
    return LINEAR[name.lower()]()


def served(linear: str | None, runs: int = 1) -> bool:
    """Under mpiexec, hold PETSc's rows until rank 0 ends, on all other ranks; False at once where there is more to do.

    ProblemError where several `runs` are asked for, which have processes of their own.
    """
    if linear is None or linear.lower() != "petsc":
        return False
    if runs > 1 and all_ranks().comm.size > 1:
        raise ProblemError(
            "--set: several runs are processes of their own, which cannot share the ranks of mpiexec; start them one "
            "by one, or with --linear iterative."
        )
    return serve()
