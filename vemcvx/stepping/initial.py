"""Where a march begins, and the condition (2.1) on it: a(u_0, v) + j(v) >= <l(0), v> for all v.

The condition holds if and only if one step at times[0] from u_prev = u_0 returns u_0. The jump of that step,
in the energy norm, is what a violation costs, and is measured here: u_0 is at most jump + (certified error of that
step) away from a state that obeys (2.1), which is the certificate of step 0. The step maps are nonexpansive, so later
states are off by no more, beside their own errors: it counts in the total.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, shaped
from vemcvx.errors import SceneError
from vemcvx.program.operators import energy_norm
from vemcvx.stepping.acceptance import data_norms, require_certified
from vemcvx.stepping.backward_euler import refined_step, solved
from vemcvx.stepping.ledger import Ledger, StepData, energy, energy_in_full, strain_energy
from vemcvx.stepping.posed_step import pose_step
from vemcvx.stepping.recorder import certified_in_full
from vemcvx.stepping.state import PreparedRun, State

JUMP = 1e-6
"""Initial states whose first step jumps by more, relative to the energy norm, violate (2.1)."""


def initial_state(run: PreparedRun, t: float, initial: ArrayLike | str | None) -> State:
    """The state at the initial instant `t`.

    Raises
    ------
    SceneError
        `initial` is not understood, or the state violates (2.1).
    """
    now = run.driven(t)
    if isinstance(initial, str) and initial == "settled":
        settled = _settle(run, state_given(run, now, np.zeros(run.system.n)))
        if run.check:
            require_certified(run, settled, 0)
        return _beginning(run, settled)
    y = _given(run, now, initial)
    state = state_given(run, now, y)
    if run.system.damping is not None:
        # Where rates cost, a load that nothing balances yet sets the body in motion instead of in place.
        ledger = Ledger.opening(strain_energy(run.system, y, t), run.operators.count)
        return replace(state, ledger=ledger, scale=ledger.norm, full=y)
    settled = _settle(run, state)
    jump = energy_norm(run.system.K, settled.unknowns - y)
    scale = max(state.ledger.norm, energy_norm(run.system.K, now.pushed.x))
    if not jump <= JUMP * scale + settled.certificate.error:
        raise SceneError(_overlap(run, state) or _violation(run, state, jump / scale if scale > 0 else np.inf))
    # How far it may be from a state that obeys (2.1): its jump to the one settled, and the error of that.
    away = settled.certificate.away(jump + settled.certificate.error)
    return _beginning(run, replace(settled, y=state.y, full=y, unbalanced=state.unbalanced, certificate=away))


def settled_from(run: PreparedRun, t: float, y: Floats) -> State:
    """The state after one step at `t` from y (n,): the same one, if (2.1) holds there."""
    return _beginning(run, _settle(run, state_given(run, run.driven(t), y)))


def _given(run: PreparedRun, now: StepData, initial: ArrayLike | str | None) -> Floats:
    n = run.system.n
    if initial is None:
        return np.zeros(n)
    if isinstance(initial, str):
        if initial == "equilibrium":
            if run.system.kernel is not None:
                raise SceneError(
                    "initial: 'equilibrium' is without friction, and nothing but friction holds the body; "
                    "use 'settled' (one step from zero) or a given state."
                )
            return now.force.x
        raise SceneError(
            f"initial: found {initial!r}; there are None (zero), an array, 'equilibrium' (no friction) and "
            "'settled' (one step from zero)."
        )
    wanted = f"{n} finite values, one an unknown"
    y = shaped(initial, "initial", wanted, (n,))
    if not np.isfinite(y).all():
        raise SceneError(
            f"initial: found NaN or infinity in unknown {int(np.argmin(np.isfinite(y)))}; wanted {wanted}."
        )
    return y


def state_given(run: PreparedRun, now: StepData, y: Floats) -> State:
    """The state y (n,), whatever led to it: as far as is known, nothing slipped or pressed."""
    norms, operators = run.system.norms, run.operators
    weights = np.zeros(0) if norms is None else norms.weights(now.t)
    if norms is not None and norms.slip_law is not None:
        weights = norms.weights_under(now.t, np.zeros(len(operators.compliance)))
    y_c = y[run.condensation.retained]
    start = energy(run.condensation, y_c, now, np.zeros(len(operators.compliance)))
    return replace(State.still(operators, now, y_c, weights, start), full=y)


def _settle(run: PreparedRun, state: State) -> State:
    """One step at the same instant, all unknowns and the certificate of the full system included."""
    attempt = pose_step(run, state, state.data, state.weights)
    settled = solved(attempt, 0)
    if run.refines:
        settled = refined_step(attempt, settled, 0)
    return certified_in_full(run, settled)


def _beginning(run: PreparedRun, state: State) -> State:
    """The state as the beginning of a history: nothing has slipped, nothing is lost or done."""
    start = energy(run.condensation, state.y, state.data, state.p)
    if run.refines:
        start = energy_in_full(run.system, state.unknowns, state.t, state.p)
    ledger = Ledger.opening(start, run.operators.count)
    floor, accuracy = state.certificate.error_floor, run.solver.accuracy
    size, noise = data_norms(run.condensation, state.data, ledger.norm, floor, accuracy)
    return replace(state, slip=np.zeros_like(state.slip), ledger=ledger, scale=ledger.norm, size=size, noise=noise)


def _violation(run: PreparedRun, state: State, jump: float) -> str:
    operators, norms = run.operators, run.system.norms
    where = ""
    if norms is not None and operators.count:
        needed = np.linalg.lstsq(operators.B.T.toarray(), state.unbalanced, rcond=None)[0]
        excess = np.linalg.norm(operators.blocks(needed), axis=1) - state.weights
        worst = int(np.argmax(excess))
        if excess[worst] > 0:
            where = (
                f" The worst place is {norms.name(worst)}, where holding still takes a force of "
                f"{excess[worst] + state.weights[worst]:.6g}, {excess[worst]:.6g} over the bound "
                f"{state.weights[worst]:.6g}."
            )
    held = "in equilibrium" if norms is None else "held by friction"
    much = f"by {jump:.1e} of the energy norm, allowed is {JUMP:.0e}" if np.isfinite(jump) else "from rest"
    return (
        f"initial: the state at t = {state.t:.6g} is not {held} (condition (2.1)): one step there moves it {much}."
        f"{where} If something acts from the start, say "
        "initial='settled', in a problem file too: the body begins at rest under it, one step from zero. Or start from "
        "'equilibrium' (no friction), from a given state, or with a load that begins at zero."
    )


def _overlap(run: PreparedRun, state: State) -> str | None:
    """Where a state is beyond a bound, in words; None if it is nowhere."""
    operators, limits = run.operators, run.system.limits
    over = operators.limits.read(state.y) - state.data.remaining_gap
    inside = np.where(operators.compliance > 0, 0.0, over)
    if limits is None or not inside.max(initial=0.0) > 0:
        return None
    worst = int(np.argmax(inside))
    return (
        f"initial: at t = {state.t:.6g} the body is {inside[worst]:.6g} inside its obstacle at {limits.name(worst)}. "
        "Start from initial='settled' (one step from zero), from a given state, or with a gap that begins at zero."
    )
