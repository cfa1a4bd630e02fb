"""One step of backward Euler, (2.34), in four acts: pose, answer, certify, record.

pose      :mod:`.posed_step`          the convex program of the step, from the state before it and the data at t_n
answer    :mod:`.posed_step`          by the solver, in scaled units; asked again where it misses
          :mod:`.fixed_point`         where weights follow pressures (Coulomb), a fixed point of such programs
certify   :mod:`.certified_in_full`   on all unknowns, where the step is kept or the factors are too coarse
record    :mod:`.recorder`            energies, forces, certificates: rows of a trajectory
"""

from __future__ import annotations

from functools import partial

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.program.step_program import Answer
from vemcvx.program.system import Norms
from vemcvx.stepping.certified_in_full import refined_state
from vemcvx.stepping.fixed_point import Dependent, resolved
from vemcvx.stepping.ledger import StepData, drive
from vemcvx.stepping.posed_step import PosedStep, pose_step, refuse_unheld
from vemcvx.stepping.state import PreparedRun, State


def step(run: PreparedRun, before: State, n: int, t: float) -> State:
    """The state at `t`, one step after `before`.

    Raises
    ------
    NotCertified
        The step misses the solver's accuracy, and the run is to be checked.
    """
    now = drive(run.system, run.condensation, t)
    norms = run.system.norms
    weights = np.zeros(0) if norms is None else norms.weights_under(t, before.p)
    attempt = pose_step(run, before, now, weights)
    same = now.still_as(before.data) and np.array_equal(weights, before.weights)
    # A given start may be out of balance by more than a step's accuracy.
    if same and before.accepted(run.accuracy):
        guess = Answer(np.zeros_like(before.y), before.lam, 0, "nothing changed", p=before.p)
        state = attempt.state_after(guess, before.certificate, before.capped_weights)
    else:
        state = solved(run, before, now, weights, n)
    if run.refines:
        state = refined_state(attempt, state)
    if run.check:
        run.require_certified(state, n)
    return state


def solved(run: PreparedRun, before: State, now: StepData, weights: Floats, n: int) -> State:
    """The step to what drives the system now; `weights` (m,) are those to begin with, if they depend on the answer."""
    norms, attempt = run.system.norms, pose_step(run, before, now, weights)
    if norms is not None and norms.law is not None:
        return _under_pressure(run, before, now, norms=norms, weights=weights, n=n)
    refuse_unheld(attempt, n)
    return attempt.solve()


def _under_pressure(run: PreparedRun, before: State, now: StepData, norms: Norms, weights: Floats, n: int) -> State:
    """The step where weights depend on the forces of the limits."""

    def pose(run: PreparedRun, w: Floats) -> PosedStep:
        return pose_step(run, before, now, w)

    # Where nothing else holds the body, friction of yesterday's pressures may not: begin with no end of it.
    free = run.operators.kernel is not None
    start = np.full(len(weights), np.abs(pose(run, weights).program.g).sum()) if free else weights
    step = Dependent(run=run, norms=norms, t=now.t, n=n, pose=pose, check=partial(refuse_unheld, n=n))
    return resolved(step, start)
