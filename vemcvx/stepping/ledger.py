"""The ledger of backward Euler, kept on the retained unknowns.

energy E = 1/2 a(u, u),   u = P y + u_D(t);  soft limits add c p^2 / 2
work     = load_n . dy + a(u_n, du_D) + lam . dc - p . dg,    g = e - D^u_D
           (forces and reactions at the end of the step; this load is without the Dirichlet force; c is the motion of
           supports along norm terms, less that of the ground, which friction pulls along; g is the remaining gap at
           y = 0, which shrinks where supports move towards limits, or obstacles towards the body: they push)
loss     = sum_i lam_i . s_i, which is w_i |s_i| at a solution, kept term by term, too: friction work, which
           wears what rubs (Archard 1953)
identity   work - dE - loss = 1/2 a(du, du) + p . dz  step by step, for every balanced answer, z = D^u - e. For bounds
           the last term is -p . z_prev >= 0; for soft limits, less the change of their energy, at least c (dp)^2 / 2

Between the instants. Forces at the end of a step do O(k) too much work, even where the states at both ends are exact,
and friction whose bound changes in a step loses O(k) too much or too little. Of second order are, with weights w (of
laws that read slips, at the slips of the instants) averaged over both ends of a step,

loss       = sum_i (w_i + w_i,prev) / 2 |s_i|     what slips is at its bound
work       = E - E_0 + loss                                                        the balance of the continuum

(the trapezoidal rule on the loss of a monotone slip; the work, where it is asked of forces, would be the mean of both
ends' times the increment, which is dE + (lam + lam_prev) / 2 . s + (p + p_prev) / 2 . dz for balanced states: as much,
but for what happens in the one step in which a place begins to slip, to touch or to open.) Where w is constant and
slips are those of the continuum both are exact.

Supports that carry a body far, and strain it little, would leave the energy to the cancellation of 1/2 y'Ky + y'm +
1/2 a(u_D, u_D), m = P'A u_D. So a state is split, u = u_m + P z, into what the supports alone bring about,

    u_m = P x_m + u_D,   K x_m = -m,   and the rest   K z = load + [0; rho]:     a(u_m, Pv) = 0 for all v,

    E = 1/2 a(u_m, u_m) + 1/2 z'Kz,    a(u_n, du_D) = a(u_m,n, du_m) + (held - load_n) . dx_m

with held = B'lam + D'p, and a(u_m, .) of fields seen from the body (:class:`vemcvx.program.system.Motion`). Where K has
a kernel x_m comes of K + E, E the anchors' stiffness, and a(u_m, Pv) = -v'E x_m.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vemcvx.base.arrays import Floats, lengths
from vemcvx.program.condensation import Condensation, Reduced
from vemcvx.program.operators import product
from vemcvx.program.scaling import LARGEST_NORM, checked_norm
from vemcvx.program.step_program import Answer
from vemcvx.program.system import System, on_part


@dataclass(frozen=True)
class Carried:
    """The terms that moving supports contribute at an instant."""

    dirichlet_force: Reduced
    field: Floats  # (n_u,) u_m, the displacement under these terms alone, less a rigid motion
    pair: Callable[[Floats, Floats], float]  # a of two such fields


@dataclass(frozen=True, kw_only=True)
class StepData:
    """The data of the system at an instant: its force, and the motion of its supports."""

    t: float
    force: Reduced  # load minus Dirichlet force
    prescribed_slip: Floats
    remaining_gap: Floats  # (r,) gaps of the limits at y = 0
    ground: Floats | None = None  # (m * block,) the motion of the ground, subtracted in `prescribed_slip`
    carried: Carried | None = None  # None if no supports move

    def still_as(self, other: StepData) -> bool:
        """Return True if nothing differs between the two instants."""
        one, two = self.carried, other.carried
        return (
            self.force.same(other.force)
            and np.array_equal(self.prescribed_slip, other.prescribed_slip)
            and np.array_equal(self.remaining_gap, other.remaining_gap)
            and (one is None or two is None or one.dirichlet_force.same(two.dirichlet_force))
        )


@dataclass(frozen=True)
class Ledger:
    """Energy at an instant, cumulative dissipation and work, and the energy norm |u|_a."""

    energy: float
    dissipated: float
    work: float
    worn: Floats  # (m,) cumulative lam_i . s_i of every term; they sum to `dissipated`, but for what damping loses
    slipped: Floats  # (m,) cumulative |s_i|, which laws of friction may see
    dissipated_second_order: float
    worn_second_order: Floats  # (m,) of `worn`, likewise

    @classmethod
    def opening(cls, energy: float, count: int) -> Ledger:
        """Nothing is lost or done yet, in any of `count` norm terms."""
        none = np.zeros(count)
        return cls(energy, 0.0, 0.0, worn=none, slipped=none, dissipated_second_order=0.0, worn_second_order=none)

    @property
    def norm(self) -> float:
        """|u|_a = sqrt(2 E)."""
        return math.sqrt(2.0 * max(self.energy, 0.0))


@dataclass(frozen=True)
class Rubbed:
    """Friction in a step: multipliers and slips (m, block), weights (m,) of the step, and bounds at both its ends."""

    lam: Floats  # of the program, at the end of the step
    slip: Floats
    weights: Floats
    bounds: tuple[Floats, Floats]
    """(m,) weights at the slips of both ends: those of a step may be of the slip before it"""

    @cached_property
    def loss(self) -> Floats:
        """(m,) lam . s: what friction loses under the forces at the end of the step."""
        loss: Floats = np.maximum(np.einsum("mb,mb->m", self.lam, self.slip), 0.0)
        return loss

    @property
    def loss_second_order(self) -> Floats:
        """(m,) the loss with bounds averaged over both ends of the step.

        lam . s is w |s| but for rounding, and stays small where a slip is rounding under a large weight.
        """
        (before, after), w = self.bounds, self.weights
        if (before == w).all() and (after is w or (after == w).all()):
            return self.loss
        # |s|, by the forces that slip takes; by itself where the weight has vanished at the end of the step.
        way = np.divide(self.loss, w, out=lengths(self.slip).copy(), where=w > 0)
        return np.maximum(0.5 * (before + after) * way, 0.0)


def step_data(system: System, condensation: Condensation, t: float) -> StepData:
    """Evaluate load and supports at `t`."""
    forces, rows = system.load_on_part(t)
    data = StepData(
        t=t,
        force=in_range(condensation.reduce(forces, rows=rows), t),
        prescribed_slip=system.prescribed_slip(t),
        remaining_gap=system.remaining_gap(t),
        ground=system.ground(t),
    )
    motion = system.motion
    if motion is None:
        return data
    forces, rows = on_part(motion.dirichlet_force, t)
    dirichlet_force = condensation.reduce(forces, rows=rows)
    carried = Carried(dirichlet_force, motion.frame(t, -dirichlet_force.x), motion.pair)
    return replace(data, carried=carried)


def in_range(force: Reduced, t: float) -> Reduced:
    """The force, unless the energy of its response overflows, which is an error."""
    if not force.norm <= LARGEST_NORM:
        checked_norm(force.norm, t)
    return force


def energy(condensation: Condensation, y: Floats, now: StepData, p: Floats) -> float:
    """1/2 a(u, u), and what soft limits store."""
    pressed = float(p @ (condensation.operators.compliance * p))
    carried, kernel = now.carried, condensation.operators.kernel
    if now.ground is not None and kernel is not None:
        y = y - kernel @ (kernel.T @ y)  # A body on moving ground goes far without strain: digits of y would be lost.
    load, moved = now.force, 0.0
    if carried is not None:
        y, load = y + carried.dirichlet_force.x[condensation.retained], load + carried.dirichlet_force
        moved = 0.5 * carried.pair(carried.field, carried.field)
        moved += _anchor_work(condensation, carried.dirichlet_force, y)
    square = load.work_inside(load) + float(y @ product(condensation.operators.K, y))
    return 0.5 * (square + pressed) + moved


def strain_energy(system: System, y: Floats, t: float) -> float:
    """1/2 a(u, u) of all unknowns y (n,)."""
    if system.motion is None:
        return 0.5 * float(y @ (system.K @ y))
    seen = system.motion.frame(t, y)
    return 0.5 * system.motion.pair(seen, seen)


def energy_in_full(system: System, y: Floats, t: float, p: Floats) -> float:
    """1/2 a(u, u) of all unknowns y (n,), and what soft limits store."""
    stored = strain_energy(system, y, t)
    return stored if system.limits is None else stored + 0.5 * float(p @ (system.limits.compliances * p))


def _anchor_work(condensation: Condensation, dirichlet_force: Reduced, z: Floats) -> float:
    """a(u_m, Pz), the anchors' work; zero without."""
    anchor = condensation.operators.anchor
    return 0.0 if anchor is None else float(z @ (anchor * dirichlet_force.x[condensation.retained]))


