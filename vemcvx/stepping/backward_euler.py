"""One step of backward Euler, (2.34), in four acts: pose, answer, certify, record.

pose      :mod:`.posed_step`          the convex program of the step, from the state before it and the data at t_n
answer    :mod:`.posed_step`          by the solver, in scaled units; asked again where it misses
          :mod:`.fixed_point`         where weights follow pressures (Coulomb), a fixed point of such programs
certify   :mod:`.posed_step`          on the retained unknowns
          :mod:`.refined_state`       on all, refined against K itself, where the factors are too coarse
record    :mod:`.recorder`            steps that are kept, certified on all unknowns: rows of a trajectory
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.program.step_program import Answer
from vemcvx.stepping.acceptance import require_certified
from vemcvx.stepping.fixed_point import DependentStep, resolved
from vemcvx.stepping.posed_step import PosedStep, pose_step
from vemcvx.stepping.recorder import posed_sharply, refined_state
from vemcvx.stepping.state import PreparedRun, State


class Steps(Protocol):
    """The steps of a run."""

    def posed(self, before: State, n: int, t: float, w: Floats | None = None) -> PosedStep:
        """Step `n` from `before` to `t`; with weights `w` (m,), if they are given."""

    def step(self, before: State, n: int, t: float) -> State:
        """The state at `t`, one step after `before`."""


@dataclass(frozen=True)
class QuasistaticSteps:
    """Steps of a system without damping."""

    run: PreparedRun

    def posed(self, before: State, n: int, t: float, w: Floats | None = None) -> PosedStep:
        """Step `n` from `before` to `t`; with weights `w` (m,), if they are given."""
        return pose_step(self.run, before, self.run.driven(t), w)

    def step(self, before: State, n: int, t: float) -> State:
        """The state at `t`, one step after `before`.

        Raises
        ------
        NotCertified
            The step misses the solver's accuracy, and the run is to be checked.
        """
        run, attempt = self.run, self.posed(before, n, t)
        same = attempt.data.still_as(before.data) and np.array_equal(attempt.program.w, before.weights)
        # A given start may be out of balance by more than a step's accuracy.
        if same and before.accepted(run.accuracy):
            guess = Answer(np.zeros_like(before.y), before.lam, 0, "nothing changed", p=before.p)
            state = attempt.state_after(guess, before.certificate, before.capped_weights)
        else:
            state = solved(attempt, n)
        if run.refines:
            state = refined_step(attempt, state, n)
        if run.check:
            require_certified(run, state, n)
        return state


def refined_step(attempt: PosedStep, state: State, n: int) -> State:
    """The state refined; once more, posed with what the first time has shown to act, if it must be.

    Soft limits give way to what the forces of a program lack. Bounds take it and hold their place, but where weights
    follow pressures these were read before they were refined, and no gap sees that: on springs of 1e-6 of the body's
    modulus they were off by 3e-8 under a certificate of 1e-12.
    """
    run, state = attempt.run, refined_state(attempt, state)
    follows, soft = run.system.follows_answer, bool(run.operators.compliance.any())
    if not follows and (not soft or state.accepted(run.accuracy)):
        return state
    again = posed_sharply(attempt, state)
    return refined_state(again, solved(again, n))


def solved(attempt: PosedStep, n: int) -> State:
    """The step; weights that depend on the answer begin with those it was posed with."""
    norms = attempt.run.system.norms
    if norms is not None and norms.dependent:
        return resolved(DependentStep(attempt, norms, n))
    return attempt.solve_balanced(n)
