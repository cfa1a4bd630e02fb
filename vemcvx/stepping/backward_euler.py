"""March through time by backward Euler, (2.34): one certified convex program a step (with viscosity: :mod:`.viscous`).

A step has four acts:

    pose      :mod:`.posed_step`    the convex program of the step, from the state before it and the data at t_n
    answer    :mod:`.posed_step`    by the solver, in scaled units; asked again where it misses
              :mod:`.fixed_point`   where weights follow pressure or slip, by solvers that take given weights alone
    certify   :mod:`.posed_step`    on the retained unknowns
    record    :mod:`.trajectory`    steps that are kept, certified on all unknowns: rows of a trajectory

Why not by the midpoint rule, which is a convex program a step, too, says problems/midpoint_rule.py: its states at the
instants violate (2.1), and where slips begin inside of steps it is of order one, and no better.

Nodes that supports move along the contact have a given slip: their friction enters no program, but it dissipates. With
c(t) the position of these norm terms, and s = c(t_n) - c(t_{n-1}) their slip,

    multiplier = w s / |s|,    loss = w |s|,

which is also work of the supports, whose reactions balance minus the multiplier. Where s = 0 any multiplier up to the
bound is admissible, and 0 is taken. Weights that follow pressures are those of the forces p at the end of the step.

It begins from a state u_0 that obeys condition (2.1): a(u_0, v) + j(v) >= <l(0), v> for all v.

That holds if and only if one step at times[0] from u_prev = u_0 returns u_0. The jump of that step, in the energy norm,
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
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import ROUNDING, Floats, as_real_array, brief, check_takes, flag, shaped
from vemcvx.base.errors import WORTH_A_WORD, SceneError
from vemcvx.linear import LinearSolver
from vemcvx.linear.default import one_thread
from vemcvx.program.operators import energy_norm
from vemcvx.program.step_program import Answer
from vemcvx.program.system import DRAG_ROUNDING, System
from vemcvx.solvers import Solver, Solves, as_solver
from vemcvx.stepping.ledger import Ledger, Rubbed, StepData, energy, strain_energy
from vemcvx.stepping.posed_step import PosedStep, certified_in_full, data_norm, pose_step, require_certified
from vemcvx.stepping.state import Dragged, PreparedRun, State, prepare
from vemcvx.stepping.trajectory import Memory, Recorder, Storage, Trajectory, stored_steps
from vemcvx.stepping.viscous import ViscousSteps

log = logging.getLogger("vemcvx")


@dataclass(frozen=True)
class QuasistaticSteps:
    """Steps of a system without damping."""

    run: PreparedRun

    def posed(self, before: State, n: int, t: float, w: Floats | None = None) -> PosedStep:
        """Step `n` from `before` to `t`; with weights `w` (m,), if they are given."""
        return pose_step(self.run, before, self.run.driven(t), w)

    def step(self, before: State, n: int, t: float) -> State:
        """The state at `t`, one step after `before`.

        NotCertified where the step misses the solver's accuracy, and the run is to be checked.
        """
        run, attempt = self.run, self.posed(before, n, t)
        same = attempt.data.still_as(before.data) and np.array_equal(attempt.program.w, before.weights)
        # A given start may be out of balance by more than a step's accuracy.
        if same and before.accepted(run.accuracy):
            guess = Answer(np.zeros_like(before.y), before.lam, 0, "nothing changed", p=before.p)
            state = attempt.state_after(guess, before.certificate)
        else:
            state = attempt.solve_balanced(n)
        if run.check:
            require_certified(run, state, n)
        return state


def nothing_dragged(system: System, t: float, p: Floats) -> Dragged:
    """The friction of dragged terms before the first step: no slip, no loss."""
    terms = system.dragged
    if terms is None:
        return Dragged.nothing(0, system.block)
    none = np.zeros(terms.count)
    return replace(Dragged.nothing(terms.count, terms.block), weights=terms.weights(t, p, none, none))


def with_dragged_friction(system: System, before: State, state: State) -> State:
    """The state with the friction of terms that supports dragged since `before`: a loss, and work of the supports."""
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
    last_ones = before.dragged
    rubbed = Rubbed(lam, along, weights, (last_ones.weights, weights))
    worn, between = last_ones.worn + rubbed.loss, last_ones.worn_second_order + rubbed.loss_second_order
    ledger, total = state.ledger, float(rubbed.loss.sum())
    ledger = replace(
        ledger,
        dissipated=ledger.dissipated + total,
        work=ledger.work + total,
        dissipated_second_order=ledger.dissipated_second_order + float(rubbed.loss_second_order.sum()),
    )
    dragged = Dragged(weights, lam, still, worn=worn, worn_second_order=between, slipped=past + size)
    return replace(state, ledger=ledger, dragged=dragged)


def march(
    system: System,
    times: ArrayLike,
    *,
    solver: Solver | Solves | None = None,
    initial: Beginning = None,
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
    initial : None, (n,) array, "equilibrium", "settled" or Balanced
        Zero; a given state; K y = load(t_0), without friction; or one step from zero at t_0.
    store : "all", "last", int or sequence of int
        Which states to keep: every one, the last, every so many and the last, or those of these steps and the last.
    check, condense, linear : as of :func:`vemcvx.simulate`
    progress : callable (step, steps), optional
    storage : Storage, optional
        Where rows are kept; an interrupted run of the same system in a Folder is continued.

    Raises
    ------
    SceneError
        The times do not increase, the initial state violates (2.1), or rigid limits contradict each other.
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
        recorder = Recorder(run, instants, kept, storage or Memory())
        earlier = recorder.begin()
        if earlier is None:
            earlier = 0, first_state(run, instants, initial)
            recorder.add(*earlier)
        try:
            for n, state in states_of(run, steps_of(run, instants), instants, *earlier):
                recorder.add(n, state)
                if progress is not None:
                    progress(n, len(instants) - 1)
        finally:
            recorder.enter_waiting()
        seconds = {"prepare": prepared - start, "solve": time.perf_counter() - prepared}
        return recorder.finish(seconds)


def states_of(
    run: PreparedRun, steps: QuasistaticSteps | ViscousSteps, instants: Floats, begin: int, state: State
) -> Iterator[tuple[int, State]]:
    """Yield the number of each step after the step `begin`, which ended in `state`, and the state that it leads to."""
    if run.system.damping is not None:
        state = certified_in_full(run, state)
    for n in range(begin + 1, len(instants)):
        state = with_dragged_friction(run.system, state, steps.step(state, n, float(instants[n])))
        yield n, state


def first_state(run: PreparedRun, instants: Floats, initial: Beginning) -> State:
    """The initial state at the first of the instants, with the friction of what supports will drag along."""
    first = initial_state(run, instants, initial)
    return replace(first, dragged=nothing_dragged(run.system, first.t, first.p))


def threads_of_steps(system: System, condense: bool, linear: LinearSolver) -> AbstractContextManager[None]:
    """Keep BLAS to one thread within, unless the steps' own matrices are large and dense."""
    unknowns = len(system.retained) if condense else system.n
    return one_thread(unknowns if linear.eliminates else 0)


