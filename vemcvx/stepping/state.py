"""The state of a run after a step, its ledger of energies, and what a run prepares once.

The ledger of backward Euler is kept on the retained unknowns:

energy E = 1/2 a(u, u),   u = P y + u_D(t);  soft limits add c p^2 / 2
work     = load_n . dy + a(u_n, du_D) + lam . dc - p . dg,    g = e - D^u_D
           (forces and reactions at the end of the step; this load is without the Dirichlet force; c is the motion of
           supports along norm terms, less that of the ground, which friction pulls along; g is the remaining gap at
           y = 0, which shrinks where supports move towards limits, or obstacles towards the body: they push)
loss     = sum_i lam_i . s_i, which is w_i |s_i| + c_i . s_i at a solution, kept term by term, too: friction work, which
           wears what rubs (Archard 1953)
identity   work - dE - loss = 1/2 a(du, du) + p . dz  step by step, for every balanced answer, z = D^u - e. For bounds
           the last term is -p . z_prev >= 0; for soft limits, less the change of their energy, at least c (dp)^2 / 2

Between the instants. Forces at the end of a step do O(k) too much work, even where the states at both ends are exact,
and friction whose bound changes in a step loses O(k) too much or too little. Of second order are, with weights w (of
laws that read slips, at the slips of the instants) and biases c averaged over both ends of a step,

loss       = sum_i ( (w_i + w_i,prev) / 2 |s_i| + (c_i + c_i,prev) / 2 . s_i )     what slips is at its bound
work       = E - E_0 + loss                                                        the balance of the continuum

(the trapezoidal rule on the loss of a monotone slip; the work, where it is asked of forces, would be the mean of both
ends' times the increment, which is dE + (lam + lam_prev) / 2 . s + (p + p_prev) / 2 . dz for balanced states: as much,
but for what happens in the one step in which a place begins to slip, to touch or to open.) Where w and c are constant
and slips are those of the continuum both are exact.

Supports that carry a body far, and strain it little, would leave the energy to the cancellation of 1/2 y'Ky + y'm +
1/2 a(u_D, u_D), m = P'A u_D. So a state is split, u = u_m + P z, into what the supports alone bring about,

    u_m = P x_m + u_D,   K x_m = -m,   and the rest   K z = load + [0; rho]:     a(u_m, Pv) = 0 for all v,

    E = 1/2 a(u_m, u_m) + 1/2 z'Kz,    a(u_n, du_D) = a(u_m,n, du_m) + (held - load_n) . dx_m

with held = B'lam + D'p, and a(u_m, .) of fields seen from the body (:class:`vemcvx.program.system.Motion`). Where K has
a kernel x_m comes of K + E, E the anchors' stiffness, and a(u_m, Pv) = -v'E x_m.

When friction that weakens with slip leaves a step convex. With Phi_i the integral of the weights w_i over the slip of
the step, a step minimises

    1/2 d'Kd - g'd + sum_i Phi_i(|s_i|),     s = B d - b.

Weights that fall no faster than k_i per slip make Phi_i + k_i |s_i|^2 / 2 convex, and the step is strongly convex where
the sum of these squares is less than the elastic energy: with

    rho = the largest eigenvalue of  k^{1/2} B K^{-1} B' k^{1/2},      sum_i k_i |(B d)_i|^2 <= rho d'Kd,

as long as rho < 1. In a block of height H and shear modulus mu that shears uniformly that is k < mu / H per area: the
stability of a spring and a slider; other motions of a block may be softer, and rho larger. The margin 1 - rho does not
depend on the length of steps. Without one a step may have several answers, or jump: what is found is then an estimate,
which a warning says.

Theorem. Let rho < 1, and let (d_k, lam, p) be certified under the weights w' of its own slip by gap = 1/2
|r|^2_{K^{-1}} + C. Then the step has one solution d, and  |d_k - d|_K <= sqrt(2 gap) / (1 - rho). Proof. With e = d_k -
d:  |e|^2_K = -r.e - (lam - lam*).Be - (p - p*).De. Up to C, the last term is <= 0, and the one before it at most
sum (w'_i - w*_i)(|s*_i| - |s_i|) <= sum k_i (|s_i| - |s*_i|)^2 <= sum k_i |(Be)_i|^2 <= rho |e|^2. So
(1 - rho) |e|^2 <= |r| |e| + C, with |r| |e| <= |r|^2 / 2(1 - rho) + (1 - rho) |e|^2 / 2.  QED  (One solution: between
two of them r = 0 and C = 0.)

The iteration w_{k+1} = law(s(T(w_k))) of :mod:`vemcvx.stepping.fixed_point` shrinks increments by rho if weights do not
rise faster than k, either. A law that reads the slip before the step alone has k = 0: the certificate of its one
program is the step's.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.linalg import eigh

from vemcvx.arrays import EPS, Bools, Floats, lengths
from vemcvx.errors import SceneWarning
from vemcvx.linear import LinearSolver, residual
from vemcvx.program.certificate import Certificate
from vemcvx.program.condensation import Condensation, Reduced, needs_refinement
from vemcvx.program.operators import Norms, Operators, product
from vemcvx.program.scaling import LARGEST_NORM, Scaling, checked_norm
from vemcvx.program.step_program import Answer
from vemcvx.program.system import System, on_part
from vemcvx.solvers import Prepared, Solver, Solves, choose_solver
from vemcvx.solvers.semidefinite import ProximalPoints
from vemcvx.solvers.sets_system import Response
from vemcvx.solvers.solver import named_failures


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
    bias: Floats  # (m * block,) c of one-way friction
    ground: Floats | None = None  # (m * block,) the motion of the ground, subtracted in `prescribed_slip`
    carried: Carried | None = None  # None if no supports move

    def still_as(self, other: StepData) -> bool:
        """Return True if nothing differs between the two instants."""
        one, two = self.carried, other.carried
        return (
            self.force.same(other.force)
            and np.array_equal(self.prescribed_slip, other.prescribed_slip)
            and np.array_equal(self.remaining_gap, other.remaining_gap)
            and np.array_equal(self.bias, other.bias)
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
        return float(np.sqrt(2.0 * np.maximum(self.energy, 0.0)))


@dataclass(frozen=True)
class Rubbed:
    """Friction in a step: multipliers and slips (m, block), weights (m,) of the step, and bounds at both its ends."""

    lam: Floats  # c + lam of the program, at the end of the step
    slip: Floats
    weights: Floats
    bounds: tuple[Floats, Floats]
    """(m,) weights at the slips of both ends: those of a step may be of the slip before it"""
    biases: tuple[Floats, Floats]

    @cached_property
    def loss(self) -> Floats:
        """(m,) lam . s: what friction loses under the forces at the end of the step."""
        loss: Floats = np.maximum(np.einsum("mb,mb->m", self.lam, self.slip), 0.0)
        return loss

    @property
    def loss_second_order(self) -> Floats:
        """(m,) the loss with bounds and biases averaged over both ends of the step.

        (lam - c) . s is w |s| but for rounding, and stays small where a slip is rounding under a large weight.
        """
        (before, after), (bias_before, bias), w = self.bounds, self.biases, self.weights
        tilted = bias_before.any() or bias.any()
        rubs = np.einsum("mb,mb->m", self.lam - bias, self.slip) if tilted else self.loss
        if not tilted and np.array_equal(before, w) and np.array_equal(after, w):
            return rubs
        # |s|, by the forces that slip takes; by itself where the weight has vanished at the end of the step.
        way = np.divide(rubs, w, out=lengths(self.slip).copy(), where=w > 0)
        loss: Floats = 0.5 * (before + after) * way
        if tilted:
            loss = loss + np.einsum("mb,mb->m", 0.5 * (bias_before + bias), self.slip)
        return np.maximum(loss, 0.0)


def step_data(system: System, condensation: Condensation, t: float) -> StepData:
    """Evaluate load and supports at `t`."""
    forces, rows = system.load_on_part(t)
    data = StepData(
        t=t,
        force=in_range(condensation.reduce(forces, rows=rows), t),
        prescribed_slip=system.prescribed_slip(t),
        remaining_gap=system.remaining_gap(t),
        bias=system.bias(t),
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
        none = np.zeros_like(y)
        return 0.5 * float(y @ -residual(none, system.K, y, none))
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


def advance_in_full(
    system: System,
    past: Ledger,
    between: tuple[StepData, StepData],
    y: tuple[Floats, Floats],
    answer: Answer,
    rubbed: Rubbed,
) -> Ledger:
    """The ledger after a step of which all unknowns (n,) are known, `y` before and after.

    The factors and S, which may be too coarse for energies, take no part: products with K itself, in extended
    precision. With held = load - P'A u_n,  load . dy + a(u_n, du_D) = held . dy + a(u_n, du).
    """
    (last, now), (start, end), motion = between, y, system.motion
    d = end - start
    work = -float(answer.p @ (now.remaining_gap - last.remaining_gap))
    if motion is None:
        work += float(now.force.phi @ d)
    else:
        seen, then = motion.frame(now.t, end), motion.frame(last.t, start)
        work += motion.pair(seen, seen - then) + float(system.multiplier_force(answer.lam, answer.p) @ d)
    work += float(answer.lam.ravel() @ (now.prescribed_slip - last.prescribed_slip))
    return _after_step(past, energy_in_full(system, end, now.t, answer.p), work, rubbed)


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


STABLE = 0.999  # rho beyond which the rounding of answers counts for more than a thousand times itself.


@dataclass(frozen=True)
class Stability:
    """rho, and the term that has most of its eigenvector."""

    rho: float
    worst: int

    @property
    def margin(self) -> float:
        """1 - rho where steps are convex with rho < STABLE, else 0."""
        return 1.0 - self.rho if self.rho < STABLE else 0.0


def stability_of(operators: Operators, norms: Norms) -> Stability | None:
    """The stability of norm terms; a warning where they are not stable."""
    found = stability(operators, norms.softening)
    if found is not None and found.margin == 0.0:
        warnings.warn(
            f"friction: weights may fall faster with slip than the body gives way, most at {norms.name(found.worst)} "
            f"(softening over stiffness is {found.rho:.3g}; less than {STABLE:g} makes steps convex). A step may have "
            "several answers, or jump, and certificates are estimates. Take a law that falls over a longer slip, a "
            "stiffer body, or a law that reads the slip before the step alone.",
            SceneWarning,
            stacklevel=2,
        )
    return found


def stability(operators: Operators, softening: Floats | None) -> Stability | None:
    """The stability of weights that fall with the slip of a step by `softening` (m,) at most; None if that is unknown.

    For bodies without supports rho is infinite: their rigid motions have no elastic energy. With an iterative linear
    solver it is unknown: B K^{-1} B' would take a solve for every row.
    """
    if softening is None or (softening.any() and not operators.factor.exact):
        return None
    falls = np.flatnonzero(softening)
    if len(falls) == 0:
        return Stability(0.0, 0)
    if operators.kernel is not None:
        return Stability(np.inf, int(np.argmax(softening)))
    block = operators.block
    rows = (falls[:, None] * block + np.arange(block)).ravel()
    root = np.repeat(np.sqrt(softening[falls]), block)
    B = operators.B[rows].toarray()
    M = root[:, None] * (B @ operators.factor.solve(np.ascontiguousarray(B.T))) * root
    value, vector = eigh(0.5 * (M + M.T), subset_by_index=[len(M) - 1, len(M) - 1])
    return Stability(float(value[0]), int(falls[np.argmax(np.abs(vector[:, 0])) // block]))


@dataclass(frozen=True, kw_only=True)
class PreparedRun:
    """The prepared run: data that all steps share."""

    system: System
    condensation: Condensation
    scaling: Scaling
    solver: Solver
    prepared: Prepared
    check: bool
    refines: bool  # True if the factors are too coarse for the accuracy, so that every step is refined

    default: bool = False  # nobody asked for the accuracy: an answer at the rounding floor is good enough

    share: float = 1.0  # of the solver's accuracy that steps are solved to, where answers are but a part of something

    @property
    def accuracy(self) -> float:
        """To which steps are solved."""
        return self.share * self.solver.accuracy

    @property
    def most(self) -> float:
        """Iterations that a step may take."""
        return self.solver.max_iterations

    def driven(self, t: float) -> StepData:
        """The data of the system at an instant."""
        return step_data(self.system, self.condensation, t)

    def after(self, iterations: int) -> PreparedRun:
        """The run whose solver has taken so many of them."""
        solver = self.solver.after(iterations) if iterations else self.solver
        return self if solver is self.solver else self.asking(solver)

    def asking(self, solver: Solver) -> PreparedRun:
        """The run that asks another solver."""
        return replace(self, solver=solver, prepared=prepared_solver(solver, self.scaling.operators, self.system))

    @cached_property
    def response(self) -> Response:
        """The response of norm terms and limits of the scaled operators to each other's forces."""
        return Response(self.scaling.operators)

    @cached_property
    def stability(self) -> Stability | None:
        """The stability of weights that fall with slip; None where their rate is unknown."""
        norms = self.system.norms
        return None if norms is None else stability_of(self.operators, norms)

    @property
    def operators(self) -> Operators:
        """The condensed operators, in the units of the system."""
        return self.condensation.operators


