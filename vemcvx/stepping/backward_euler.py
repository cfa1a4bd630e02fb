"""Backward Euler, (2.34) of the paper: one certified convex program per step.

Step n has the unknown d_n = y_n - y_{n-1} and the force g_n = load_n - K y_{n-1} with the stiffness matrix K. To keep
the digits of tiny increments, we compute g_{n+1} = (g_n - K d_n) + (load_{n+1} - load_n).

Let u = P y + u_D be the displacements. The supports prescribe u_D. Dashpots add a form b(u', v) to the elastic form
a(u, v). The form b has the matrix A_b in displacements u, and C = P'A_b P in unknowns y. In a step of length k, K + C/k
replaces K, and moving supports add the force -P'A_b (u_D,n - u_D,n-1) / k.

Errors are relative to `scale`, the largest energy norm of the states so far. If `scale` is tiny, errors are relative to
`size`, the largest energy norm that data could cause. A load f could cause the norm |K^{-1}f|_K.

The initial state u_0 must obey condition (2.1): a step of length zero from u_0 ends at u_0. If the step jumps away, the
certificate of step 0 is the norm of the jump plus the error of the step. This sum bounds the distance from u_0 to a
state that obeys (2.1).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import (
    EPS,
    ROUNDING,
    Bools,
    Floats,
    Ints,
    as_real_array,
    as_shaped_array,
    brief,
    check_takes,
    finite,
    flag,
    lengths,
)
from vemcvx.base.errors import WARNING_FRACTION, SceneError, SolverFailed
from vemcvx.linear import LinearSolver
from vemcvx.linear.default import one_thread
from vemcvx.program.certificate import Certificate
from vemcvx.program.condensation import Condensation
from vemcvx.program.operators import Operators, energy_norm
from vemcvx.program.step_program import Answer, StepProgram, has_diverged
from vemcvx.program.system import System
from vemcvx.solvers import Solver, Solves, as_solver, choose_solver
from vemcvx.solvers.law import Weights
from vemcvx.solvers.solver import INNER_FRACTION, name_failures
from vemcvx.stepping.refusals import (
    refuse_floating_rates,
    refuse_start,
    refuse_unbalanced,
    require_certified,
    warn_of_softening,
)
from vemcvx.stepping.state import (
    SMALLEST_NORM,
    Frame,
    Ledger,
    PreparedRun,
    State,
    StepData,
    advance,
    certify_in_full,
    check_norm,
    energy,
    evaluate_dragged,
    make_given_state,
)
from vemcvx.stepping.trajectory import Memory, Recorder, Storage, Trajectory, choose_stored_steps

log = logging.getLogger("vemcvx")


@dataclass(frozen=True, eq=False)
class PosedStep:
    """A step and its convex program."""

    run: PreparedRun
    before: State
    data: StepData
    frame: Frame
    program: StepProgram

    def solve(self, n: int) -> State:
        """Return the certified state after step `n`."""
        when = f"step {n} at t = {self.data.t:.6g}"
        try:
            state = self._at_rest() or self._solve()
        except SolverFailed:
            refuse_unbalanced(self.frame.condensation, self.program, when)
            raise
        if not np.isfinite(state.certificate.gap):
            refuse_unbalanced(self.frame.condensation, self.program, when)
        return state

    def _at_rest(self) -> State | None:
        program, before, accuracy = self.program, self.before, self.run.solver.accuracy
        if not program.size <= min(SMALLEST_NORM, accuracy * before.unit(accuracy)):
            return None
        d, lam, p = np.zeros_like(program.g), np.zeros_like(before.lam[: len(program.w)]), np.zeros_like(before.p)
        floor = program.rounding_floor(d, lam, p, before.y)
        certificate = Certificate(0.0, np.zeros(len(lam)), floor, p)
        return self.state_after(Answer(d, lam, 0, "nothing pushes", p=p), certificate)

    def _solve(self) -> State:
        size, accuracy = check_norm(self.program.size, self.data.t), self.run.solver.accuracy
        size = max(self.before.unit(accuracy), size)
        state = self._certify(self.frame.prepared.solve, 0.5 * (accuracy * size) ** 2)
        if state.certificate.error <= accuracy * state.unit(accuracy) or state.certificate.at_floor:
            return state
        sharper = 0.5 * (INNER_FRACTION * accuracy * min(size, state.unit(accuracy))) ** 2
        other = self._certify(self.frame.prepared.retry, sharper)
        best = min((state, other), key=lambda one: one.certificate.gap)
        return replace(best, iterations=state.iterations + other.iterations)

    def _certify(self, solve: Callable[..., Answer], gap: float) -> State:
        program, law = self.program, self.law
        guess = self.before.predict_multipliers(self.data.t, len(program.w))
        with name_failures(self.run.solver.name):
            answer = solve(program, gap, *guess, *([] if law is None else [law]))
            if has_diverged(answer.d):
                raise SolverFailed(f"{self.run.solver.name}: its answer diverged: friction does not hold the body.")
            if law is not None:
                slip = lengths(program.slip(program.feasible(answer.d)))
                law.check_slip(answer.p, slip)
                program = replace(program, w=law.at(answer.p, slip))
        d, lam, p = program.admissible_point(answer.d, answer.lam, answer.p)
        certificate = program.certificate_at(d, lam, p, self.before.y)
        certificate = replace(certificate, given_friction=law is not None and not law.is_monotone)
        return replace(self, program=program).state_after(replace(answer, d=d, lam=lam, p=p), certificate)

    @property
    def law(self) -> Weights | None:
        """The law of the weights in this step, or None."""
        norms = self.run.system.norms
        if norms is None or norms.law is None:
            return None
        past, k = self.before.ledger.slipped[: norms.count], self.data.t - self.before.t
        return Weights(self.program.w, norms, t=self.data.t, past=past, k=k)

    def state_after(self, answer: Answer, certificate: Certificate) -> State:
        """Return the state after the step, for an answer of the program."""
        run, before, now, program, k = self.run, self.before, self.data, self.program, self.data.t - self.before.t
        d, slip, m = answer.d, program.slip(answer.d), len(program.w)
        lam, slid, w = evaluate_dragged(run.system, (before.t, now.t), answer.p, before.ledger.slipped[m:])
        given = program.operators.blocks(now.prescribed_slip - before.data.prescribed_slip)
        weights, norms, y = np.append(program.w, w), run.system.norms, before.y + d
        bound = program.w
        if norms is not None and norms.rule.slips and not norms.rule.rates:
            bound = norms.weights_under(now.t, answer.p, before.ledger.slipped[:m] + lengths(slip))
        after = State(
            t=now.t,
            y=y,
            unbalanced=before.unbalanced + (now.force.retained - before.data.force.retained) - run.operators.force(d),
            data=now,
            weights=weights,
            bound=np.append(bound, w),
            lam=np.concatenate([answer.lam, lam]),
            p=answer.p,
            slip=np.concatenate([slip, slid]),
            sticks=np.append(self._sticking(slip, y, certificate), ~slid.any(axis=1)),
            certificate=certificate,
            ledger=before.ledger,
            scale=before.scale,
            iterations=answer.iterations,
            status=answer.status,
            full=y if run.condensation.whole else None,
            velocity=d / k if run.system.damping is not None and k > 0 else None,
            earlier=(before.t, before.lam, before.p),
        )
        ledger = advance(run.condensation, before, after, d, np.concatenate([given, slid]))
        scale = float(np.maximum(before.scale, ledger.norm))
        size = max(before.size, now.force.norm, ground_norm(program.operators, now.ground, program.w))
        return replace(after, ledger=ledger, scale=scale, size=size)

    def _sticking(self, slip: Floats, y: Floats, certificate: Certificate) -> Bools:
        """Return a mask (m,) of the terms whose exact slip may be zero."""
        operators = self.program.operators
        if operators.count == 0:
            return np.zeros(0, dtype=bool)
        rounding = EPS * (self.run.operators.absolute[1] @ np.abs(y))[: operators.B.shape[0]].reshape(
            -1, operators.block
        )
        error = certificate.error + certificate.error_floor
        sticks: Bools = lengths(slip) <= error * np.sqrt(operators.norm_flexibility) + rounding.max(axis=1)
        return sticks


def pose_step(run: PreparedRun, before: State, now: StepData, w: Floats | None = None) -> PosedStep:
    """Pose the step from `before` to `now`, by default with weights at the pressures of `before`."""
    norms, damping, k = run.system.norms, run.system.damping, now.t - before.t
    if w is None:
        m = run.operators.count
        w = np.zeros(0) if norms is None else norms.weights_under(now.t, before.p, before.ledger.slipped[:m])
    frame = run.frame(k)
    g = before.unbalanced + (now.force.retained - before.data.force.retained)
    if run.system.kernel is not None:  # K y does no work in motions of the kernel
        g = run.condensation.balance(g, now.force.phi)
    if damping is not None and damping.motion is not None and k > 0:
        g = g - (damping.motion.dirichlet_force(now.t) - damping.motion.dirichlet_force(before.t)) / k
    e = now.remaining_gap - run.operators.D @ before.y
    if run.system.limits is not None:
        e = np.where(run.system.limits.rates, now.remaining_gap - before.data.remaining_gap, e)
    b = before.data.prescribed_slip - now.prescribed_slip
    return PosedStep(run, before, now, frame, StepProgram(frame.condensation.operators, g, w, b, e))


def ground_norm(operators: Operators, ground: Floats | None, w: Floats) -> float:
    """Return the largest energy norm that motions of the ground can cause."""
    if ground is None:
        return 0.0
    root, motion = np.sqrt(operators.norm_flexibility), lengths(operators.blocks(ground))
    # Rows of zeros have the flexibility 0.
    far = np.divide(motion, root, out=np.where(motion > 0, np.inf, 0.0), where=root > 0)
    return float(min(far.max(initial=0.0), w @ root))


def step(run: PreparedRun, before: State, n: int, t: float) -> State:
    """Return the state after step `n`, at the instant `t`."""
    state = pose_step(run, before, StepData.evaluate(run.condensation, t)).solve(n)
    if run.check:
        require_certified(run, state, n)
    return state


def prepare(
    system: System,
    solver: Solver | Solves | None,
    check: bool,
    condense: bool,
    linear: LinearSolver | None = None,
    shortest: float = np.inf,
) -> PreparedRun:
    """Prepare a run with steps that are not shorter than `shortest`."""
    if not isinstance(system, System):
        raise SceneError(f"march: found {brief(system)}; wanted a System. simulate() takes a scene and a mesh.")
    if solver is not None:
        as_solver(solver).check_accuracy()
    if linear is not None and not isinstance(linear, LinearSolver):
        raise SceneError(
            f"linear: found {brief(linear)}; wanted SuperLU(), Pardiso(), Iterative(), PETSc(), your own, or None."
        )
    check, condense = flag(check, "check"), flag(condense, "condense") and not system.is_viscous
    linear = system.linear(linear)
    with threads_of_steps(system, condense, linear):
        condensation = Condensation(system, condense, linear)
        chosen = choose_solver(condensation.operators, solver)
        elastic = Frame(condensation, chosen)
        if system.norms is not None:
            refuse_floating_rates(system)
            warn_of_softening(condensation.operators, system.norms, shortest)
        if not system.is_viscous:
            _ = elastic.prepared
    return PreparedRun(
        system=system, elastic=elastic, solver=chosen, check=check, default=solver is None, condense=condense
    )


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
        times[0] is the initial instant.
    solver : Solver, or object with solve(program, target), optional
        By default Direct if there are no norm terms and no limits, else Newton.
    initial : None, (n,) array, "equilibrium", "settled", Balanced or Continued
        None: y = 0. Array: y. "equilibrium": K y = load(t_0), without friction. "settled": one step from y = 0.
    store : "all", "last", int or sequence of int
        States to store: all, only the last, every n-th, or the states of given steps. The last is always stored.
    check, condense, linear
        See :func:`vemcvx.simulate`.
    progress : callable (step, steps), optional
        Called after each step.
    storage : Storage, optional
        Memory() or Folder(path). A folder continues an interrupted run of the same system.

    Returns
    -------
    Trajectory

    Raises
    ------
    SceneError
        The times do not increase, the initial state violates (2.1), or rigid limits contradict each other.
    NotAccepted
        The solver does not accept the program.
    NotCertified
        A step misses the requested accuracy.
    HistoryError
        The folder of `storage` contains another run, or has no room for arrays.

    Examples
    --------
    >>> system = vx.System(K=np.eye(1), load=lambda t: [3.0 * t], norms=vx.Norms(B=np.eye(1), w=1.0))
    >>> vx.march(system, [0.0, 0.5, 1.0]).state.ravel()
    array([0. , 0.5, 2. ])
    """
    if progress is not None and not callable(progress):
        raise SceneError(f"progress: found {brief(progress)}; wanted a function of (step, steps).")
    check_takes(progress, 2, "progress", "(step, steps)")
    if storage is not None and not isinstance(storage, Storage):
        raise SceneError(f"march: found storage = {brief(storage)}; wanted Memory(), Folder(path), or None.")
    instants = check_times(times)
    kept = choose_stored_steps(store, len(instants) - 1)
    start = time.perf_counter()
    run = prepare(system, solver, check, condense, linear=linear, shortest=float(np.diff(instants).min(initial=np.inf)))
    prepared = time.perf_counter() - start
    storage = storage or Memory()
    return march_prepared(run, instants, initial, kept, storage=storage, progress=progress, prepared=prepared)


