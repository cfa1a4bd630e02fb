"""Solvers by the names that the command line gives them: ours, those that cvxpy finds, and FILE.py:NAME."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from vemcvx.arrays import brief
from vemcvx.cli.problem_file import executed, literal, own_errors
from vemcvx.errors import ProblemError
from vemcvx.linear import LinearSolver, Multigrid, Pardiso, SuperLU
from vemcvx.solvers import OSQP, Clarabel, Direct, Newton, Solver, ThroughCvxpy, as_solver
from vemcvx.solvers.conic import installed, known

LINEAR: dict[str, Callable[[], LinearSolver]] = {"superlu": SuperLU, "pardiso": Pardiso, "multigrid": Multigrid}
NAMES: dict[str, type[Solver]] = {"newton": Newton, "clarabel": Clarabel, "osqp": OSQP, "direct": Direct}


def named_solver(
    name: str, accuracy: float | None, option: str = "--solver", settings: Mapping[str, Any] | None = None
) -> Solver:
    """One of ours, one that cvxpy knows, in any case of letters, or the NAME in a file; `option` asked for it.

    Raises
    ------
    ProblemError
        There is none of that name, or it has no such settings; whether cvxpy finds one that it knows shows when it is
        prepared.
    """
    given = dict(settings or {})
    file, colon, inside = name.rpartition(":")
    if colon:
        solver = solver_in_file(Path(file), inside, option, given)
        solver = solver if accuracy is None else solver.asked(accuracy)
        solver.check_accuracy()
        return solver
    if name.lower() not in NAMES and name.upper() not in known():
        raise ProblemError(
            f"{option}: there is no solver {name!r}; there are {', '.join(NAMES)}, those that cvxpy finds here, "
            f"{', '.join(installed())}, and your own, FILE.py:CLASS."
        )
    if accuracy is not None:
        given["accuracy"] = accuracy
    if name.lower() not in NAMES:
        return _with_options(partial(ThroughCvxpy, name.upper()), ThroughCvxpy, given)
    kind = NAMES[name.lower()]
    if issubclass(kind, ThroughCvxpy):
        return _with_options(kind, kind, given)
    known_settings = list(inspect.signature(kind).parameters)
    if strange := given.keys() - set(known_settings):
        raise ProblemError(f"--option: {name} has no setting {min(strange)!r}; it has {', '.join(known_settings)}.")
    return kind(**given)


def _with_options(make: Callable[..., Solver], kind: type[Solver], given: Mapping[str, Any]) -> Solver:
    """A solver that cvxpy calls: settings that are none of its own are its library's."""
    own = set(inspect.signature(kind).parameters) - {"solver", "options", "tuned"}
    library = {key: value for key, value in given.items() if key not in own}
    return make(**{key: value for key, value in given.items() if key in own}, options=library)


def read_options(typed: Sequence[str], names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Settings by the names of solvers as they were typed, from words such as "clarabel.max_iter=200".

    Raises
    ------
    ProblemError
        They are no such words, or no solver of that name is asked for.
    """
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


def solver_in_file(path: Path, name: str, option: str, settings: Mapping[str, Any]) -> Solver:
    """The solver `name` that a file of the user's defines: a class, made with the settings given, or an object.

    Raises
    ------
    ProblemError
        There is no such file, it fails, it has no such name, or what it has is no solver.
    """
    module = executed(path, "file of a solver")
    if not hasattr(module, name):
        there_are = sorted(key for key, value in vars(module).items() if isinstance(value, type) and _solves(value))
        raise ProblemError(f"{option}: {path} has no {name!r}; its solvers are {', '.join(there_are) or 'none'}.")
    found = getattr(module, name)
    if not _solves(found):
        raise ProblemError(
            f"{option}: {path}: {name} is {brief(found)}; wanted a class with solve(program, target), or its object."
        )
    if settings and not isinstance(found, type):
        raise ProblemError(f"--option: {path}: {name} is an object, which takes no settings; name its class.")
    words = ", ".join(f"{key}={value!r}" for key, value in settings.items())
    made = own_errors(path, f"{name}({words})", partial(found, **settings)) if isinstance(found, type) else found
    solver: Solver = own_errors(path, name, lambda: as_solver(made))
    return solver


def _solves(found: object) -> bool:
    kind = found if isinstance(found, type) else type(found)
    return callable(getattr(kind, "solve", None)) or issubclass(kind, Solver)


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
