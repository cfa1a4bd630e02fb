"""Semismooth Newton, by hand: active sets first, a proximal point method when they fail, the gap as judge.

The residual is that of the proximal map on the multipliers (norm terms only, for brevity; limits likewise), F(d, lam)
= (K d - g + B'lam, lam - P_w(lam + a s)), s = B d - b; a Newton step on it is the answer on the sets of
:mod:`vemcvx.solvers.sets`. In the manner of the adaptive semismooth Newton method of Xiao, Li, Wen and Zhang (J. Sci.
Comput. 2018; the paper's [24]) a Newton point is *accepted* while it brings progress, and otherwise a *safeguard*
step of a globally convergent method is taken from the best point so far, from which Newton is tried again. Merit and
stopping test are one number, the certified duality gap, which is zero only at the solution and needs no scaling.

Theorem. The gaps of the best points tend to 0. Proof: if the safeguard is called finitely often, every
further Newton point but PATIENCE in a row has at most half the best gap. Otherwise the safeguard's
iterates are those of the proximal point algorithm, which converges (see :mod:`vemcvx.solvers.proximal`); the
best gap is at most theirs.  QED. On absolute values the sets are finitely many and, where no
sticking term has |lam_i| = w_i and no slipping one s_i = 0, found after finitely many steps.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from vemcvx.arguments import whole
from vemcvx.arrays import EPS, Floats
from vemcvx.program.answer import Answer
from vemcvx.program.operators import (
    ABSOLUTE_VALUES,
    BOUNDS,
    QUADRATIC,
    SECOND_ORDER_CONES,
    SQUARED_POSITIVE_PARTS,
    Operators,
)
from vemcvx.program.step_program import StepProgram
from vemcvx.program.tolerances import FURTHER_GAP
from vemcvx.solvers.proximal import proximal_points
from vemcvx.solvers.sets import Iterate, Sets, Shifts, answer_on, sets_at
from vemcvx.solvers.solver import Solver

PROXIMAL = 100.0
"""First shifts of the proximal point method, in those of the active sets."""
PATIENCE = 8
"""Newton points in a row that may fail to halve the best gap before the safeguard is called."""
OVERRELAXATION = 0.01
"""How far multipliers of discs begin a step beyond their bound: they then turn against SHIFT / OVERRELAXATION times the
stiffness that they feel. If all stick, 64 steps take a tenth to a quarter more solves; with .03 and .1 a few more."""


@dataclass(frozen=True)
class Newton(Solver):
    """Hand-written semismooth Newton method, globally convergent; takes every kind of term.

    Parameters
    ----------
    accuracy : float
        Certified relative energy error asked of a step.
    max_iterations : int
        Linear solves a step before it gives up; the answer so far is returned and will not be certified.
    """

    accuracy: float = 1e-8
    max_iterations: int = 400

    accepts: ClassVar[frozenset[str]] = frozenset(
        {QUADRATIC, ABSOLUTE_VALUES, SECOND_ORDER_CONES, BOUNDS, SQUARED_POSITIVE_PARTS}
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        whole(self.max_iterations, "Newton", "max_iterations", "linear solves")

    @property
    def solves_on_sets(self) -> bool:
        return True

    @property
    def advice(self) -> str:
        return "raise max_iterations"

    def limited(self, max_iterations: int) -> Newton:
        return replace(self, max_iterations=max_iterations)

    def prepare(self, operators: Operators) -> Newton:
        return self

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        """Answer one scaled step."""
        run = _Search(program, target, self.max_iterations)
        shift = Shifts.of(program.operators)
        pressed = np.zeros(len(program.e)) if p is None else np.maximum(p, 0.0)
        start = Iterate(np.zeros(len(program.g)), _overrelaxed(program, lam), pressed)
        run.newton(start, shift)
        if not run.done:
            for point, centre_shift in proximal_points(program, run.best, shift * PROXIMAL):
                run.offer(point, "proximal")
                if run.done:
                    break
                run.newton(point, centre_shift, patience=1)
                if run.done:
                    break
        best = run.best
        return Answer(
            d=best.d, lam=best.lam, iterations=run.iterations, status=run.words, safeguards=run.safeguards, p=best.p
        )


def _overrelaxed(program: StepProgram, lam: Floats) -> Floats:
    """Multipliers to begin with: terms that were at their bound slip again, as under most loads they do."""
    beyond = 4 * EPS if program.operators.block == 1 else OVERRELAXATION
    return (1.0 + beyond) * program.project(lam)


@dataclass
class _Search:
    """The best point of one step, and how many linear solves it took."""

    program: StepProgram
    target: float
    max_iterations: int
    iterations: int = 0
    safeguards: int = 0
    first: Iterate = field(init=False)
    best: Iterate = field(init=False)
    gap: float = np.inf
    stationary: bool = False

    def offer(self, point: Iterate, kind: str) -> None:
        """Count a linear solve, and keep its point, moved within the bounds, if it is the best."""
        self.iterations += 1
        self.safeguards += kind == "proximal"
        offered = Iterate(*self.program.admissible_point(point.d, point.lam, point.p))
        gap = self.program.duality_gap(offered.d, offered.lam, offered.p)
        if self.iterations == 1:
            self.first = offered
        if self.iterations == 1 or gap < self.gap:
            self.best, self.gap = offered, gap

    @cached_property
    def floor(self) -> float:
        """The rounding floor, of the first point or the best, taken once if at all.

        The lower one: a limit that is not met to the last digit may count far more at one point than at another, and
        what is above the target is worth further steps.
        """
        return min(self.program.rounding_floor(x.d, x.lam, x.p) for x in (self.first, self.best))

    @property
    def done(self) -> bool:
        """Sharp enough, at the rounding floor, at the target and no longer improving, or out of iterations."""
        return self.gap <= self.enough or self.iterations >= self.max_iterations or self.gap <= self.floor

    @property
    def enough(self) -> float:
        """The gap at which to stop; below the target iterations go on, where each is cheap and gains."""
        return self.target if self.stationary or not self.exact else FURTHER_GAP * self.target

    @property
    def exact(self) -> bool:
        """Whether linear systems are solved to rounding: the same sets then have the same answer."""
        return self.program.operators.factor.exact

    @property
    def words(self) -> str:
        return "converged" if self.gap <= self.target or self.gap <= self.floor else "iteration limit"

    def newton(self, point: Iterate, shift: Shifts, patience: int = PATIENCE) -> None:
        """Active-set steps while one in `patience` halves the best gap and the sets change.

        Those of discs change with every direction: where their answer is sharp enough, nothing more is to be learnt.
        """
        converges = self.program.operators.block > 1 or not self.exact
        seen: Sets | None = None
        waited = 0
        while waited < patience and self.iterations < self.max_iterations:
            sets = sets_at(self.program, point, shift)
            if self.exact and seen is not None and sets.same(seen):
                self.stationary = True
                return
            before = self.gap
            point = answer_on(self.program, sets, point)
            self.offer(point, "newton")
            waited = 0 if self.gap <= 0.5 * before else waited + 1
            if waited and self.gap <= self.target:
                self.stationary = True
                return
            # The floor is that of a point that is no longer improved: far from the solution it is higher.
            if converges and (self.gap <= self.enough or waited) and self.done:
                return
            seen = sets
