"""Solvers of users' own, the direct one, and the choice of a solver: the one asked for, else the smallest that accepts.

A solver of one's own is any object with `solve(program, target)`; it inherits from nothing and is registered nowhere.
Its `solve` is given one scaled step at a time, a :class:`vemcvx.program.step_program.StepProgram`, with the duality gap
asked for; parameters named lam and p, if it has them, get multipliers to begin with, which the steps before let expect.
It returns an Answer, or (d, lam, p), (d, lam) or d alone; a whole number at the end of a tuple is its iterations.
"""

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
from vemcvx.program.operators import FEATURES, QUADRATIC, SECOND_ORDER_CONES, Operators
from vemcvx.program.step_program import Answer, StepProgram, read_answer
from vemcvx.solvers.conic import OSQP, Clarabel
from vemcvx.solvers.law import GivenWeights, Weights
from vemcvx.solvers.newton import Newton, PreparedNewton, gap_under
from vemcvx.solvers.solver import SHARE, InUnits, Prepared, Solver, named_failures


class Solves(Protocol):
    """The protocol of a user's solver: `solve`; attributes `accepts`, `accuracy` and `semidefinite` are read, too."""

    @property
    def solve(self) -> Callable[..., Any]:
        """A method of (program, target): answers one scaled step up to a duality gap of `target`."""


def as_solver(given: Solver | Solves) -> Solver:
    """Return a Solver as it is, and any other object with `solve` as one.

    SceneError where it is a class, or has no `solve`, or an `accepts` that names no features.
    """
    if isinstance(given, Solver):
        _features(given.accepts, given.name)
        return given
    if isinstance(given, type) or not callable(getattr(given, "solve", None)):
        raise SceneError(
            f"solver: found {brief(given)}; wanted a solver with its settings, such as Newton(accuracy=1e-8), or None "
            "for the smallest that accepts the program; any object with solve(program, target) is a solver."
        )
    return AdaptedSolver(given)


def _features(accepts: Any, name: str) -> frozenset[str]:
    """Return the features that a solver accepts, or raise SceneError where they are none."""
    several = isinstance(accepts, (set, frozenset, list, tuple))
    if not several or not all(isinstance(x, str) and x in FEATURES for x in accepts):
        there_are = ", ".join(map(repr, sorted(FEATURES)))
        raise SceneError(f"solver {name}: found accepts = {brief(accepts)}; wanted a set of some of {there_are}.")
    return frozenset(accepts)


class AdaptedSolver(Solver):
    """A solver around somebody's object with `solve(program, target)`.

    Without `accepts` that is taken to accept every feature, without `accuracy` 1e-6 is asked of it, and without
    `semidefinite` it is given a positive definite K only.
    """

    accepts: frozenset[str] = FEATURES

    def __init__(self, own: Solves):
        self._own = own
        self.accuracy = getattr(own, "accuracy", Solver.accuracy)
        self.accepts = _features(getattr(own, "accepts", FEATURES), self.name)
        self.semidefinite = flag(getattr(own, "semidefinite", False), f"solver {self.name}: semidefinite")

    def __repr__(self) -> str:
        """Return the name, and the public attributes that are plain: they say the same in every process."""
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
        """Answer one scaled step, from the expected multipliers if `solve` has parameters for them."""
        begin = {"lam": lam.copy(), "p": np.zeros_like(program.e) if p is None else p.copy()}
        more = list(inspect.signature(self._own.solve).parameters)[2:]
        given = {name: begin[name] for name in ("lam", "p") if name in more}
        return read_answer(self._own.solve(program, target, **given), program, self.name)


@dataclass(frozen=True)
class Direct(Solver):
    """One back-substitution a step; takes programs without terms only."""

    accuracy: float = 1e-8

    accepts: ClassVar[frozenset[str]] = frozenset({QUADRATIC})
    any_units = True

    def prepare(self, operators: Operators) -> Direct:
        return self

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        """Answer one step."""
        d = program.operators.factor.solve(program.g)
        return Answer(d, np.zeros_like(lam), 1, "solved", p=np.zeros_like(program.e))