def march_prepared(
    run: PreparedRun,
    instants: Floats,
    initial: Beginning,
    kept: Ints,
    *,
    storage: Storage,
    progress: Callable[[int, int], None] | None = None,
    prepared: float = 0.0,
) -> Trajectory:
    """March a prepared run through time, and store the steps in `kept`."""
    start = time.perf_counter()
    with threads_of_steps(run.system, run.condense, run.condensation.linear):
        recorder = Recorder(run, instants, kept, storage)
        begun = recorder.begin()
        if begun is None:
            begun = 0, initial_state(run, instants, initial)
            recorder.add(*begun)
        first, state = begun
        try:
            for n in range(first + 1, len(instants)):
                state = step(run, state, n, float(instants[n]))
                recorder.add(n, state)
                if progress is not None:
                    progress(n, len(instants) - 1)
        finally:
            recorder.enter_waiting()
        seconds = {"prepare": prepared, "solve": time.perf_counter() - start}
        return recorder.finish(seconds, initial.work_second_order if isinstance(initial, Continued) else 0.0)


def threads_of_steps(system: System, condense: bool, linear: LinearSolver) -> AbstractContextManager[None]:
    """Limit BLAS to one thread inside the block, unless steps have large dense matrices."""
    unknowns = len(system.retained) if condense else system.n
    return one_thread(unknowns if linear.eliminates else 0)


