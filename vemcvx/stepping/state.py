"""States, the data of a run, and the ledger of energies.

Let f be the outer forces. The displacement is u = P y + u_D(t) with the unknowns y and a matrix P. The supports
prescribe u_D. The elastic form is a(u, v) = u'A v. In a step, d marks the change of a quantity, and n marks the value
at the end. Norm terms have the slips s_i = B_i dy + dh_i, the weights w_i and the forces lam_i. The supports and the
ground prescribe h. The limits D y <= g have the forces p and the compliances c. The ledger of a step has

    energy E = 1/2 a(u, u) + (c p^2 / 2 of soft limits)
    work     = f_n . dy + a(u_n, du_D) + lam . dh - p . dg
    loss     = sum_i lam_i . s_i

In equilibrium, work - dE - loss = 1/2 a(du, du) + p . dz - d(c p^2 / 2) with z = D y - g.

A contact node with a prescribed motion adds w |dh| to loss and work. In a step of length k, dashpots with the form
b(u', v) dissipate b(du, du) / k. Moving supports do the work b(du, du_D) / k against dashpots.

Loss and work are accurate to first order in k. With the weights w_i,prev at the beginning of the step, and the energy
E_0 at the beginning of the run, the following sums are accurate to second order:

    loss = sum_i (w_i + w_i,prev) / 2 |s_i|,        work = E - E_0 + loss

Large terms of E cancel if the supports move a body far. With K = P'A P and m = P'A u_D, we split u = u_m + P q:

    u_m = P x_m + u_D,   K x_m = -m,     a(u_m, Pv) = 0 for all v,

    E = 1/2 a(u_m, u_m) + 1/2 q'Kq,      a(u_n, du_D) = a(u_m,n, du_m) + (held - f_n) . dx_m

Here held = f_n - m_n - K y_n is the sum of the forces of friction, limits and dashpots. If K has a kernel, anchors
(:mod:`vemcvx.program.kernel`) add the stiffness K_a. Then (K + K_a) x_m = -m, and a(u_m, Pv) = -v'K_a x_m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Bools, Floats, directions, lengths
from vemcvx.base.errors import SceneError
from vemcvx.program.certificate import ROUNDED, Certificate
from vemcvx.program.condensation import Condensation, Reduced
from vemcvx.program.operators import Operators, product
from vemcvx.program.system import DRAG_ROUNDING, System
from vemcvx.solvers import Solver
from vemcvx.solvers.default import RunSolver
from vemcvx.solvers.solver import INNER_FRACTION

NORM_ROUNDING = float(np.sqrt(ROUNDED))
"""Rounding error of the energy norm sqrt(2 E), relative to the root of the largest term of E."""

SMALLEST_NORM, LARGEST_NORM = 1e-125, 1e125
"""The accepted range of energy norms."""


def check_norm(norm: float, t: float) -> float:
    """Return the energy norm, or raise SceneError for norms out of range."""
    if SMALLEST_NORM <= norm <= LARGEST_NORM:
        return norm
    raise SceneError(
        f"data: loads and motions in the step to t = {t:.6g} have an energy norm of {norm:.1e}; it must be between "
        f"{SMALLEST_NORM:.0e} and {LARGEST_NORM:.0e}, or energies and errors overflow or underflow. Take other "
        "units of force or length, and set negligible loads and motions to zero."
    )


@dataclass(frozen=True, kw_only=True)
class StepData:
    """The data of a system at an instant."""

    t: float
    force: Reduced  # load minus Dirichlet force
    prescribed_slip: Floats  # (m * block,) slip of supports minus the displacement of the ground
    remaining_gap: Floats  # (r,) gaps of the limits at y = 0
    ground: Floats | None  # (m * block,) displacement of the ground
    push: Reduced  # the Dirichlet force alone
    field: Floats  # (n_u,) u_m minus a rigid motion; empty if no support moves

    @classmethod
    def evaluate(cls, condensation: Condensation, t: float) -> StepData:
        """Return the data at the instant `t`."""
        system, motion = condensation.system, condensation.system.motion
        force = condensation.reduce(system.force(t), "load")
        if not force.norm <= LARGEST_NORM:
            check_norm(force.norm, t)
        push, field = force - force, np.zeros(0)
        if motion is not None:
            push = condensation.reduce(motion.dirichlet_force(t), "supports")
            field = motion.frame(t, -condensation.response(push))
        slip, gap, ground = system.slip_of_supports(t), system.remaining_gap(t), system.ground(t)
        return cls(t=t, force=force, prescribed_slip=slip, remaining_gap=gap, ground=ground, push=push, field=field)


@dataclass(frozen=True, eq=False)
class Frame:
    """The condensed system and the solver for steps of one length."""

    condensation: Condensation
    solver: Solver

    @cached_property
    def prepared(self) -> RunSolver:
        """The prepared solver."""
        return RunSolver.prepare(self.solver, self.condensation.operators)


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedRun:
    """The data that all steps of a run share."""

    system: System
    elastic: Frame  # the system without damping
    solver: Solver
    check: bool
    default: bool  # True for the default solver
    condense: bool
    viscous: dict[str, Frame] = field(default_factory=dict)  # by step length

    @property
    def condensation(self) -> Condensation:
        """The condensed system without damping."""
        return self.elastic.condensation

    @property
    def operators(self) -> Operators:
        """The operators of the condensed system without damping."""
        return self.condensation.operators

    @property
    def terms(self) -> int:
        """The number of norm terms, including terms dragged by supports."""
        return self.operators.count + (0 if self.system.dragged is None else self.system.dragged.count)

    def frame(self, k: float) -> Frame:
        """Return the frame for steps of length k."""
        system, key = self.system, f"{k:.11e}"
        if not system.is_viscous or k == 0.0:
            return self.elastic
        if key not in self.viscous:
            K = system.K if system.damping is None else sp.csr_matrix(system.K + system.damping.C / k)
            limits = system.limits
            if limits is not None:  # Compliances of limits on velocities become displacement per force.
                limits = replace(limits, compliance=np.where(limits.rates, k, 1.0) * limits.compliance)
            alone = replace(system, K=K, damping=None, motion=None, limits=limits)
            self.viscous.clear()  # Only one factor is stored.
            self.viscous[key] = Frame(Condensation(alone, self.condense, self.condensation.linear), self.solver)
        return self.viscous[key]


@dataclass(frozen=True, kw_only=True)
class Ledger:
    """The energy at an instant, and the dissipation and work since the beginning of the run."""

    energy: float = 0.0
    dissipated: float = 0.0
    work: float = 0.0
    worn: Floats  # (terms,) cumulative lam_i . s_i
    slipped: Floats  # (terms,) cumulative |s_i|
    dissipated_second_order: float = 0.0
    worn_second_order: Floats  # (terms,) `worn` by the trapezoidal rule

    @property
    def norm(self) -> float:
        """The energy norm |u|_a = sqrt(2 E)."""
        return math.sqrt(2.0 * max(self.energy, 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """The state at an instant. The m norm terms come first in arrays, then the terms of `DraggedTerms`."""

    t: float
    y: Floats  # the retained unknowns
    unbalanced: Floats  # load - K y
    data: StepData
    weights: Floats  # (terms,) weights of the last step
    bound: Floats  # (terms,) weights after all slips up to t
    lam: Floats  # (terms, block) multipliers of the terms
    p: Floats  # (r,) forces of the limits
    slip: Floats  # (terms, block) slips of the last step
    sticks: Bools  # (terms,) True if the certificate cannot distinguish the slip from zero
    certificate: Certificate
    ledger: Ledger
    scale: float  # largest energy norm of the states so far
    size: float = 0.0  # largest energy norm that the data so far could cause
    iterations: int = 0
    status: str = ""  # status of the solver
    full: Floats | None = None  # (n,) all unknowns; None before certification in full
    velocity: Floats | None = None  # (n,) increments divided by the length of the step, in runs with damping
    earlier: tuple[float, Floats, Floats] | None = None  # t, lam and p at the beginning of the step

    @property
    def unknowns(self) -> Floats:
        """All unknowns (n,) of a state that is certified in full."""
        if self.full is None:
            raise LookupError("state: the interior unknowns are not recovered; certify_in_full() recovers them.")
        return self.full

    def predict_multipliers(self, t: float, m: int) -> tuple[Floats, Floats]:
        """Return lam (m terms) and p, extrapolated linearly to the next instant `t`."""
        before, lam, p = self.earlier or (self.t, self.lam, self.p), self.lam, self.p
        share = min(1.0, (t - self.t) / (self.t - before[0])) if before[0] < self.t else 0.0
        if share > 0.0:
            lam, p = lam + share * (lam - before[1]), np.maximum(p + share * (p - before[2]), 0.0)
        return lam[:m], p

    def unit(self, accuracy: float) -> float:
        """Return the reference norm of relative errors: see :mod:`vemcvx.stepping.backward_euler`."""
        return self.size if self.scale <= max(accuracy, NORM_ROUNDING) * self.size else self.scale


def certify_together(run: PreparedRun, states: Sequence[State]) -> list[State]:
    """Return states with all unknowns and with certificates of the full system."""
    if not states:
        return []
    condensation, system, accuracy, m = run.condensation, run.system, run.solver.accuracy, run.operators.count
    forces = [state.data.force for state in states]
    held = [condensation.full.multiplier_force(state.lam[:m], state.p) for state in states]
    push = np.array([force.phi - own for force, own in zip(forces, held, strict=True)]).T
    size = np.array([np.abs(force.phi) + np.abs(own) for force, own in zip(forces, held, strict=True)]).T
    most = [0.5 * (INNER_FRACTION * accuracy * state.unit(accuracy)) ** 2 for state in states]

    def residual(y: Floats) -> Floats:
        r: Floats = push - system.K @ y
        return r if (N := condensation.full.kernel) is None else r - N @ (N.T @ r)

    xi, kept = (np.array(rows).T for rows in ([force.xi for force in forces], [state.y for state in states]))
    y = condensation.complete(xi, kept)
    r, rounding = residual(y), condensation.full.rounding(size, np.abs(y))
    energies, floors = np.zeros(len(states)), condensation.full.energies_of_rounding(rounding)
    if (np.abs(r) > rounding).any():
        energies = 0.5 * condensation.factor.energies_of_columns(r)
    if (energies > most).any():
        y = y + condensation.solve_interior(r)
        energies = 0.5 * condensation.factor.energies_of_columns(residual(y))

    found = []
    for state, full, energy, floor in zip(states, y.T, energies.tolist(), floors.tolist(), strict=True):
        own = state.certificate
        larger = replace(own, equilibrium=max(energy, own.equilibrium), floor=max(floor, own.floor))
        found.append(replace(state, full=full, certificate=larger))
    return found


def certify_in_full(run: PreparedRun, state: State) -> State:
    """Return a state with all unknowns and the certificate of the full system."""
    return certify_together(run, [state])[0] if state.full is None else state


def energy(condensation: Condensation, y: Floats, now: StepData, p: Floats) -> float:
    """Return 1/2 a(u, u) plus the energy of soft limits."""
    operators, motion, load = condensation.operators, condensation.system.motion, now.force
    stored = operators.compliance - condensation.system.dashpots
    square, kernel = float(p @ (stored * p)), operators.kernel
    if kernel is not None:
        y = y - kernel @ (kernel.T @ y)  # Remove rigid motions, which may be large and cost digits.
    if motion is not None:
        y, load = y + now.push.released, load + now.push
        square += motion.pair(now.field, now.field) + 2.0 * _anchor_work(condensation, now.push, y)
    return 0.5 * (square + load.work_inside(load) + float(y @ product(operators.K, y)))


def _anchor_work(condensation: Condensation, push: Reduced, z: Floats) -> float:
    """Return a(u_m, P z) for a motion z of the retained unknowns."""
    anchor = condensation.anchor
    return 0.0 if anchor is None else float(z @ (anchor * push.released))


def advance(condensation: Condensation, before: State, after: State, d: Floats, given: Floats) -> Ledger:
    """Return the ledger after a step with dy = `d` and dh = `given`."""
    past, last, now = before.ledger, before.data, after.data
    force, change, motion = now.force, now.force - last.force, condensation.system.motion
    lost, work = dashpot_losses(condensation.system, d, last.t, now.t)
    lost += (now.t - last.t) * float(after.p @ (condensation.system.dashpots * after.p))
    work += float((after.lam * given).sum()) - float(after.p @ (now.remaining_gap - last.remaining_gap))
    if motion is not None:
        moved = now.push - last.push
        x, z = moved.released, after.y + now.push.released
        force, d, change = force + now.push, d + x, change + moved
        work += motion.pair(now.field, now.field - last.field) + _anchor_work(condensation, moved, z)
        work -= float(after.unbalanced @ x)
    work += force.work_inside(change) + float(force.retained @ d)
    loss, between = losses(before, after)
    if condensation.system.reads_rates:
        between = loss  # Weights use the mean slip rate, so `loss` is accurate to second order.
    return Ledger(
        energy=energy(condensation, after.y, now, after.p),
        dissipated=past.dissipated + float(loss.sum()) + lost,
        work=past.work + work,
        worn=past.worn + loss,
        slipped=past.slipped + lengths(after.slip),
        # `lost` follows from mean velocities, and is accurate to second order.
        dissipated_second_order=past.dissipated_second_order + float(between.sum()) + lost,
        worn_second_order=past.worn_second_order + between,
    )


def losses(before: State, after: State) -> tuple[Floats, Floats]:
    """Return the losses (terms,) of a step: lam . s, and (w + w_prev) / 2 |s|."""
    w, loss = after.weights, np.maximum(np.einsum("mb,mb->m", after.lam, after.slip), 0.0)
    if np.array_equal(before.bound, w) and np.array_equal(after.bound, w):
        return loss, loss
    # Take loss / w for |s|, except where w is zero.
    size = np.divide(loss, w, out=lengths(after.slip).copy(), where=w > 0)
    mean = 0.5 * (before.bound + after.bound)
    # A term with an infinite weight has no mean weight: keep lam . s.
    return loss, np.maximum(np.multiply(mean, size, out=loss.copy(), where=mean < np.inf), 0.0)


def evaluate_dragged(
    system: System, span: tuple[float, float], p: Floats, past: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the multipliers, slips and weights of dragged terms in a step."""
    terms, (s, t) = system.dragged, span
    if terms is None:
        return np.zeros((0, system.block)), np.zeros((0, system.block)), np.zeros(0)
    last, now = (terms.position(r).reshape(terms.count, terms.block) for r in (s, t))
    slip, extent = now - last, np.maximum(np.abs(last), np.abs(now)).max(axis=1)
    slip[lengths(slip) <= DRAG_ROUNDING * extent] = 0.0
    w = terms.weights(t, p, past, lengths(slip) / (t - s) if terms.rates and t > s else lengths(slip))
    return w[:, None] * directions(slip, lengths(slip)), slip, w


