"""The energy ledger of backward Euler, kept on the touched unknowns.

energy E = 1/2 a(u, u),   u = P y + u_D(t);  soft limits add c p^2 / 2
work     = load_n . dy + a(u_n, du_D) + lam . dc + p . (dD^u_D - de)
           (forces and reactions at the end of the step; this load is without the stretch of the supports; the last is
           of supports that move towards limits, and of limits e that move themselves: obstacles push)
loss     = lam . s = sum_i w_i |s_i| + c_i . s_i, kept term by term, too: friction work, which wears what rubs
           (Archard 1953)
identity   work - dE - loss = 1/2 a(du, du) + p . dz  step by step, for every balanced answer, z = D^u - e; the last, of
           bounds, is -p . z_prev >= 0, that of soft limits, less what they store, c (dp)^2 / 2 and more

Supports that carry a body far, and strain it little, would leave the energy to the cancellation of 1/2 y'Ky + y'm +
1/2 a(u_D, u_D), m = P'A u_D. So a state is split, u = u_m + P z, into what the supports alone bring about,

    u_m = P x_m + u_D,   K x_m = -m,   and the rest   K z = load + [0; rho]:     a(u_m, Pv) = 0 for all v,

    E = 1/2 a(u_m, u_m) + 1/2 z'Kz,    a(u_n, du_D) = a(u_m,n, du_m) + (held - load_n) . dx_m

with held = B'lam + D'p, and a(u_m, .) of fields seen from the body (:class:`vemcvx.program.system.Motion`). Where K has
a kernel x_m comes of K + E, E the anchors' stiffness, and a(u_m, Pv) = -v'E x_m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vemcvx.program.condensation import Condensation, Reduced
from vemcvx.program.extended import residual
from vemcvx.program.refinement import pulled
from vemcvx.program.scaling import LARGEST, checked_norm, power_of_two
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
    carried: Floats | None
    """(n_u,) u_m, what the supports alone bring about, seen from the body"""
    reach: Floats
    """(r,) what the limits leave free"""
    bias: Floats
    """(m * block,) of the norm terms, minus B' of which is part of the force"""
    pushed: Reduced
    """the force without that part: what there is to hold"""

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
        return float(np.sqrt(2.0 * np.maximum(self.energy, 0.0)))


def drive(system: System, condensation: Condensation, t: float) -> Drive:
    """Evaluate load and supports at `t`."""
    bias = np.zeros(0) if system.norms is None else system.norms.tilt(t)
    pushed = in_range(condensation.reduce(system.push(t)), t)
    force = condensation.less(pushed, bias)
    reach = system.reach(t)
    if system.motion is None:
        return Drive(t, force, None, np.zeros_like(bias), None, reach, bias, pushed)
    motion = system.motion
    stretch = condensation.reduce(motion.stretch(t))
    return Drive(t, force, stretch, motion.drag(t), motion.frame(t, -stretch.x), reach, bias, pushed)


def in_range(force: Reduced, t: float) -> Reduced:
    """The force, if the energy of what it causes is not too large to be a number."""
    unit = float(power_of_two(np.abs(force.phi).max(initial=0.0)))
    norm = unit * float(np.sqrt(abs((force.phi / unit) @ (force.x / unit))))
    if not norm <= LARGEST:
        checked_norm(norm, t)
    return force


def energy(condensation: Condensation, y: Floats, now: Drive, p: Floats) -> float:
    """1/2 a(u, u), and what soft limits store."""
    pressed = float(p @ (condensation.form.softness * p))
    if now.stretch is None:
        return 0.5 * (condensation.square(y, now.force) + pressed)
    c = condensation.touched
    z, load = y + now.stretch.x[c], now.force + now.stretch
    carried = condensation.system.motion.pair(now.carried, now.carried)  # type: ignore[union-attr]
    crossed = _crossed(condensation, now.stretch, z)
    return 0.5 * (condensation.square(z, load) + carried + pressed) + crossed


def strain_energy(system: System, y: Floats, t: float) -> float:
    """1/2 a(u, u) of all unknowns y (n,)."""
    if system.motion is None:
        none = np.zeros_like(y)
        return -0.5 * float(y @ residual(none, system.K, y, none))
    seen = system.motion.frame(t, y)
    return 0.5 * system.motion.pair(seen, seen)


def _crossed(condensation: Condensation, stretch: Reduced, z: Floats) -> float:
    """a(u_m, Pz), the anchors' work; zero without."""
    anchor = condensation.form.anchor
    return 0.0 if anchor is None else float(z @ (anchor * stretch.x[condensation.touched]))


def advance(
    condensation: Condensation, before: State, now: Drive, y: Floats, answer: Answer, slip: Floats, w: Floats
) -> Ledger:
    """The ledger after a step."""
    last = before.drive
    change = now.force - last.force
    work = -float(answer.p @ (now.reach - last.reach))
    if now.stretch is None or last.stretch is None:
        work += condensation.work(now.force, answer.d, change)
    else:
        c, motion = condensation.touched, condensation.system.motion
        moved = now.stretch - last.stretch
        work += condensation.work(now.force + now.stretch, answer.d + moved.x[c], change + moved)
        work += motion.pair(now.carried, now.carried - last.carried)  # type: ignore[union-attr, operator, arg-type]
        work += _crossed(condensation, moved, y + now.stretch.x[c])
        held = condensation.form.rows.pull(answer.lam.ravel()) + condensation.form.limits.pull(answer.p)
        work -= float(held @ moved.x[c])
        work += float(answer.lam.ravel() @ (now.drag - last.drag))
    return _entered(before, now, energy(condensation, y, now, answer.p), work, slip, w)


def advance_in_full(
    system: System, before: State, now: Drive, y: Floats, answer: Answer, slip: Floats, w: Floats
) -> Ledger:
    """The ledger after a step of which all unknowns y (n,) are known, before and after; no soft limits.

    The factors and S, which may be too coarse for energies, take no part: products with K itself, in extended
    precision. With held = load - P'A u_n,  load . dy + a(u_n, du_D) = held . dy + a(u_n, du).
    """
    last, motion, d = before.drive, system.motion, y - before.full  # type: ignore[operator]
    work = -float(answer.p @ (now.reach - last.reach))
    if motion is None:
        work += float(now.force.phi @ d)
    else:
        seen, then = motion.frame(now.t, y), motion.frame(last.t, before.full)  # type: ignore[arg-type]
        work += motion.pair(seen, seen - then) + float(pulled(system, answer.lam, answer.p) @ d)
        work += float(answer.lam.ravel() @ (now.drag - last.drag))
    return _entered(before, now, strain_energy(system, y, now.t), work, slip, w)


def _entered(before: State, now: Drive, stored: float, work: float, slip: Floats, w: Floats) -> Ledger:
    """The ledger with a step's energy, its work but for the bias, and its slips."""
    # The bias is a force in the balance, and friction in the ledger.
    tilt = np.einsum("mb,mb->m", now.bias.reshape(slip.shape), slip)
    rubbed, past = w * np.linalg.norm(slip, axis=1) + tilt, before.ledger
    done = work + float(tilt.sum())
    return Ledger(stored, past.dissipated + float(rubbed.sum()), past.work + done, past.worn + rubbed)