def check_times(times: ArrayLike) -> Floats:
    """Return the increasing instants (N + 1,), or raise SceneError."""
    wanted = "an increasing sequence of finite instants, such as np.linspace(0, 1, 65)"
    t = as_real_array(times, "times", wanted)
    if t.ndim != 1 or len(t) == 0 or not np.isfinite(t).all() or not (np.diff(t) > 0).all():
        raise SceneError(f"times: found {brief(times)}; wanted {wanted}.")
    return t


@dataclass(frozen=True, eq=False)
class Balanced:
    """The state y with K y = `force`, and y = `near` on the kernel of K."""

    force: Floats
    near: Floats
    settle: bool = True  # True to take one step from y


@dataclass(frozen=True, eq=False)
class Continued:
    """The last state of another run."""

    y: Floats
    past: Ledger
    work_second_order: float


Beginning = ArrayLike | str | Balanced | Continued | None
START_TOLERANCE = 1e-6  # Largest accepted jump from a given initial state, relative to the energy norm.
WARNING_RATIO = 3.0  # Largest jump without a warning, relative to |P^h u_0 - nodal values of u_0| (vemcvx.projected).


def initial_state(run: PreparedRun, instants: Floats, initial: Beginning) -> State:
    """Return the state at the first instant; raise SceneError for states that violate (2.1)."""
    now, K = StepData.evaluate(run.condensation, float(instants[0])), run.system.K
    y = _first_unknowns(run, now, initial)
    given = make_given_state(run, now, y, initial.past if isinstance(initial, Continued) else None)
    rests = isinstance(initial, str) and initial == "settled"
    if run.system.dashpots.any() and rests:
        raise SceneError(
            "initial: found 'settled', a state at rest, in which the dashpots of VelocityContact bear no force. Give a "
            "state, such as None (zero): with dashpots, a run may begin with any state."
        )
    moves = run.system.is_viscous or (run.system.reads_rates and isinstance(initial, Continued))
    if moves and not rests:
        return given
    settled = settle_from(run, given, run.check and (rests or isinstance(initial, Balanced)))
    if rests:
        return settled
    jump, norm = energy_norm(K, settled.unknowns - y), settled.ledger.norm
    if isinstance(initial, Balanced):
        if jump > WARNING_RATIO * energy_norm(K, y - initial.near) + WARNING_FRACTION * norm:
            log.warning(
                f"initial: u_0 violates condition (2.1), or the mesh is too coarse for it: one step at t = {now.t:.6g} "
                f"moves P^h u_0 by {jump:.3g} in the energy norm, to a state of norm {norm:.3g}. Check that loads and "
                "friction at the first instant balance the stresses of u_0; if they do, refine the mesh."
            )
        if initial.settle:
            # Errors are relative to the norm before the step.
            return replace(settled, size=max(settled.size, given.ledger.norm))
    scale = max(given.ledger.norm, now.force.norm)
    if not isinstance(initial, Balanced) and not jump <= START_TOLERANCE * scale + settled.certificate.error:
        loads = (StepData.evaluate(run.condensation, t).force.norm for t in instants.tolist())
        if jump <= ROUNDING * max(loads):
            return settled
        refuse_start(run, given, settled, jump / scale if scale > 0 else np.inf)
    away = settled.certificate.away(jump + settled.certificate.error)
    start = replace(settled, y=given.y, full=y, unbalanced=given.unbalanced, certificate=away)
    return _begin_history(run, start, given.ledger)


