"""March through time by backward Euler, (2.34): one certified convex program a step, without and with viscosity.

A step has four acts:

    pose      :mod:`.posed_step`    the convex program of the step, from the state before it and the data at t_n
    answer    :mod:`.posed_step`    by the solver, in scaled units; asked again where it misses
              :mod:`.fixed_point`   where weights follow pressures (Coulomb), a fixed point of such programs
    certify   :mod:`.posed_step`    on the retained unknowns
                                    and on all, refined against K itself, where the factors are too coarse
    record    :mod:`.trajectory`    steps that are kept, certified on all unknowns: rows of a trajectory

It begins from a state that obeys (2.1): :mod:`.beginning`. Why not by the midpoint rule, which is a convex program a
step, too, says problems/midpoint_rule.py: its states at the instants violate (2.1), and where slips begin inside of
steps it is of order one, and no better.

Nodes that supports move along the contact have a given slip: their friction enters no program, but it dissipates. With
c(t) the position of these norm terms, and s = c(t_n) - c(t_{n-1}) their slip,

    multiplier = w s / |s| + bias,    loss = w |s| + bias . s,

which is also work of the supports, whose reactions balance minus the multiplier. Where s = 0 any multiplier up to the
bound is admissible, and 0 is taken. Weights that follow pressures are those of the forces p at the end of the step.

With viscosity, a(u_n, v) + b((u_n - u_{n-1}) / k, v) + ..., the length k of the step does not drop out. In the
increment d, with K_0 of a and K_1 of b, and u_D the motion of the supports (u = P y + u_D),

    (K_0 + K_1 / k) d = load_n - K_0 y_{n-1} - P'A_1 (u_D,n - u_D,n-1) / k - B'lam - D'p:

the program of a step from zero with another K, factorised once a length of step. The ledger gains what dashpots
lose, b(du, du) / k. The certificate bounds the error in the norm of K = K_0 + K_1 / k, which is no less than that
of K_0.

Entries of K lose the rounding of K_0 + K_1 / k, on meshes of equal cells the same one everywhere: that is kept
beside K, and counts as a force out of balance. The rounding floor has three more parts beside that of the program:
the force is known to eps (|load_n| + |K_0||y_{n-1}| + ...); y_n is short of y_{n-1} + d by what their sum loses;
and lengths of steps that differ as the rounding of instants does share a factorisation, that of k'. They leave K_1
d (1/k' - 1/k) out of balance, which because of K_1 / k' <= K' is at most |1 - k'/k| |d|_K' in the norm of K'^{-1}.
"""

from __future__ import annotations

import logging
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.arrays import EPS, Floats, as_real_array, brief, check_takes, flag
from vemcvx.errors import NotContracting, SceneError
from vemcvx.linear import LinearSolver, residual
from vemcvx.linear.default import one_thread
from vemcvx.program.iterative_refinement import rounding
from vemcvx.program.step_program import Answer
from vemcvx.program.system import DRAG_ROUNDING, Damping, System
from vemcvx.program.tolerances import VISCOUS
from vemcvx.solvers import Solver, Solves, as_solver
from vemcvx.stepping.beginning import Beginning, initial_state
from vemcvx.stepping.fixed_point import refined_step, solved
from vemcvx.stepping.ledger import Ledger, Rubbed, StepData, energy_in_full, in_range
from vemcvx.stepping.posed_step import PosedStep, certified_in_full, data_norms, pose_step, require_certified
from vemcvx.stepping.state import Dragged, PreparedRun, State, prepare
from vemcvx.stepping.trajectory import Memory, Recorder, Storage, Trajectory, stored_steps

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
            lam = before.lam - attempt.bias
            guess = Answer(np.zeros_like(before.y), lam, 0, "nothing changed", p=before.p)
            state = attempt.state_after(guess, before.certificate)
        else:
            state = solved(attempt, n)
        if run.refines:
            state = refined_step(attempt, state, n)
        if run.check:
            require_certified(run, state, n)
        return state


