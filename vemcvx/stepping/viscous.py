"""Steps of backward Euler with viscosity: programs of steps from zero, with K_0 + K_1 / k in place of K.

With viscosity, a(u_n, v) + b((u_n - u_{n-1}) / k, v) + ..., the length k of the step does not drop out. In the
increment d, with K_0 of a and K_1 of b, and u_D the motion of the supports (u = P y + u_D),

    (K_0 + K_1 / k) d = load_n - K_0 y_{n-1} - P'A_1 (u_D,n - u_D,n-1) / k - B'lam - D'p:

the program of a step from zero with another K, factorised once a length of step. The ledger gains what dashpots
lose, b(du, du) / k. The certificate bounds the error in the norm of K = K_0 + K_1 / k, which is no less than that
of K_0.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats
from vemcvx.program.system import Damping
from vemcvx.program.tolerances import SHARE
from vemcvx.stepping.ledger import Ledger, StepData, energy_in_full, in_range
from vemcvx.stepping.posed_step import PosedStep, certified_in_full, data_norm, pose_step, require_certified
from vemcvx.stepping.state import PreparedRun, State, prepare


class ViscousSteps:
    """Steps of a system with damping; the run is of the system without it."""

    def __init__(self, run: PreparedRun, damping: Damping):
        self._run, self._damping = run, damping
        self._runs: OrderedDict[float, PreparedRun] = OrderedDict()

    def posed(self, before: State, n: int, t: float, w: Floats | None = None) -> PosedStep:
        """Step `n` from `before` to `t`, as the step from zero that it is; with weights `w` (m,), if they are given."""
        return self._posed(self._at(t - before.t), before, t, w)

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
            sharper, _ = self._stepped(before, n, t, SHARE * state.unit(accuracy) / asked)
            best = min(state, sharper, key=lambda found: found.certificate.gap)
            state = replace(best, iterations=state.iterations + sharper.iterations)
        if self._run.check:
            require_certified(self._run, state, n)
        return state

    def _stepped(self, before: State, n: int, t: float, share: float) -> tuple[State, float]:
        """The state solved to `share` of the accuracy, and the energy norm that this accuracy was relative to."""
        k, y = t - before.t, before.unknowns
        run = replace(self._at(k), share=share)
        stepped = certified_in_full(run, self._posed(run, before, t).solve_balanced(n))
        d = stepped.unknowns
        ledger = self._ledger(before, stepped, y=y, d=d, t=t, k=k)
        scale = float(np.maximum(before.scale, ledger.norm))
        # The increment alone has energy, the layer at supports that move; the state may have none.
        size = data_norm(run.condensation, stepped.data.force, scale, run.accuracy)
        state = replace(
            stepped,
            y=(y + d)[run.condensation.retained],
            full=y + d,
            ledger=ledger,
            scale=scale,
            size=max(before.size, stepped.size, size),
            velocity=d / k,
        )
        return state, stepped.unit(run.accuracy)

    def _at(self, k: float) -> PreparedRun:
        """The run for steps of length k; lengths that differ by rounding alone share it."""
        k = float(f"{k:.11e}")
        if k not in self._runs:
            system, shared = self._run.system, self._run.condensation
            stiffness = sp.csr_matrix(system.K + self._damping.C / k)
            alone = replace(system, K=stiffness, damping=None, motion=None)
            self._runs[k] = prepare(alone, self._run.solver, False, not shared.whole, shared.linear)
            if len(self._runs) > 4:  # The longest unused goes; two lengths that take turns need two.
                self._runs.popitem(last=False)
        self._runs.move_to_end(k)
        return self._runs[k]

    def _drive(self, run: PreparedRun, y: Floats, s: float, t: float, k: float) -> StepData:
        """The data of the increment from the instant s to t."""
        system = self._run.system
        moved = self._damping.motion
        phi = system.force(t) - system.K @ y
        prescribed_slip = system.prescribed_slip(t) - system.prescribed_slip(s)
        if moved is not None:
            phi -= (moved.dirichlet_force(t) - moved.dirichlet_force(s)) / k
        return StepData(
            t=t,
            # No two of these are alike, and a resumed run does not know those before it.
            force=in_range(run.condensation.reduce(phi, remembered=False), t),
            prescribed_slip=prescribed_slip,
            remaining_gap=system.remaining_gap(t) - system.D @ y,
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


def _rest(run: PreparedRun, before: State, now: StepData) -> State:
    """Nothing has moved yet: where the increment begins."""
    zero, none = now.force - now.force, np.zeros_like(now.remaining_gap)
    slip = np.zeros_like(now.prescribed_slip)
    data = replace(now, t=before.t, force=zero, prescribed_slip=slip, remaining_gap=none, ground=None)
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
