"""March through time: one certified convex program a step, (2.34), from an initial state that obeys (2.1).

The initial state is to obey a(u_0, v) + j(v) >= <l(0), v> for all v, which holds if and only if one step at times[0]
from u_prev = u_0 returns u_0. The jump of that step, in the energy norm, is what a violation costs, and is measured
here: u_0 is at most jump + (certified error of that step) away from a state that obeys (2.1), which is the certificate
of step 0. The step maps are nonexpansive, so later states are off by no more, beside their own errors: it counts in the
total. What one step is stands in :mod:`vemcvx.stepping.backward_euler`.

Friction on what supports drag along has a given slip, so it enters no program, and yet rubs. With c(t) where supports
have the norm terms that no unknown moves, and s = c(t_n) - c(t_{n-1}) their slip,

    multiplier = w s / |s| + bias,    loss = w |s| + bias . s,

which is work of the supports, too: their reactions pull against minus the multiplier. Where s = 0, any multiplier up to
the bound would do, and 0 is taken. Weights under pressure are those of the forces p that end the step.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, as_real_array, brief, check_takes, flag, shaped
from vemcvx.errors import SceneError
from vemcvx.linear import LinearSolver
from vemcvx.linear.default import one_thread
from vemcvx.program.operators import energy_norm
from vemcvx.program.system import DRAG_ROUNDING, System
from vemcvx.solvers import Solver, Solves, as_solver
from vemcvx.stepping.backward_euler import QuasistaticSteps, Steps, ViscousSteps, refined_step, solved
from vemcvx.stepping.ledger import Ledger, StepData, energy, energy_in_full, strain_energy
from vemcvx.stepping.posed_step import data_norms, pose_step, require_certified
from vemcvx.stepping.recorder import Recorder, certified_in_full, stored_steps
from vemcvx.stepping.state import Dragged, PreparedRun, State, prepare
from vemcvx.stepping.trajectory import Memory, Storage, Trajectory


def nothing_dragged(system: System, t: float, p: Floats) -> Dragged:
    """Nothing has been dragged yet."""
    terms = system.dragged
    if terms is None:
        return Dragged.nothing(0, 1 if system.norms is None else system.norms.block)
    none = np.zeros(terms.count)
    return replace(Dragged.nothing(terms.count, terms.block), weights=terms.weights(t, p, none, none))


def with_dragged_friction(system: System, before: State, state: State) -> State:
    """The state with the friction of what supports dragged along since `before`: a loss, and work of the supports."""
    terms = system.dragged
    if terms is None:
        return state
    last, now = terms.position(before.t), terms.position(state.t)
    slip = (now - last).reshape(terms.count, terms.block)
    size = np.linalg.norm(slip, axis=1)
    extent = np.maximum(np.abs(last), np.abs(now)).reshape(slip.shape).max(axis=1)
    still = size <= DRAG_ROUNDING * extent
    past, size = before.dragged.slipped, np.where(still, 0.0, size)
    weights, along = terms.weights(state.t, state.p, past, size), np.where(still, 0.0, 1.0)[:, None] * slip
    lam = along * np.divide(weights, size, out=np.zeros_like(size), where=~still)[:, None]
    if terms.bias is not None:
        lam = lam + np.where(still, 0.0, 1.0)[:, None] * terms.bias(state.t).reshape(slip.shape)
    lost = np.einsum("qb,qb->q", lam, along)
    ledger, total = state.ledger, float(lost.sum())
    ledger = replace(ledger, dissipated=ledger.dissipated + total, work=ledger.work + total)
    return replace(state, ledger=ledger, dragged=Dragged(weights, lam, still, before.dragged.worn + lost, past + size))


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
    scale = max(state.ledger.norm, energy_norm(run.system.K, now.force.x))
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
        excess = np.linalg.norm(operators.blocks(needed - state.data.bias), axis=1) - state.weights
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


def march(
    system: System,
    times: ArrayLike,
    *,
    solver: Solver | Solves | None = None,
    initial: ArrayLike | str | None = None,
    store: str | int | Sequence[int] = "all",
    check: bool = True,
    condense: bool = True,
    linear: LinearSolver | None = None,
    progress: Callable[[int, int], None] | None = None,
    storage: Storage | None = None,
) -> Trajectory:
    """March a System through time by backward Euler.

    Parameters
    ----------
    system : System
    times : increasing sequence of N + 1 instants
        times[0] is the initial one.
    solver : Solver, or object with solve(program, target), optional
        By default the smallest that accepts the program.
    initial : None, (n,) array, "equilibrium" or "settled"
        Zero; a given state; K y = load(t_0), without friction; or one step from zero at t_0.
    store : "all", "last", int or sequence of int
        Which states to keep: every one, the last, every so many and the last, or those of these steps and the last.
    check, condense, linear : as of :func:`vemcvx.simulate`
    progress : callable (step, steps), optional
    storage : Storage, optional
        Where rows are kept; a Folder that holds an interrupted run of the same system is gone on with.

    Raises
    ------
    SceneError
        The times do not increase, or the initial state violates (2.1).
    NotAccepted
        The solver cannot take the program.
    NotCertified
        A step misses the accuracy asked for.
    """
    check_kinds(system, solver, linear, progress)
    check, condense = flag(check, "check"), flag(condense, "condense")
    if storage is not None and not isinstance(storage, Storage):
        raise SceneError(f"march: found storage = {brief(storage)}; wanted Memory(), Folder(path), or None.")
    instants = checked_times(times)
    system = system.faded(instants.tolist())
    kept = stored_steps(store, len(instants) - 1)
    start = time.perf_counter()
    linear = system.linear(linear)
    with threads_of_steps(system, condense, linear):
        run = prepare(system, solver, check, condense, linear)
        prepared = time.perf_counter()
        recorder = Recorder(run, instants, kept, storage or Memory(), initial)
        earlier = recorder.begin()
        if earlier is None:
            earlier = 0, first_state(run, float(instants[0]), initial)
            recorder.add(*earlier)
        for n, state in states_of(run, steps_of(run, instants), instants, *earlier):
            recorder.add(n, state)
            if progress is not None:
                progress(n, len(instants) - 1)
        seconds = {"prepare": prepared - start, "solve": time.perf_counter() - prepared}
        return recorder.finish(seconds)


def states_of(
    run: PreparedRun, steps: Steps, instants: Floats, begin: int, state: State
) -> Iterator[tuple[int, State]]:
    """Yield the number of each step after the step `begin`, which ended in `state`, and the state that it leads to."""
    if run.system.damping is not None:
        state = certified_in_full(run, state)
    for n in range(begin + 1, len(instants)):
        state = with_dragged_friction(run.system, state, steps.step(state, n, float(instants[n])))
        yield n, state


def first_state(run: PreparedRun, t: float, initial: ArrayLike | str | None) -> State:
    """The initial state at `t`, with the friction of what supports will drag along."""
    first = initial_state(run, t, initial)
    return replace(first, dragged=nothing_dragged(run.system, t, first.p))


def threads_of_steps(system: System, condense: bool, linear: LinearSolver) -> AbstractContextManager[None]:
    """One thread for BLAS within, unless the steps' own matrices are large and dense."""
    unknowns = len(system.retained) if condense else system.n
    return one_thread(unknowns if linear.eliminates else 0)


