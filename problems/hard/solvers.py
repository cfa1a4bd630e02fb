"""Solvers: limits of iterations and time, missing solvers, failure in the middle of a run, steps without motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import vemcvx as vx
from hard.case import ACCURACY, Case, Setting
from hard.ground import TIMES, block, on, voronoi

MESH = voronoi(12)
CANNOT = "says it cannot"


@dataclass(frozen=True)
class Unreliable(vx.Newton):
    """A solver that from its fourth call on returns wrong solutions with the status "solved"."""

    @property
    def name(self):
        return "Newton that fails"

    def prepare(self, operators):
        inner, calls = super().prepare(operators), []

        class Prepared:
            def solve(self, program, target, lam, p):
                calls.append(1)
                answer = inner.solve(program, target, lam, p)
                return answer if len(calls) < 4 else replace(answer, d=1.5 * answer.d, status="solved")

        return Prepared()


def setting_with_check(case_times=TIMES, **more):
    return lambda: Setting(block(), MESH, case_times, options={"check": True, **more})


def resting_load():
    """Return a setting whose load changes in every fourth step only."""
    return on(MESH, lambda t: np.floor(4 * t), times=np.linspace(0, 1, 17))


def rests(setting, history):
    size = np.abs(history.displacement).max()
    moved = np.abs(np.diff(history.displacement, axis=0)).max(axis=(1, 2)) > ACCURACY * size
    return (
        ""
        if list(np.flatnonzero(moved) + 1) == [4, 8, 12, 16]
        else f"the body moves in the steps {np.flatnonzero(moved) + 1}"
    )


def all_degenerate():
    """Return a setting in which the friction of every node is at its bound although no node slips."""
    from hard.friction import at_the_threshold

    return at_the_threshold()


CASES = (
    Case(
        "one linear system allowed: Clarabel takes over", setting_with_check(), solvers=(vx.Newton(max_iterations=1),)
    ),
    Case(
        "Clarabel, one iteration allowed",
        setting_with_check(),
        CANNOT,
        "Clarabel reached",
        solvers=(vx.Clarabel(options={"max_iter": 1}),),
    ),
    Case(
        "Clarabel, no time",
        setting_with_check(),
        CANNOT,
        "Clarabel reached",
        solvers=(vx.Clarabel(options={"time_limit": 1e-9}),),
    ),
    Case(
        "OSQP, ten iterations",
        setting_with_check(),
        CANNOT,
        "OSQP reached",
        solvers=(vx.OSQP(options={"max_iter": 10}),),
    ),
    Case(
        "a solver that is not installed",
        setting_with_check(),
        CANNOT,
        "cvxpy does not find it",
        solvers=(vx.ThroughCvxpy("MOSEKK"),),
    ),
    Case("a solver that fails in the fourth step", setting_with_check(), CANNOT, "step 4", solvers=(Unreliable(),)),
    Case("a solver that accepts no friction", setting_with_check(), CANNOT, "does not accept", solvers=(vx.Direct(),)),
    Case(
        "an accuracy that rounding prevents",
        setting_with_check(),
        CANNOT,
        "but 1.0e-15 was requested",
        solvers=(vx.Clarabel(accuracy=1e-15),),
    ),
    Case("a load that changes in every fourth step only", resting_load, holds=rests),
    Case("friction at its bound at every node, and no slip", all_degenerate),
)
