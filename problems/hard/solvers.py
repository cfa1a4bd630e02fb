"""Solvers: limits, absence, failure in the middle of a run, and steps where nothing is left to decide."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import vemcvx as vx
from hard.case import Case, Setting
from hard.ground import TIMES, block, on, voronoi

MESH = voronoi(12)
CANNOT = "says it cannot"


@dataclass(frozen=True)
class Unreliable(vx.Newton):
    """Answers well until it is asked for the fourth time, and then returns nonsense with a straight face."""

    @property
    def name(self):
        return "Newton that fails"

    def prepare(self, operators):
        inner, asked = super().prepare(operators), []

        class Prepared:
            def solve(self, program, target, lam, p):
                asked.append(1)
                answer = inner.solve(program, target, lam, p)
                return answer if len(asked) < 4 else replace(answer, d=1.5 * answer.d, status="solved")

        return Prepared()


def checked(case_times=TIMES, **more):
    return lambda: Setting(block(), MESH, case_times, options={"check": True, **more})


def repeated():
    """Load that rests every other step: nothing is solved there, and nothing changes."""
    return on(MESH, lambda t: np.floor(4 * t), times=np.linspace(0, 1, 17))


def rests(setting, history):
    moved = np.abs(np.diff(history.displacement, axis=0)).max(axis=(1, 2)) > 0
    return (
        ""
        if list(np.flatnonzero(moved) + 1) == [4, 8, 12, 16]
        else f"it moves in the steps {np.flatnonzero(moved) + 1}"
    )


def all_but_one_degenerate():
    """Every term at its bound and none slipping, step after step: |lam| = w and s = 0 at once."""
    from hard.friction import at_the_threshold

    return at_the_threshold()


CASES = (
    Case("one system of sets allowed: Clarabel takes over", checked(), solvers=(vx.Newton(max_iterations=1),)),
    Case(
        "Clarabel, one iteration allowed",
        checked(),
        CANNOT,
        "Clarabel reached",
        solvers=(vx.Clarabel(options={"max_iter": 1}),),
    ),
    Case(
        "Clarabel, no time", checked(), CANNOT, "Clarabel reached", solvers=(vx.Clarabel(options={"time_limit": 1e-9}),)
    ),
    Case("OSQP, ten iterations", checked(), CANNOT, "OSQP reached", solvers=(vx.OSQP(options={"max_iter": 10}),)),
    Case(
        "a solver that is not there", checked(), CANNOT, "cvxpy does not find it", solvers=(vx.ThroughCvxpy("MOSEKK"),)
    ),
    Case("one that fails in the fourth step", checked(), CANNOT, "step 4", solvers=(Unreliable(),)),
    Case("one that takes no friction", checked(), CANNOT, "does not accept", solvers=(vx.Direct(),)),
    Case(
        "accuracy beyond rounding",
        checked(),
        CANNOT,
        "but 1.0e-15 was requested",
        solvers=(vx.Clarabel(accuracy=1e-15),),
    ),
    Case("loads that rest", repeated, holds=rests),
    Case("all terms at their bound, none slipping", all_but_one_degenerate),
)