PATIENCE = 12
"""Programs in a row that do not halve the least gap before the fixed point is given up."""


@dataclass(frozen=True, eq=False)
class FixedPoint:
    """A solver of given weights, prepared for a run: under a law, a fixed point of its programs.

    With T(w) the answer for the weights w, the law asks for w = law(p(T(w)), |s(T(w))|). The next weights come from one
    Newton step on the active sets of the answer; where sets have settled they are those of the solution.
    """

    name: str
    prepared: Prepared
    newton: PreparedNewton

    @classmethod
    def of(cls, solver: Solver, operators: Operators) -> FixedPoint:
        """Return the solver, prepared for the operators of a run."""
        prepared = solver.prepare(operators) if solver.any_units else InUnits.of(solver, operators)
        return cls(solver.name, prepared, PreparedNewton(operators, 1))

    def solve(
        self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None, law: Weights | None = None
    ) -> Answer:
        """Answer one step; under a law it is the answer with the least gap under its own weights."""
        if law is None or law.given:
            return read_answer(self.prepared.solve(program, target, lam, p), program, self.name)
        # Friction under the earlier pressures may not hold a body without supports: at first it holds any load.
        floats = program.operators.kernel is not None
        w = np.full(len(program.w), np.abs(program.g).sum()) if floats else program.w
        best, least, waited, iterations = None, np.inf, 0, 0
        while True:
            posed = replace(program, w=w)
            answer = self.solve(posed, SHARE * target, lam, p)
            d, lam, p = posed.admissible_point(answer.d, answer.lam, answer.p)
            answer, iterations = replace(answer, d=d, lam=lam, p=p), iterations + answer.iterations
            gap = gap_under(program, law, answer)
            waited = 0 if gap < 0.5 * least else waited + 1
            if best is None or gap < least:
                best, least = answer, gap
            if least <= target or waited == PATIENCE:
                return replace(best, iterations=iterations)
            # Where that has gained nothing the plain weights are taken: they break cycles of sets.
            ahead = answer if waited else self.newton.begun_at(program, law, answer)
            w = law.at(ahead.p, lengths(program.slip(ahead.d)))

    again = solve


@dataclass(frozen=True, eq=False)
class LastResort:
    """Newton's method, prepared for a run, with Clarabel for steps that miss the target."""

    newton: PreparedNewton

    @cached_property
    def conic(self) -> FixedPoint:
        """Clarabel, compiled when it is first asked."""
        return FixedPoint.of(Clarabel(), self.newton.operators)

    @property
    def solve(self) -> Callable[..., Answer]:
        """Newton's method for one step."""
        return self.newton.solve

    def again(
        self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None, law: Weights | None = None
    ) -> Answer:
        """Answer a step that missed, by Clarabel, or from the sets of its answer; `status` says so."""
        law = law or GivenWeights(program.w)
        asked = self.conic.solve(program, target, lam, p, law)
        last = self.newton.begun_at(program, law, asked)
        best = min((asked, last), key=lambda one: gap_under(program, law, one))
        return replace(best, iterations=asked.iterations + last.iterations, status=f"{best.status}, after Clarabel")


def prepare_run(solver: Solver, operators: Operators) -> LastResort | FixedPoint:
    """Return the solver, prepared for a run; NotAccepted where K has a kernel and the solver takes none."""
    if operators.kernel is not None and not solver.semidefinite:
        raise NotAccepted(
            f"solver {solver.name}: only friction and contact hold a body, so that K is semidefinite, which it "
            "does not take; a solver that does says so by `semidefinite = True`. Newton and Clarabel do."
        )
    with named_failures(solver.name):
        found = FixedPoint.of(solver, operators)
    return LastResort(found.prepared) if isinstance(found.prepared, PreparedNewton) else found


BY_SIZE: tuple[Solver, ...] = (Direct(), Newton(), OSQP(), Clarabel())
"""The solvers that come with the package, the smallest first."""

log = logging.getLogger("vemcvx")


def choose_solver(operators: Operators, given: Solver | Solves | None) -> Solver:
    """The solver for programs of `operators`; NotAccepted where the one asked for does not take one of its features."""
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