class ViscousSteps:
    """Steps of a system with damping; the run is of the system without it."""

    def __init__(self, run: PreparedRun, damping: Damping, instants: Floats):
        self._run, self._damping = run, damping
        self._lengths = shared_lengths(instants)
        self._runs: OrderedDict[float, tuple[PreparedRun, sp.csr_matrix]] = OrderedDict()

    def posed(self, before: State, n: int, t: float, w: Floats | None = None) -> PosedStep:
        """Step `n` from `before` to `t`, as the step from zero that it is; with weights `w` (m,), if they are given."""
        return self._posed(self._at(float(self._lengths[n - 1]))[0], before, t, w)

    def _posed(self, run: PreparedRun, before: State, t: float, w: Floats | None = None) -> PosedStep:
        now = self._drive(run, before.unknowns, before.t, t, t - before.t)
        return pose_step(run, _rest(run, before, now), now, w)

    def step(self, before: State, n: int, t: float) -> State:
        """The state at `t`, one step after `before`, all its unknowns included."""
        accuracy = self._run.solver.accuracy
        state, asked = self._stepped(before, n, t, 1.0)
        if not state.accepted(accuracy) and state.unit(accuracy) < asked:
            # The accuracy asked was relative to the increment's norm in K_0 + K_1 / k; it is meant relative to the
            # state's in K_0. A solver at its rounding floor gives nothing better, or fails.
            with suppress(NotContracting):
                sharper, _ = self._stepped(before, n, t, VISCOUS * state.unit(accuracy) / asked)
                best = min(state, sharper, key=lambda found: found.certificate.gap)
                state = replace(best, iterations=state.iterations + sharper.iterations)
        if self._run.check:
            require_certified(self._run, state, n)
        return state

    def _stepped(self, before: State, n: int, t: float, share: float) -> tuple[State, float]:
        """The state solved to `share` of the accuracy, and the energy norm that this accuracy was relative to."""
        k, shared = t - before.t, float(self._lengths[n - 1])
        (run, lost), y = self._at(shared), before.unknowns
        run = replace(run, share=share)
        stepped = certified_in_full(run, solved(self._posed(run, before, t), n), lost)
        d = stepped.unknowns
        ledger = self._ledger(before, stepped, y=y, d=d, t=t, k=k)
        floor = self._floor(run, stepped, y, before.t, abs(1.0 - shared / k))
        certificate, scale = replace(stepped.certificate, floor=floor), float(np.maximum(before.scale, ledger.norm))
        # The increment alone has energy, the layer at supports that move; the state may have none.
        size, noise = data_norms(run.condensation, stepped.data, scale, certificate.error_floor, run.accuracy)
        state = replace(
            stepped,
            certificate=certificate,
            y=(y + d)[run.condensation.retained],
            full=y + d,
            ledger=ledger,
            scale=scale,
            size=max(before.size, stepped.size, size),
            noise=max(stepped.noise, noise),
            velocity=d / k,
        )
        return state, stepped.unit(run.accuracy)

    def _at(self, k: float) -> tuple[PreparedRun, sp.csr_matrix]:
        """The run for steps of length k, and the rounding error of its stiffness."""
        if k not in self._runs:
            system, rate, shared = self._run.system, self._damping.C, self._run.condensation
            stiffness = sp.csr_matrix(system.K + rate / k)
            exact = system.K.astype(np.longdouble) + rate.astype(np.longdouble) / np.longdouble(k)
            lost = sp.csr_matrix(exact - stiffness.astype(np.longdouble)).astype(float)
            alone = replace(system, K=stiffness, damping=None, motion=None)
            self._runs[k] = prepare(alone, self._run.solver, False, not shared.whole, shared.linear), lost
            if len(self._runs) > 4:  # The longest unused goes; two lengths that take turns need two.
                self._runs.popitem(last=False)
        self._runs.move_to_end(k)
        return self._runs[k]

    def _floor(self, run: PreparedRun, stepped: State, y: Floats, s: float, off: float) -> float:
        """The rounding floor of a step from y at the instant s; `off`: the relative change of a shared length."""
        system, d = self._run.system, stepped.unknowns
        blur = np.abs(system.force(stepped.t)) + abs(system.K) @ np.abs(y)
        moved = self._damping.motion
        if moved is not None:
            blur += (np.abs(moved.dirichlet_force(stepped.t)) + np.abs(moved.dirichlet_force(s))) / (stepped.t - s)
        there = y + d
        cut = (y - (there - (there - y))) + (d - (there - y))
        roots = [
            stepped.certificate.floor,
            rounding(run.condensation, blur),
            0.5 * float(cut @ (run.system.K @ cut)),
            0.5 * off * off * float(d @ (run.system.K @ d)),
        ]
        return float(np.sqrt(roots).sum() ** 2)

    def _drive(self, run: PreparedRun, y: Floats, s: float, t: float, k: float) -> StepData:
        """The data of the increment from the instant s to t."""
        system = self._run.system
        moved = self._damping.motion
        phi = residual(system.force(t), system.K, y, np.zeros(len(y)))
        prescribed_slip = system.prescribed_slip(t) - system.prescribed_slip(s)
        if moved is not None:
            phi -= (moved.dirichlet_force(t) - moved.dirichlet_force(s)) / k
        return StepData(
            t=t,
            # No two of these are alike, and a resumed run does not know those before it.
            force=in_range(run.condensation.reduce(phi, remembered=False), t),
            prescribed_slip=prescribed_slip,
            remaining_gap=system.remaining_gap(t) - system.D @ y,
            bias=system.bias(t),
            ground=system.ground(t),
        )

    def _ledger(self, before: State, stepped: State, y: Floats, d: Floats, t: float, k: float) -> Ledger:
        system, s = self._run.system, before.t
        C, ahead = self._damping.C, y + d
        lost = float(d @ (C @ d)) / k
        work = float(system.force(t) @ d) - float(stepped.p @ (system.remaining_gap(t) - system.remaining_gap(s)))
        motion = system.motion
        if motion is not None:
            change = motion.dirichlet_force(t) - motion.dirichlet_force(s)
            work += float(motion.dirichlet_force(t) @ d + ahead @ change) + motion.stored(t, t) - motion.stored(s, t)
        work += float(stepped.lam.ravel() @ stepped.data.prescribed_slip)
        moved = self._damping.motion
        if moved is not None:
            across = float(d @ (moved.dirichlet_force(t) - moved.dirichlet_force(s))) / k
            own = (moved.stored(t, t) - 2 * moved.stored(s, t) + moved.stored(s, s)) / k
            lost, work = lost + 2 * across + own, work + across + own
        past, rubbed = before.ledger, stepped.ledger
        # With the mean rate of the step that loss is of second order.
        between = past.dissipated_second_order + rubbed.dissipated_second_order
        return Ledger(
            energy=energy_in_full(system, ahead, t, stepped.p),
            dissipated=past.dissipated + rubbed.dissipated + lost,
            work=past.work + work,
            worn=past.worn + rubbed.worn,
            slipped=rubbed.slipped,
            dissipated_second_order=between + lost,
            worn_second_order=past.worn_second_order + rubbed.worn_second_order,
        )