def advance(
    condensation: Condensation,
    past: Ledger,
    between: tuple[StepData, StepData],
    y: Floats,
    answer: Answer,
    rubbed: Rubbed,
) -> Ledger:
    """The ledger after a step."""
    last, now = between
    force, d, change = now.force, answer.d, now.force - last.force
    work = -float(answer.p @ (now.remaining_gap - last.remaining_gap))
    if now.carried is not None and last.carried is not None:
        c, reaction = condensation.retained, now.carried.dirichlet_force
        moved = reaction - last.carried.dirichlet_force
        force, d, change = force + reaction, d + moved.x[c], change + moved
        work += now.carried.pair(now.carried.field, now.carried.field - last.carried.field)
        work += _anchor_work(condensation, moved, y + reaction.x[c])
        work -= float(condensation.operators.multiplier_force(answer.lam, answer.p) @ moved.x[c])
    # The work of the force on the displacement inside, and on the retained unknowns.
    work += force.work_inside(change) + float(force.retained @ d)
    work += float(answer.lam.ravel() @ (now.prescribed_slip - last.prescribed_slip))
    return _after_step(past, energy(condensation, y, now, answer.p), work, rubbed)


def _after_step(past: Ledger, stored: float, work: float, rubbed: Rubbed) -> Ledger:
    """The ledger with a step's energy and work, and what friction loses in it."""
    loss, between = rubbed.loss, rubbed.loss_second_order
    return Ledger(
        energy=stored,
        dissipated=past.dissipated + float(loss.sum()),
        work=past.work + work,
        worn=past.worn + loss,
        slipped=past.slipped + lengths(rubbed.slip),
        dissipated_second_order=past.dissipated_second_order + float(between.sum()),
        worn_second_order=past.worn_second_order + between,
    )