def steps_of(run: PreparedRun, instants: Floats) -> Steps:
    """The steps of a run, viscous or not."""
    damping = run.system.damping
    return QuasistaticSteps(run) if damping is None else ViscousSteps(run, damping, instants)


def check_kinds(
    system: System, solver: Solver | Solves | None, linear: LinearSolver | None, progress: object = None
) -> None:
    """Raise SceneError for what is no system, no solver, no linear solver or no function."""
    if not isinstance(system, System):
        raise SceneError(f"march: found {brief(system)} where the System goes; simulate() takes a scene and a mesh.")
    if solver is not None:
        as_solver(solver).check_accuracy()
    if linear is not None and not isinstance(linear, LinearSolver):
        raise SceneError(f"linear: found {brief(linear)}; wanted SuperLU(), Pardiso(), Multigrid(), or None (chosen).")
    if progress is not None and not callable(progress):
        raise SceneError(f"progress: found {brief(progress)}; wanted a function of (step, steps).")
    check_takes(progress, 2, "progress", "(step, steps)")


def checked_times(times: ArrayLike) -> Floats:
    """The instants as an increasing array of at least one."""
    wanted = "an increasing sequence of finite instants, such as np.linspace(0, 1, 65)"
    t = as_real_array(times, "times", wanted)
    if t.ndim != 1 or len(t) == 0 or not np.isfinite(t).all():
        raise SceneError(f"times: found {brief(times)}; wanted {wanted}.")
    back = np.flatnonzero(np.diff(t) <= 0)
    if len(back):
        n = int(back[0])
        raise SceneError(
            f"times: instant {n + 1} is {t[n + 1]:.17g}, which does not come after instant {n}, {t[n]:.17g}; "
            "times must increase strictly."
        )
    return t