def shared_lengths(instants: Floats) -> Floats:
    """(N,) the lengths of the steps; those that differ by what the rounding of instants explains are made equal.

    Lengths that differ by more than 1e-11 of themselves never are, so that errors stay far below accuracies.
    """
    lengths = np.diff(instants)
    order = np.argsort(lengths, kind="stable")
    blur, shared, least = 2 * EPS * np.abs(instants).max(), lengths.copy(), 0.0
    for n in order:
        least = lengths[n] if lengths[n] > least + min(blur, 1e-11 * least) else least
        shared[n] = least
    return shared


def _rest(run: PreparedRun, before: State, now: StepData) -> State:
    """Nothing has moved yet: where the increment begins."""
    zero, none = now.force - now.force, np.zeros_like(now.remaining_gap)
    slip = np.zeros_like(now.prescribed_slip)
    data = replace(now, t=before.t, force=zero, prescribed_slip=slip, remaining_gap=none, ground=None)
    data = replace(data, bias=before.data.bias)
    rest = State.still(run.operators, data, np.zeros(len(run.condensation.retained)), before.weights)
    return replace(
        rest,
        lam=before.lam,
        ledger=replace(rest.ledger, slipped=before.ledger.slipped),
        scale=before.scale,
        size=before.size,
        dragged=before.dragged,
    )


Steps = QuasistaticSteps | ViscousSteps


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
    biases = np.zeros_like(slip), np.zeros_like(slip)
    if terms.bias is not None:
        biases = terms.bias(before.t).reshape(slip.shape), terms.bias(state.t).reshape(slip.shape)
        lam = lam + np.where(still, 0.0, 1.0)[:, None] * biases[1]
    last_ones = before.dragged
    rubbed = Rubbed(lam, along, (last_ones.weights, weights), biases)
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
    run: PreparedRun, steps: Steps, instants: Floats, begin: int, state: State
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
    """One thread for BLAS within, unless the steps' own matrices are large and dense."""
    unknowns = len(system.retained) if condense else system.n
    return one_thread(unknowns if linear.eliminates else 0, linear.cores)


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
        raise SceneError(
            f"linear: found {brief(linear)}; wanted SuperLU(), Pardiso(), Multigrid(), PETSc(), or None (chosen)."
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