def steps_of(run: PreparedRun, instants: Floats) -> QuasistaticSteps | ViscousSteps:
    """The steps of a run, viscous or not."""
    damping = run.system.damping
    return QuasistaticSteps(run) if damping is None else ViscousSteps(run, damping)


def check_kinds(
    system: System, solver: Solver | Solves | None, linear: LinearSolver | None, progress: object = None
) -> None:
    """Raise SceneError for what is no system, no solver, no linear solver or no function."""
    if not isinstance(system, System):
        raise SceneError(f"march: found {brief(system)} where the System goes; simulate() takes a scene and a mesh.")
    if solver is not None:
        as_solver(solver).check_accuracy()
    if linear is not None and not isinstance(linear, LinearSolver):
        raise SceneError(
            f"linear: found {brief(linear)}; wanted SuperLU(), Pardiso(), Iterative(), PETSc(), or None (chosen)."
        )
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


log = logging.getLogger("vemcvx")


@dataclass(frozen=True, eq=False)
class Balanced:
    """The state K y = force (n,), from which a body settles by one step; what K does not feel is as in `near` (n,)."""

    force: Floats
    near: Floats


Beginning = ArrayLike | str | Balanced | None
"""None (zero), unknowns (n,), "equilibrium", "settled", or forces to settle from."""

JUMP = 1e-6  # Initial states whose first step jumps by more, relative to the energy norm, violate (2.1).


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
        if jump <= ROUNDING * max(energy_norm(run.system.K, run.driven(t).force.x) for t in instants.tolist()):
            return _beginning(run, settled)
        raise SceneError(_overlap(run, state) or _violation(run, state, jump / scale if scale > 0 else np.inf))
    # How far it may be from a state that obeys (2.1): its jump to the one settled, and the error of that.
    away = settled.certificate.away(jump + settled.certificate.error)
    return _beginning(run, replace(settled, y=state.y, full=y, unbalanced=state.unbalanced, certificate=away))


FAR = 3.0
"""The jump of P^h u_0 into (2.1), in parts of its distance from the nodal values of u_0, beyond which a warning is due.

Both fall with h where u_0 obeys (2.1), and the jump is .23 to 2.2 of the distance on all families of 1/2 to 1/16, on
manufactured full slip; where it does not, the jump stays, and was 7 to 320 of the distance. The part of the norm beside
it is for displacements that are linear or nearly so, whose nodal values are P^h u_0."""


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
    if jump > FAR * apart + WORTH_A_WORD * norm:
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
    """Take one step at the same instant, with all unknowns and the certificate of the full system."""
    attempt = pose_step(run, state, state.data, state.weights)
    settled = attempt.solve_balanced(0)
    return certified_in_full(run, settled)


def _beginning(run: PreparedRun, state: State) -> State:
    """The state as the beginning of a history: nothing has slipped, nothing is lost or done."""
    start = energy(run.condensation, state.y, state.data, state.p)
    ledger = Ledger.opening(start, run.operators.count)
    size = data_norm(run.condensation, state.data.force, ledger.norm, run.solver.accuracy)
    return replace(state, slip=np.zeros_like(state.slip), ledger=ledger, scale=ledger.norm, size=size)


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
