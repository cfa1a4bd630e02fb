"""The state that a run begins from, and condition (2.1): a(u_0, v) + j(v) >= <l(0), v> for all v.

It holds if and only if one step at times[0] from u_prev = u_0 returns u_0. The jump of that step, in the energy norm,
is what a violation costs, and is measured here: u_0 is at most jump + (certified error of that step) away from a state
that obeys (2.1), which is the certificate of step 0. The step maps are nonexpansive, so later states are off by no
more, beside their own errors: it counts in the total.

P^h u_0, (3.26), is settled by that very step: what obeys (2.1) in the continuum misses it in V^h by O(h), for loads
and friction are integrated by other rules than a(u_0, v): (2.6), l^h(0) = l(0), does not hold for the l^h of Section 3
where a body force acts, which sees the mean of v over vertices. The state begun from obeys it, as (2.13) asks, and is
as near to u_0 as P^h u_0 is, by O(h) in the energy norm; the jump is said.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, shaped
from vemcvx.errors import SceneError
from vemcvx.program.operators import energy_norm
from vemcvx.stepping.fixed_point import refined_step, solved
from vemcvx.stepping.ledger import Ledger, StepData, energy, energy_in_full, strain_energy
from vemcvx.stepping.posed_step import certified_in_full, data_norms, pose_step, require_certified
from vemcvx.stepping.state import PreparedRun, State

log = logging.getLogger("vemcvx")


@dataclass(frozen=True, eq=False)
class Balanced:
    """The state K y = force (n,), from which a body settles by one step; what K does not feel is as in `near` (n,)."""

    force: Floats
    near: Floats


Beginning = ArrayLike | str | Balanced | None
"""None (zero), unknowns (n,), "equilibrium", "settled", or forces to settle from."""

JUMP = 1e-6  # Initial states whose first step jumps by more, relative to the energy norm, violate (2.1).
ROUNDED_LOAD = 1e-12
"""Part of the largest load of a run that an initial state may be out of balance by: sin(2 pi) is rounding, not load."""


def initial_state(run: PreparedRun, instants: Floats, initial: Beginning) -> State:
    """The state at the first of the instants.

    Where what acts there is rounding beside the loads of later instants, that is the state that it settles in.

    SceneError where `initial` is not understood, or the state violates (2.1).
    """
    t = float(instants[0])
    now = run.driven(t)
    if isinstance(initial, Balanced):
        return _from_balanced(run, now, initial)
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
    scale = max(state.ledger.norm, energy_norm(run.system.K, now.force.x))
    if not jump <= JUMP * scale + settled.certificate.error:
        if jump <= ROUNDED_LOAD * max(energy_norm(run.system.K, run.driven(t).force.x) for t in instants.tolist()):
            return _beginning(run, settled)
        raise SceneError(_overlap(run, state) or _violation(run, state, jump / scale if scale > 0 else np.inf))
    # How far it may be from a state that obeys (2.1): its jump to the one settled, and the error of that.
    away = settled.certificate.away(jump + settled.certificate.error)
    return _beginning(run, replace(settled, y=state.y, full=y, unbalanced=state.unbalanced, certificate=away))


FAR = 3.0
"""The jump of P^h u_0 into (2.1), in parts of its distance from the nodal values of u_0, beyond which a warning is due.

Both fall with h where u_0 obeys (2.1), and the jump is .23 to 2.2 of the distance on all families of 1/2 to 1/16, on
manufactured full slip; where it does not, the jump stays, and was 7 to 320 of the distance. FAR_NORM, in parts of the
norm, is for displacements that are linear or nearly so, whose nodal values are P^h u_0."""
FAR_NORM = 0.02


def _from_balanced(run: PreparedRun, now: StepData, initial: Balanced) -> State:
    """The state after one step from a balanced one; that itself where rates cost, which (2.1) does not ask."""
    K = run.system.K
    y = initial.near + run.condensation.reduce(initial.force - K @ initial.near).x
    given = state_given(run, now, y)
    if run.system.damping is not None:
        ledger = Ledger.opening(strain_energy(run.system, y, now.t), run.operators.count)
        return replace(given, ledger=ledger, scale=ledger.norm, full=y)
    settled = _settle(run, given)
    if run.check:
        require_certified(run, settled, 0)
    begun = _beginning(run, settled)
    # A body that nothing holds in P^h u_0 comes to rest, of which nothing but rounding is left.
    begun = replace(begun, size=max(begun.size, given.ledger.norm))
    jump, apart, norm = energy_norm(K, begun.unknowns - y), energy_norm(K, y - initial.near), begun.ledger.norm
    said = f"initial: one step at t = {now.t:.6g} moves P^h u_0 by {jump:.3g} in the energy norm, which is {norm:.3g}"
    if jump > FAR * apart + FAR_NORM * norm:
        log.warning(
            f"{said}: u_0 violates condition (2.1), and the run begins where the body settles. Loads at the first "
            "instant and the friction that holds there are to balance the stresses of u_0."
        )
    else:
        log.info(f"{said}, until condition (2.1) holds on this mesh")
    return begun


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
    weights = np.zeros(0) if norms is None else norms.weights_under(now.t, np.zeros(len(operators.compliance)))
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
        excess = np.linalg.norm(operators.blocks(needed - state.data.bias), axis=1) - state.weights
        worst = int(np.argmax(excess))
        if excess[worst] > 0:
            where = (
                f" The worst place is {norms.name(worst)}, where holding still takes a force of "
                f"{excess[worst] + state.weights[worst]:.6g}, {excess[worst]:.6g} over the bound "
                f"{state.weights[worst]:.6g}."
            )
    held = "in equilibrium" if norms is None else "held by friction"
    of_a_function = (
        " Nodal values of a u_0 that obeys (2.1) miss it on a mesh: give simulate the function, "
        "initial=vx.projected(u_0)."
        if state.unknowns.any()
        else ""
    )
    much = f"by {jump:.1e} of the energy norm, allowed is {JUMP:.0e}" if np.isfinite(jump) else "from rest"
    return (
        f"initial: the state at t = {state.t:.6g} is not {held} (condition (2.1)): one step there moves it {much}."
        f"{where} If something acts from the start, say "
        "initial='settled', in a problem file too: the body begins at rest under it, one step from zero. Or start from "
        f"'equilibrium' (no friction), from a given state, or with a load that begins at zero.{of_a_function}"
    )


def _overlap(run: PreparedRun, state: State) -> str | None:
    """The place where a state violates a bound, in words; None if it is nowhere."""
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
