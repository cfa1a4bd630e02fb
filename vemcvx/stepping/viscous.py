"""Steps with viscosity: a(u_n, v) + b((u_n - u_{n-1}) / k, v) + ... , where the length k of the step does not drop out.

In the increment d, with K_0 of a and K_1 of b, and w the motion of the supports (u = P y + u_D),

    (K_0 + K_1 / k) d = load_n - K_0 y_{n-1} - P'A_1 (u_D,n - u_D,n-1) / k - B'lam - D'p:

the program of a step from zero with another K, factorised once a length of step. The ledger gains what dashpots lose,
b(du, du) / k. The certificate bounds the error in the norm of K_0 + K_1 / k, which is no less than that of K_0.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vemcvx.program.certificate import Certificate
from vemcvx.program.system import System
from vemcvx.stepping.backward_euler import completed, solved
from vemcvx.stepping.ledger import Drive, Ledger, in_range, strain_energy
from vemcvx.stepping.state import Run, State

Floats = NDArray[np.float64]

KEPT = 4
"""Factorisations kept, the longest unused goes: two lengths of step that take turns need two."""


class ViscousSteps:
    """Steps of a system with damping.

    Parameters
    ----------
    run : Run
        The system without its damping.
    prepare : callable (System) -> Run
        For the system of one length of step.
    """

    def __init__(self, run: Run, prepare: Callable[[System], Run]):
        self._run, self._prepare = run, prepare
        self._runs: OrderedDict[float, Run] = OrderedDict()

    def step(self, before: State, n: int, t: float) -> State:
        """The state at `t`, one step after `before`, all its unknowns included."""
        # Equal steps of np.linspace differ in their last digits; twelve are kept.
        k = float(f"{t - before.t:.12e}")
        run, y = self._at(k), before.full
        now = self._drive(run, y, before.t, t, k)
        norms = run.system.norms
        weights = np.zeros(0) if norms is None else norms.weights_under(t, before.p)
        stepped = completed(run, solved(run, _rest(run, before, now), now, weights, n))
        d = stepped.full
        ledger = self._ledger(before, stepped, y, d, t, k)
        state = replace(
            stepped,
            y=(y + d)[run.condensation.touched],
            full=y + d,
            ledger=ledger,
            scale=float(np.maximum(before.scale, ledger.norm)),
            velocity=d / k,
        )
        if self._run.check:
            self._run.insist(state, n)
        return state

    def _at(self, k: float) -> Run:
        """The run for steps of length k."""
        if k not in self._runs:
            system = self._run.system
            stiffness = (system.K + system.damping.C / k).tocsr()  # type: ignore[union-attr]
            self._runs[k] = self._prepare(replace(system, K=stiffness, damping=None, motion=None))
            if len(self._runs) > KEPT:
                self._runs.popitem(last=False)
        self._runs.move_to_end(k)
        return self._runs[k]

    def _drive(self, run: Run, y: Floats, s: float, t: float, k: float) -> Drive:
        """What drives the increment from the instant s to t."""
        system = self._run.system
        motion, damping = system.motion, system.damping
        phi = system.force(t) - system.K @ y
        drag = np.zeros(0 if system.norms is None else system.norms.B.shape[0])
        if motion is not None:
            drag = motion.drag(t) - motion.drag(s)
        if damping.motion is not None:  # type: ignore[union-attr]
            phi -= (damping.motion.stretch(t) - damping.motion.stretch(s)) / k  # type: ignore[union-attr]
        reach = system.reach(t)
        if system.limits is not None:
            reach = reach - system.limits.D @ y
        bias = np.zeros_like(drag) if system.norms is None else system.norms.tilt(t)
        # No two of these are alike, and a resumed run does not know those before it.
        force = in_range(run.condensation.reduce(phi, remembered=False), t)
        return Drive(t, force, None, drag, None, reach, bias)

    def _ledger(self, before: State, stepped: State, y: Floats, d: Floats, t: float, k: float) -> Ledger:
        system, s = self._run.system, before.t
        C, ahead = system.damping.C, y + d  # type: ignore[union-attr]
        lost = float(d @ (C @ d)) / k
        work = float(system.force(t) @ d) - float(stepped.p @ (system.reach(t) - system.reach(s)))
        motion = system.motion
        if motion is not None:
            change = motion.stretch(t) - motion.stretch(s)
            work += float(motion.stretch(t) @ d + ahead @ change) + motion.stored(t, t) - motion.stored(s, t)
            work += float(stepped.lam.ravel() @ (motion.drag(t) - motion.drag(s)))
        moved = system.damping.motion  # type: ignore[union-attr]
        if moved is not None:
            across = float(d @ (moved.stretch(t) - moved.stretch(s))) / k
            own = (moved.stored(t, t) - 2 * moved.stored(s, t) + moved.stored(s, s)) / k
            lost, work = lost + 2 * across + own, work + across + own
        work += float(stepped.drive.bias @ stepped.slip.ravel())
        past, rubbed = before.ledger, stepped.ledger
        lost += past.dissipated + rubbed.dissipated
        energy = strain_energy(system, ahead, t) + 0.5 * float(stepped.p @ (self._run.form.softness * stepped.p))
        return Ledger(energy, lost, past.work + work, past.worn + rubbed.worn)


def _rest(run: Run, before: State, now: Drive) -> State:
    """Nothing has moved yet: where the increment begins."""
    form = run.form
    none, nothing = np.zeros(len(run.condensation.touched)), np.zeros((form.count, form.block))
    zero = now.force - now.force
    drive = Drive(before.t, zero, None, np.zeros_like(now.drag), None, np.zeros_like(now.reach), now.bias)
    certificate = Certificate(0.0, np.zeros(form.count), 0.0, np.zeros(len(form.softness)))
    start = (none, none, drive, before.weights, before.weights, before.lam, before.p, nothing)
    return State(before.t, *start, certificate, Ledger.opening(0.0, form.count), before.scale, 0, size=before.size)
