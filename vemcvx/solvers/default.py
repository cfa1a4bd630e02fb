"""User-defined solvers (docs/howto/own_solver.md), the direct solver, and the choice of a solver."""

from __future__ import annotations

import inspect
import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np

from vemcvx.base.arrays import Floats, brief, flag, lengths
from vemcvx.base.errors import NotAccepted, SceneError
from vemcvx.program.operators import FEATURES, QUADRATIC, Operators
from vemcvx.program.step_program import Answer, StepProgram, read_answer
from vemcvx.solvers.conic import OSQP, Clarabel, ThroughCvxpy
from vemcvx.solvers.law import Weights
from vemcvx.solvers.newton import Newton, PreparedNewton, gap_of_law
from vemcvx.solvers.solver import INNER_FRACTION, Prepared, ScaledSolver, Solver, name_failures


class Solves(Protocol):
    """The protocol of user-defined solvers: `solve`, and optionally `accepts`, `accuracy` and `semidefinite`."""

    @property
    def solve(self) -> Callable[..., Any]:
        """The method solve(program, target), for one scaled step and the duality gap `target`."""


def as_solver(given: Solver | Solves) -> Solver:
    """Return a Solver unchanged, and wrap any other object with a method `solve`."""
    if isinstance(given, Solver):
        _features(given.accepts, given.name)
        return given
    if isinstance(given, type) or not callable(getattr(given, "solve", None)):
        raise SceneError(
            f"solver: found {brief(given)}; wanted a solver with its settings, such as Newton(accuracy=1e-8), or None "
            "for the default solver; any object with solve(program, target) is a solver."
        )
    return AdaptedSolver(given)


def _features(accepts: Any, name: str) -> frozenset[str]:
    several = isinstance(accepts, (set, frozenset, list, tuple))
    if not several or not all(isinstance(x, str) and x in FEATURES for x in accepts):
        there_are = ", ".join(map(repr, sorted(FEATURES)))
        raise SceneError(f"solver {name}: found accepts = {brief(accepts)}; wanted a set of some of {there_are}.")
    return frozenset(accepts)


class AdaptedSolver(Solver):
    """A wrapper around a user's object with `solve(program, target)`."""

    accepts: frozenset[str] = FEATURES

    def __init__(self, own: Solves):
        self._own = own
        self.accuracy = getattr(own, "accuracy", Solver.accuracy)
        self.accepts = _features(getattr(own, "accepts", FEATURES), self.name)
        self.semidefinite = flag(getattr(own, "semidefinite", False), f"solver {self.name}: semidefinite")

    def __repr__(self) -> str:
        """Return the name and the settings, without memory addresses."""
        own = {name: value for name, value in getattr(self._own, "__dict__", {}).items() if name[0] != "_"}
        plain = {name: value for name, value in own.items() if isinstance(value, (int, float, str))}
        settings = {**plain, "accuracy": self.accuracy}
        return f"{self.name}({', '.join(f'{name}={value!r}' for name, value in sorted(settings.items()))})"

    @property
    def name(self) -> str:
        return type(self._own).__name__

    def prepare(self, operators: Operators) -> AdaptedSolver:
        return self

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        begin = {"lam": lam.copy(), "p": np.zeros_like(program.e) if p is None else p.copy()}
        more = list(inspect.signature(self._own.solve).parameters)[2:]
        given = {name: begin[name] for name in ("lam", "p") if name in more}
        return read_answer(self._own.solve(program, target, **given), program, self.name)


@dataclass(frozen=True)
class Direct(Solver):
    """One linear solve per step, for programs without norm terms and limits.

    Parameters
    ----------
    accuracy : float
        Requested relative energy error of a step.

    Examples
    --------
    >>> vx.march(vx.System(2 * np.eye(1), lambda t: [t]), [0.0, 1.0], solver=vx.Direct()).state[-1]
    array([0.5])
    """

    accuracy: float = 1e-8

    accepts: ClassVar[frozenset[str]] = frozenset({QUADRATIC})
    any_units = True

    def prepare(self, operators: Operators) -> Direct:
        return self

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        d = program.operators.factor.solve(program.g)
        return Answer(d, np.zeros_like(lam), 1, "solved", p=np.zeros_like(program.e))


PATIENCE = 12  # The fixed-point iteration stops if this number of programs does not halve the gap.