def dashpot_losses(system: System, d: Floats, s: float, t: float) -> tuple[float, float]:
    """Return the loss of dashpots, and the work of supports against dashpots."""
    damping, k = system.damping, t - s
    if damping is None or k == 0.0:
        return 0.0, 0.0
    lost, moved = float(d @ (damping.C @ d)) / k, damping.motion
    if moved is None:
        return lost, 0.0
    across = float(d @ (moved.dirichlet_force(t) - moved.dirichlet_force(s))) / k
    own = (moved.stored(t, t) - 2.0 * moved.stored(s, t) + moved.stored(s, s)) / k
    return lost + 2.0 * across + own, across + own


def make_given_state(run: PreparedRun, now: StepData, y: Floats, past: Ledger | None = None) -> State:
    """Return the state with unknowns y (n,) and without friction forces."""
    system, operators, kept = run.system, run.operators, y[run.condensation.retained]
    none, zeros, m = np.zeros(len(operators.compliance)), np.zeros(run.terms), operators.count
    past = past or Ledger(worn=zeros, slipped=zeros, worn_second_order=zeros)
    w = np.zeros(0) if system.norms is None else system.norms.weights_under(now.t, none, past.slipped[:m])
    _, _, others = evaluate_dragged(system, (now.t, now.t), none, past.slipped[m:])
    weights, nothing = np.append(w, others), np.zeros((run.terms, operators.block))
    stored = operators.compliance - system.dashpots
    depth = np.maximum(operators.D @ kept - now.remaining_gap, 0.0)
    pressed = np.divide(depth, stored, out=none.copy(), where=stored > 0)
    ledger = replace(past, energy=energy(run.condensation, kept, now, pressed))
    return State(
        t=now.t,
        y=kept,
        unbalanced=now.force.retained - operators.force(kept),
        data=now,
        weights=weights,
        bound=weights,
        lam=nothing,
        p=pressed,
        slip=nothing,
        sticks=np.ones(run.terms, dtype=bool),
        certificate=Certificate(0.0, np.zeros(operators.count), 0.0, none),
        ledger=ledger,
        scale=ledger.norm,
        full=y,
    )
