"""The energy ledger of backward Euler, kept on the touched unknowns.

energy E = 1/2 a(u, u) = 1/2 (y'Ky + 2 y'm + stored),   u = P y + u_D(t),   m = P'A u_D;  soft limits add c p^2 / 2
work     = load_n . dy + y_n . dm + u_D'A du_D + lam . dc + p . (dD^u_D - de)
           (forces and reactions at the end of the step; this load is without the stretch of the supports; the last is
           of supports that move towards limits, and of limits e that move themselves: obstacles push)
loss     = lam . s = sum_i w_i |s_i| + c_i . s_i, kept term by term, too: friction work, which wears what rubs
           (Archard 1953)
identity   work - dE - loss = 1/2 a(du, du) + p . dz  step by step, for every balanced answer, z = D^u - e; the last, of
           bounds, is -p . z_prev >= 0, that of soft limits, less what they store, c (dp)^2 / 2 and more
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vemcvx.program.condensation import Condensation, Reduced
from vemcvx.program.step_program import Answer
from vemcvx.program.system import System

if TYPE_CHECKING:
    from vemcvx.stepping.state import State

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Drive:
    """What drives the system at an instant: its force, and the motion of its supports."""

    t: float
    force: Reduced
    """load minus stretch"""
    stretch: Reduced | None
    drag: Floats
    stored: float
    reach: Floats
    """(r,) what the limits leave free"""
    bias: Floats
    """(m * block,) of the norm terms, minus B' of which is part of the force"""

    def still_as(self, other: Drive) -> bool:
        """Whether nothing differs between the two instants."""
        return (
            np.array_equal(self.force.phi, other.force.phi)
            and np.array_equal(self.drag, other.drag)
            and np.array_equal(self.reach, other.reach)
            and (
                self.stretch is None or np.array_equal(self.stretch.phi, other.stretch.phi)  # type: ignore[union-attr]
            )
        )


@dataclass(frozen=True)
class Ledger:
    """Energy at an instant, cumulative dissipation and work, and the energy norm |u|_a."""

    energy: float
    dissipated: float
    work: float
    worn: Floats
    """(m,) cumulative w_i |s_i| of every norm term; they sum to `dissipated`, where nothing else dissipates"""

    @classmethod
    def opening(cls, energy: float, count: int) -> Ledger:
        """Nothing is lost or done yet, in any of `count` norm terms."""
        return cls(energy, 0.0, 0.0, np.zeros(count))

    @property
    def norm(self) -> float:
        """|u|_a = sqrt(2 E)."""
        return float(np.sqrt(2.0 * max(self.energy, 0.0)))


def drive(system: System, condensation: Condensation, t: float) -> Drive:
    """Evaluate load and supports at `t`."""
    force = condensation.reduce(system.force(t))
    bias = np.zeros(0) if system.norms is None else system.norms.tilt(t)
    reach = system.reach(t)
    if system.motion is None:
        return Drive(t, force, None, np.zeros_like(bias), 0.0, reach, bias)
    motion = system.motion
    stretch = condensation.reduce(motion.stretch(t))
    return Drive(t, force, stretch, motion.drag(t), motion.stored(t, t), reach, bias)


def energy(condensation: Condensation, y: Floats, now: Drive, p: Floats) -> float:
    """1/2 a(u, u), and what soft limits store."""
    square = condensation.square(y, now.force) + float(p @ (condensation.form.softness * p))
    if now.stretch is None:
        return 0.5 * square
    return 0.5 * (square + 2.0 * condensation.work(now.stretch, y, now.force) + now.stored)


def advance(
    condensation: Condensation, before: State, now: Drive, y: Floats, answer: Answer, slip: Floats, w: Floats
) -> Ledger:
    """The ledger after a step."""
    change = now.force - before.drive.force
    work = condensation.work(now.force, answer.d, change) - float(answer.p @ (now.reach - before.drive.reach))
    if now.stretch is not None and before.drive.stretch is not None:
        work += condensation.work(now.stretch, answer.d, change)
        work += condensation.work(now.stretch - before.drive.stretch, y, now.force)
        motion = condensation.system.motion
        work += now.stored - motion.stored(before.drive.t, now.t)  # type: ignore[union-attr]
        work += float(answer.lam.ravel() @ (now.drag - before.drive.drag))
    # The bias is a force in the balance, and friction in the ledger.
    tilt = np.einsum("mb,mb->m", now.bias.reshape(slip.shape), slip)
    work += float(tilt.sum())
    rubbed, past = w * np.linalg.norm(slip, axis=1) + tilt, before.ledger
    stored = energy(condensation, y, now, answer.p)
    return Ledger(stored, past.dissipated + float(rubbed.sum()), past.work + work, past.worn + rubbed)