@dataclass(frozen=True, eq=False)
class RunSolver:
    """A solver prepared for the steps of a run.

    Weights are constants, or follow from a law of friction. If a step has a law, Newton's method solves the step
    directly. Other solvers use a fixed-point iteration. One step of `newton` from an answer gives the next weights.
    """

    solver: Solver
    prepared: Prepared
    newton: PreparedNewton

    @classmethod
    def prepare(cls, solver: Solver, operators: Operators) -> RunSolver:
        """Prepare a solver, or raise NotAccepted if it does not accept a singular K."""
        if operators.kernel is not None and not solver.semidefinite:
            raise NotAccepted(
                f"solver {solver.name}: only friction and contact hold a body, so that K is semidefinite; this solver "
                "needs a definite K. Take Newton or Clarabel, or set `semidefinite = True` in a solver of your own."
            )
        with name_failures(solver.name):
            prepared = solver.prepare(operators) if solver.any_units else ScaledSolver(solver, operators)
        newton = prepared if isinstance(prepared, PreparedNewton) else PreparedNewton(operators, 1)
        return cls(solver, prepared, newton)

    @cached_property
    def second(self) -> RunSolver:
        solver = Clarabel() if self.prepared is self.newton else self.solver
        if not isinstance(solver, ThroughCvxpy):
            return self
        return RunSolver.prepare(solver.for_second_attempt(), self.newton.operators)

    def solve(
        self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None, law: Weights | None = None
    ) -> Answer:
        if self.prepared is self.newton:
            return self.newton.solve(program, target, lam, p, law)
        if law is None or law.is_given:
            return read_answer(self.prepared.solve(program, target, lam, p), program, self.solver.name)
        # The weights of `program` may be too small to hold a body without supports.
        floats = program.operators.kernel is not None
        w = np.full(len(program.w), np.abs(program.g).sum()) if floats else program.w
        best, least, waited, iterations = None, np.inf, 0, 0
        while True:
            posed = replace(program, w=w)
            answer = self.solve(posed, INNER_FRACTION * target, lam, p)
            d, lam, p = posed.admissible_point(answer.d, answer.lam, answer.p)
            answer, iterations = replace(answer, d=d, lam=lam, p=p), iterations + answer.iterations
            gap = gap_of_law(program, law, answer)
            waited = 0 if gap < 0.5 * least else waited + 1
            if best is None or gap < least:
                best, least = answer, gap
            if least <= target or waited == PATIENCE:
                return replace(best, iterations=iterations)
            # Omit the Newton step if the gap was not halved, to break cycles.
            ahead = answer if waited else self.newton.solve_from(program, law, answer)
            w = law.at(ahead.p, lengths(program.slip(ahead.d)))

    def retry(
        self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None, law: Weights | None = None
    ) -> Answer:
        law = law or Weights(program.w)
        first = self.second.solve(program, target, lam, p, law)
        if self.prepared is not self.newton:
            return first
        last = self.newton.solve_from(program, law, first)
        best = min((first, last), key=lambda one: gap_of_law(program, law, one))
        return replace(best, iterations=first.iterations + last.iterations, status=f"{best.status}, after Clarabel")


BY_SIZE: tuple[Solver, ...] = (Direct(), Newton(), OSQP(), Clarabel())
# The default is the first of these solvers that accepts the program.

log = logging.getLogger("vemcvx")


def choose_solver(operators: Operators, given: Solver | Solves | None) -> Solver:
    """Return the given solver or the default. Raise NotAccepted if a feature is not accepted."""
    if given is None:
        solver = next(s for s in BY_SIZE if operators.features <= s.accepts)
        log.info("solver: %s, the default for %s", solver.name, name_features(operators.features))
        return solver
    asked = as_solver(given)
    missing = operators.features - asked.accepts
    if missing:
        able = ", ".join(s.name for s in BY_SIZE if operators.features <= s.accepts)
        raise NotAccepted(
            f"solver {asked.name}: the program has {name_features(missing)}, which this solver does not accept. "
            f"Accepted features: {name_features(asked.accepts)}. These solvers accept the program: {able}."
        )
    return asked


def name_features(features: frozenset[str]) -> str:
    """Return the features as a comma-separated list."""
    return ", ".join(sorted(features))
