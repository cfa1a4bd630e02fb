"""Steps of backward Euler with viscosity: programs of steps from zero, with K_0 + K_1 / k in place of K.

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

from collections import OrderedDict
from contextlib import suppress
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import EPS, Floats
from vemcvx.errors import NotContracting
from vemcvx.linear import residual
from vemcvx.program.condensation import rounding
from vemcvx.program.system import Damping
from vemcvx.program.tolerances import SHARE
from vemcvx.stepping.fixed_point import solved
from vemcvx.stepping.ledger import Ledger, StepData, energy_in_full, in_range
from vemcvx.stepping.posed_step import PosedStep, certified_in_full, data_norms, pose_step, require_certified
from vemcvx.stepping.state import PreparedRun, State, prepare


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
                sharper, _ = self._stepped(before, n, t, SHARE * state.unit(accuracy) / asked)
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
        bound=before.bound,
    )
