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
from vemcvx.solvers.solver import InUnits, Solver


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
        return given
    if isinstance(given, type) or not callable(getattr(given, "solve", None)):
        raise SceneError(
            f"solver: found {brief(given)}; wanted a solver with its settings, such as Newton(accuracy=1e-8), or None "
            "for the smallest that accepts the program; any object with solve(program, target) is a solver."
        )
    return AdaptedSolver(given)


class AdaptedSolver(Solver):
    """A solver around somebody's object with `solve(program, target)`.

    Without `accepts` that is taken to accept every feature, without `accuracy` 1e-6 is asked of it, and without
    `semidefinite` it is given a positive definite K only.
    """

    accepts: frozenset[str] = FEATURES

    def __init__(self, own: Solves):
        self._own = own
        self.accuracy = getattr(own, "accuracy", Solver.accuracy)
        accepts = getattr(own, "accepts", FEATURES)
        several = isinstance(accepts, (set, frozenset, list, tuple))
        if not several or not all(isinstance(x, str) and x in FEATURES for x in accepts):
            there_are = ", ".join(map(repr, sorted(FEATURES)))
            raise SceneError(
                f"solver {self.name}: found accepts = {brief(accepts)}; wanted a set of some of {there_are}."
            )
        self.accepts = frozenset(accepts)
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


MOST_PROGRAMS = 3
"""Programs of Clarabel's for a law that active sets do not solve."""
AFTER = ", after Clarabel"


@dataclass(frozen=True, eq=False)
class LastResort:
    """Newton's method, prepared for a run, with Clarabel for steps that miss the target."""

    newton: PreparedNewton

    @cached_property
    def conic(self) -> InUnits:
        """Clarabel, compiled when it is first asked."""
        return InUnits.of(Clarabel(), self.newton.operators)

    def solve(
        self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None, law: Weights | None = None
    ) -> Answer:
        """Answer one step; `status` says where Clarabel was asked."""
        best = last = self.newton.solve(program, target, lam, p, law)
        law, count = law or GivenWeights(program.w), best.iterations
        for _ in range(1 if law.given else MOST_PROGRAMS):
            gap = gap_under(program, law, best)
            if gap <= target or gap <= program.rounding_floor(best.d, best.lam, best.p):
                break
            w = law.at(last.p, lengths(program.slip(last.d)))
            asked = self.conic.solve(replace(program, w=w), target, last.lam, last.p)
            last = self.newton.begun_at(program, law, asked)
            count += asked.iterations + last.iterations
            best = min((best, asked, last), key=lambda one: gap_under(program, law, one))
            best = replace(best, status=f"{best.status.removesuffix(AFTER)}{AFTER}")
        return replace(best, iterations=count)


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