@dataclass(frozen=True)
class Dragged:
    """The friction of nodes that supports drag along, after a step: see :mod:`vemcvx.stepping.backward_euler`."""

    weights: Floats  # (q,)
    lam: Floats  # (q, block) multipliers, the bias included
    still: Bools  # (q,) which did not slip
    worn: Floats  # (q,) cumulative loss
    worn_second_order: Floats  # (q,) likewise, as the ledger has it
    slipped: Floats  # (q,) and cumulative slip

    @classmethod
    def nothing(cls, q: int, block: int) -> Dragged:
        """No loss and no weight."""
        none = np.zeros(q)
        nothing, still = np.zeros((q, block)), np.ones(q, dtype=bool)
        return cls(none, nothing, still, worn=none, worn_second_order=none, slipped=none)


@dataclass(frozen=True)
class Earlier:
    """The step before: from it and its own a state expects the next one."""

    t: float
    lam: Floats  # (m, block)
    p: Floats  # (r,)
    y: Floats  # (m,)

    def share(self, now: float, t: float) -> float:
        """Part of what has changed since, up to `now`, that is expected to change once more up to `t`."""
        return min(1.0, (t - now) / (now - self.t)) if self.t < now else 0.0


@dataclass(frozen=True, kw_only=True)
class State:
    """Everything known at an instant, on the retained unknowns; `full`, once it is asked for, on all."""

    t: float
    y: Floats  # (m,)
    unbalanced: Floats  # (m,) load - K y, which norm terms and limits balance
    data: StepData
    weights: Floats  # (m,) of the step that led here
    bound: Floats  # (m,) weights at the slip after it, where a law reads slips
    lam: Floats
    p: Floats  # (r,) forces of the limits
    slip: Floats  # (m, block) s of the step that led here
    certificate: Certificate
    ledger: Ledger
    scale: float  # largest energy norm of the states so far
    iterations: int
    status: str = ""  # in the solver's own words
    safeguards: int = 0  # how many of the iterations stood in for faster ones
    rate: float = np.nan  # estimated constant of contraction of the fixed point, where weights depend on the answer
    full: Floats | None = None  # (n,) `unknowns`, once somebody has asked for them
    size: float = 0.0  # largest energy norm that the data could cause; computed only while the states are far smaller
    noise: float = 0.0  # largest energy norm that friction alone could cause, of a state that is its rounding
    earlier: Earlier | None = None  # multipliers of the step before, if there was one
    dragged: Dragged = field(default_factory=lambda: Dragged.nothing(0, 1))  # before the step, while it is on
    velocity: Floats | None = None  # (n,) their increments over the length of the step, where rates cost

    @classmethod
    def still(cls, operators: Operators, data: StepData, y: Floats, weights: Floats, energy: float = 0.0) -> State:
        """The state y (m,) with that energy, whatever led to it: as far as is known, nothing slipped or pressed."""
        nothing, none = np.zeros((operators.count, operators.block)), np.zeros(len(operators.compliance))
        ledger = Ledger.opening(energy, operators.count)
        return cls(
            t=data.t,
            y=y,
            unbalanced=data.force.retained - operators.force(y),
            data=data,
            weights=weights,
            bound=weights,
            lam=nothing,
            p=none,
            slip=nothing,
            certificate=Certificate(0.0, np.zeros(operators.count), 0.0, none),
            ledger=ledger,
            scale=ledger.norm,
            iterations=0,
        )

    @property
    def bias(self) -> Floats:
        """c (m, block) of one-way friction."""
        return self.data.bias.reshape(self.lam.shape)

    @property
    def unknowns(self) -> Floats:
        """(n,) all unknowns, of a state that is certified in full."""
        if self.full is None:
            raise LookupError("state: the unknowns inside are not recovered; certified_in_full() does.")
        return self.full

    def answer(self, d: Floats, lam: Floats, p: Floats) -> Answer:
        """An answer (d, lam, p) that took what this state took."""
        return Answer(d=d, lam=lam, p=p, iterations=self.iterations, status=self.status, safeguards=self.safeguards)

    def expected(self, t: float) -> tuple[Floats, Floats]:
        """Multipliers (m, block) and (r,) to begin with at the next instant `t`: they go on as they changed last.

        That is in proportion to time, by no more than they changed then, and p >= 0. On the paper's scene,
        h = k = 1/256, a second active set is then needed in 19 steps instead of 116.
        """
        before = self.earlier
        share = 0.0 if before is None else before.share(self.t, t)
        if before is None or share == 0.0:
            return self.lam, self.p
        lam, p = self.lam + share * (self.lam - before.lam), self.p + share * (self.p - before.p)
        return lam, np.maximum(p, 0.0)

    def ahead(self, t: float) -> State:
        """The state moved on to what is expected at the next instant `t`: its motion goes on like the multipliers.

        What slips under Coulomb's law is at its bound and would seem to stick if it stood still: on 64 squares, 64
        steps take 109 and 131 systems of sets from there, and 219 and 211 from the state itself.
        """
        before = self.earlier
        share = 0.0 if before is None else before.share(self.t, t)
        if before is None or share == 0.0:
            return self
        lam, p = self.expected(t)
        return replace(self, y=self.y + share * (self.y - before.y), lam=lam, p=p)

    def unit(self, accuracy: float) -> float:
        """The energy norm that errors are relative to: see :mod:`vemcvx.stepping.posed_step`."""
        size = max(self.size, self.noise)
        return size if self.scale <= accuracy * size else self.scale

    def accepted(self, accuracy: float) -> bool:
        """Return True if the certified error is within the accuracy."""
        return self.certificate.error <= accuracy * self.unit(accuracy)


