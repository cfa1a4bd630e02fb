"""The ledger of backward Euler: energy, work and loss, on the unknowns that states keep.

energy E = 1/2 a(u, u),   u = P y + u_D(t);  soft limits add c p^2 / 2
work     = load_n . dy + a(u_n, du_D) + lam . dc - p . dg,    g = e - D^u_D
           (forces and reactions at the end of the step; this load is without the Dirichlet force; c is the motion of
           supports along norm terms, less that of the ground; g is the remaining gap at y = 0)
loss     = sum_i lam_i . s_i, which is w_i |s_i| at a solution, kept term by term: friction work, which wears what rubs
identity   work - dE - loss = 1/2 a(du, du) + p . dz  step by step, for every balanced answer, z = D^u - e. For bounds
           the last term is -p . z_prev >= 0; for soft limits, less the change of their energy, at least c (dp)^2 / 2

Nodes that supports drag along the contact have a given slip s, the change of c: they enter no program, but add w |s| to
the loss, and to the work of the supports, whose reactions balance minus the multiplier lam = w s / |s|. Dashpots lose
b(du, du) / k, and what supports push against them, b(du, du_D) / k, is work.

Of second order in the steps, where the sums above are of first, are

    loss = sum_i (w_i + w_i,prev) / 2 |s_i|,        work = E - E_0 + loss:

the trapezoidal rule on slips, with weights of laws that read slips at those of the instants; and the balance of the
continuum, for forces at the end of a step do O(k) too much work, even where the states at both ends are exact.

Supports that carry a body far, and strain it little, would leave the energy to cancellation. So a state is split, u =
u_m + P z, into what the supports alone bring about and the rest, with m = P'A u_D:

    u_m = P x_m + u_D,   K x_m = -m,     a(u_m, Pv) = 0 for all v,

    E = 1/2 a(u_m, u_m) + 1/2 z'Kz,      a(u_n, du_D) = a(u_m,n, du_m) + (held - load_n) . dx_m

with held = load_n - m_n - K y_n, what is out of balance: friction, limits and dashpots hold it. Where K has a kernel
x_m comes of K + E, E the anchors' stiffness, and a(u_m, Pv) = -v'E x_m.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vemcvx.base.arrays import Floats, directions, lengths
from vemcvx.program.certificate import Certificate
from vemcvx.program.condensation import Condensation, Reduced
from vemcvx.program.operators import product
from vemcvx.program.system import DRAG_ROUNDING, System
from vemcvx.stepping.state import Ledger, PreparedRun, State, StepData


def energy(condensation: Condensation, y: Floats, now: StepData, p: Floats) -> float:
    """1/2 a(u, u), and what soft limits store."""
    operators, motion, load = condensation.operators, condensation.system.motion, now.force
    square, kernel = float(p @ (operators.compliance * p)), operators.kernel
    if now.ground is not None and kernel is not None:
        y = y - kernel @ (kernel.T @ y)  # A body on moving ground goes far without strain: digits of y would be lost.
    if motion is not None:
        y, load = y + now.push.x[condensation.retained], load + now.push
        square += motion.pair(now.field, now.field) + 2.0 * _anchor_work(condensation, now.push, y)
    return 0.5 * (square + load.work_inside(load) + float(y @ product(operators.K, y)))


def _anchor_work(condensation: Condensation, push: Reduced, z: Floats) -> float:
    """a(u_m, Pz), the anchors' work; zero without."""
    anchor = condensation.operators.anchor
    return 0.0 if anchor is None else float(z @ (anchor * push.x[condensation.retained]))