def _first_unknowns(run: PreparedRun, now: StepData, initial: Beginning) -> Floats:
    n = run.system.n
    if initial is None or (isinstance(initial, str) and initial == "settled"):
        return np.zeros(n)
    if isinstance(initial, Continued):
        return initial.y
    if isinstance(initial, Balanced):
        left = run.condensation.reduce(initial.force - run.system.K @ initial.near)
        return initial.near + run.condensation.response(left)
    if isinstance(initial, str):
        if initial != "equilibrium":
            raise SceneError(
                f"initial: found {initial!r}; there are None (zero), an array, 'equilibrium' (the state without "
                "friction) and 'settled' (the state after one step from zero)."
            )
        if run.system.kernel is not None:
            raise SceneError(
                "initial: 'equilibrium' is the state without friction, but only friction holds the body; "
                "use 'settled' (the state after one step from zero) or a given state."
            )
        return run.condensation.response(now.force)
    return finite(as_shaped_array(initial, "initial", f"{n} finite values, one per unknown", (n,)), "initial")


def settle_from(run: PreparedRun, given: State, check: bool = False) -> State:
    """Return the state after a step of length zero, certified in full."""
    posed = pose_step(run, given, given.data, given.weights[: run.operators.count])
    settled = certify_in_full(run, posed.solve(0))
    if check:
        require_certified(run, settled, 0)
    return _begin_history(run, settled, given.ledger)


def _begin_history(run: PreparedRun, state: State, past: Ledger) -> State:
    """Return the state with zero slips, and with the losses and work in `past`."""
    ledger = replace(past, energy=energy(run.condensation, state.y, state.data, state.p))
    slip, sticks = np.zeros_like(state.slip), np.ones_like(state.sticks)
    return replace(state, slip=slip, sticks=sticks, ledger=ledger, scale=ledger.norm, size=state.data.force.norm)