def sticking(run: PreparedRun, state: State) -> Bools:
    """Increments that the certificate cannot tell from zero: |s_i - s_i*| <= flexibility^{1/2} |d - d*|."""
    operators = run.operators
    if operators.count == 0:
        return np.zeros(0, dtype=bool)
    blur = EPS * np.abs(operators.blocks(operators.rows.absolute.read(np.abs(state.y)))).max(axis=1)
    error = state.certificate.error + state.certificate.error_floor
    sticks: Bools = lengths(state.slip) <= error * np.sqrt(operators.norm_flexibility) + blur
    return sticks


def prepared_solver(solver: Solver, operators: Operators, system: System) -> Prepared:
    """The solver, prepared for scaled operators; by proximal points where K has a kernel and it takes none."""
    with named_failures(solver.name):
        if operators.kernel is None or solver.semidefinite:
            return solver.prepare(operators)
        return ProximalPoints(solver, operators, follows=system.norms is not None and system.norms.ground is not None)


def prepare(
    system: System, solver: Solver | Solves | None, check: bool, condense: bool, linear: LinearSolver | None = None
) -> PreparedRun:
    """Factorise, condense, scale, and let the solver do what all steps share."""
    condensation = Condensation(system, condense, linear)
    chosen = choose_solver(condensation.operators, solver)
    prepared = prepared_solver(chosen, condensation.scaling.operators, system)
    refines = condensation.refinable and needs_refinement(condensation, chosen.accuracy)
    return PreparedRun(
        system=system,
        condensation=condensation,
        scaling=condensation.scaling,
        solver=chosen,
        prepared=prepared,
        check=check,
        refines=refines,
        default=solver is None,
    )