def advance(condensation: Condensation, before: State, after: State, d: Floats, given: Floats) -> Ledger:
    """The ledger after a step of increments d, in which the parts `given` (terms, block) of the slips were given."""
    past, last, now = before.ledger, before.data, after.data
    force, change, motion = now.force, now.force - last.force, condensation.system.motion
    lost, work = dashpots(condensation.system, d, last.t, now.t)
    work += float((after.lam * given).sum()) - float(after.p @ (now.remaining_gap - last.remaining_gap))
    if motion is not None:
        moved = now.push - last.push
        x, z = moved.x[condensation.retained], after.y + now.push.x[condensation.retained]
        force, d, change = force + now.push, d + x, change + moved
        work += motion.pair(now.field, now.field - last.field) + _anchor_work(condensation, moved, z)
        work -= float(after.unbalanced @ x)
    # The work of the force on the displacement inside, and on the unknowns that are kept.
    work += force.work_inside(change) + float(force.retained @ d)
    loss, between = losses(before, after)
    return Ledger(
        energy=energy(condensation, after.y, now, after.p),
        dissipated=past.dissipated + float(loss.sum()) + lost,
        work=past.work + work,
        worn=past.worn + loss,
        slipped=past.slipped + lengths(after.slip),
        # With the mean rate of the step the loss of dashpots is of second order.
        dissipated_second_order=past.dissipated_second_order + float(between.sum()) + lost,
        worn_second_order=past.worn_second_order + between,
    )


def losses(before: State, after: State) -> tuple[Floats, Floats]:
    """(terms,) lam . s of a step, and the same with weights averaged over both its ends.

    lam . s is w |s| but for rounding, and stays small where a slip is rounding under a large weight.
    """
    w, loss = after.weights, np.maximum(np.einsum("mb,mb->m", after.lam, after.slip), 0.0)
    if np.array_equal(before.bound, w) and np.array_equal(after.bound, w):
        return loss, loss
    # |s|, by the forces that slip takes; by itself where the weight has vanished at the end of the step.
    way = np.divide(loss, w, out=lengths(after.slip).copy(), where=w > 0)
    return loss, np.maximum(0.5 * (before.bound + after.bound) * way, 0.0)


def dragged(system: System, span: tuple[float, float], p: Floats, past: Floats) -> tuple[Floats, Floats, Floats]:
    """Multipliers and slips (q, block) and weights (q,) of terms that supports drag along between two instants."""
    terms, (s, t) = system.dragged, span
    if terms is None:
        return np.zeros((0, system.block)), np.zeros((0, system.block)), np.zeros(0)
    last, now = (terms.position(r).reshape(terms.count, terms.block) for r in (s, t))
    slip, extent = now - last, np.maximum(np.abs(last), np.abs(now)).max(axis=1)
    slip[lengths(slip) <= DRAG_ROUNDING * extent] = 0.0
    w = terms.weights(t, p, past, lengths(slip))
    return w[:, None] * directions(slip, lengths(slip)), slip, w


def dashpots(system: System, d: Floats, s: float, t: float) -> tuple[float, float]:
    """What dashpots lose between two instants, and the work of supports that push against them."""
    damping, k = system.damping, t - s
    if damping is None or k == 0.0:
        return 0.0, 0.0
    lost, moved = float(d @ (damping.C @ d)) / k, damping.motion
    if moved is None:
        return lost, 0.0
    across = float(d @ (moved.dirichlet_force(t) - moved.dirichlet_force(s))) / k
    own = (moved.stored(t, t) - 2.0 * moved.stored(s, t) + moved.stored(s, s)) / k
    return lost + 2.0 * across + own, across + own


def state_given(run: PreparedRun, now: StepData, y: Floats, past: Ledger | None = None) -> State:
    """The state y (n,), whatever led to it: as far as is known nothing presses, and without `past` nothing slipped."""
    system, operators, kept = run.system, run.operators, y[run.condensation.retained]
    none, past, m = np.zeros(len(operators.compliance)), past or Ledger.opening(0.0, run.terms), operators.count
    w = np.zeros(0) if system.norms is None else system.norms.weights_under(now.t, none, past.slipped[:m])
    _, _, others = dragged(system, (now.t, now.t), none, past.slipped[m:])
    weights, nothing = np.append(w, others), np.zeros((run.terms, operators.block))
    ledger = replace(past, energy=energy(run.condensation, kept, now, none))
    return State(
        t=now.t,
        y=kept,
        unbalanced=now.force.retained - operators.force(kept),
        data=now,
        weights=weights,
        bound=weights,
        lam=nothing,
        p=none,
        slip=nothing,
        sticks=np.ones(run.terms, dtype=bool),
        certificate=Certificate(0.0, np.zeros(operators.count), 0.0, none),
        ledger=ledger,
        scale=ledger.norm,
        full=y,
    )
