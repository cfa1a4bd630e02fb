"""A step posed, scaled and answered, the state after it, and the test by which it is accepted.

States that are kept are recovered on all unknowns, refined where factors lost digits, and certified on the full system.

With y_n = y_{n-1} + d_n, the force out of balance after a step, g_n - K d_n, is carried into the next one,
g_{n+1} = (g_n - K d_n) + (load_{n+1} - load_n): increments keep their digits when steps are tiny beside y.

Errors are relative to the largest energy norm of the states so far. A body that is carried without touching, or held
completely, has no energy: its norm is rounding, and an accuracy relative to it means nothing. The energy norm that the
data can cause then takes its place. With x = K^{-1} f the displacement without contact and friction, f the load of the
instant, Dirichlet force included (so that x contains the rigid motion),

    size = x'x / |x|_{K^{-1}} = min { |v|_K : x'v = x'x },

the least energy norm of a field that takes the motion back in the mean, which contact or friction must spend to stop
the body. (Proof: x'v <= |x|_{K^{-1}} |v|_K, Cauchy and Schwarz, with equality for v along K^{-1}x. QED) It is an
energy norm in every system of units, at most |x|_K, zero for x = 0 only; and for the same motion it does not depend on
h, as x'x has one sum over the nodes and x'K^{-1}x two (while |x|_K grows like h^{-1/2}: supports that move tear at one
layer of cells). A state whose norm and certified error are both at most accuracy times the largest size so far is zero
at the accuracy asked. A body that moving ground carries along has no energy either, and the energy norm that the
ground can cause counts likewise (:func:`ground_norm`).
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import EPS, SAME, Bools, Floats, columns, lengths, power_of_two
from vemcvx.errors import NotCertified, SceneError
from vemcvx.linear import AT_ONCE, residual
from vemcvx.program.certificate import Certificate, limit_gaps, norm_gaps
from vemcvx.program.condensation import (
    Condensation,
    Reduced,
    full_certificate,
    needs_refinement,
    out_of_balance,
    refined,
    rounding,
)
from vemcvx.program.operators import Operators
from vemcvx.program.scaling import LARGEST_NORM, SMALLEST_NORM, checked_norm
from vemcvx.program.step_program import Answer, StepProgram, fitting
from vemcvx.program.tolerances import SHARE
from vemcvx.solvers import Solver
from vemcvx.solvers.newton import Shifts
from vemcvx.solvers.solver import named_failures
from vemcvx.stepping.ledger import Rubbed, StepData, advance, advance_in_full
from vemcvx.stepping.state import Earlier, PreparedRun, State

log = logging.getLogger("vemcvx")

TOGETHER = 8
"""States that are certified in full at once: of 8,256 unknowns in a third of the time that one by one take."""


def data_norm(condensation: Condensation, force: Reduced) -> float:
    """The size above, of what a force can cause."""
    x = force.x
    unit = float(power_of_two(np.abs(x).max(initial=0.0)))
    x = x / unit
    square, soft = float(x @ x), float(x @ condensation.factor.solve(x))
    return unit * square / float(np.sqrt(soft)) if square > 0 else 0.0


def data_norms(
    condensation: Condensation, now: StepData, norm: float, floor: float, accuracy: float
) -> tuple[float, float]:
    """The energy norms that the data, and the bias of friction, can cause, if the state is at the floor `floor`.

    Zero, unseen, where states of energy norm `norm` are not zero beside it.
    """
    size, noise = 0.0, 0.0
    if now.force.norm > 0.0 and norm <= accuracy * now.force.norm:
        size = data_norm(condensation, now.force)
    # The norm of a state at the rounding floor is at most ten floors.
    if now.tilted and norm <= 10.0 * floor:
        operators = condensation.operators
        noise = float(lengths(operators.blocks(now.bias)) @ np.sqrt(operators.norm_flexibility))
    return size, noise


def ground_norm(operators: Operators, ground: Floats | None, w: Floats) -> float:
    """The size of what ground that moves can cause.

    That is the least energy norm with which some B_i v goes as far as the ground under it, |g_i| / f_i^{1/2} with f_i
    the flexibility of the term; or if that is less, what all of friction can cause, sum_i w_i f_i^{1/2}.
    """
    if ground is None:
        return 0.0
    root = np.sqrt(operators.norm_flexibility)
    way = np.linalg.norm(operators.blocks(ground), axis=1)
    # No field goes anywhere where rows read nothing.
    far = np.divide(way, root, out=np.where(way > 0, np.inf, 0.0), where=root > 0)
    return float(min(far.max(initial=0.0), w @ root))


def require_certified(run: PreparedRun, state: State, n: int) -> None:
    """Raise NotCertified when the state after step `n` misses the solver's accuracy.

    Where nobody asked for one, nothing below the rounding floor is wanted. SceneError where limits contradict each
    other.
    """
    solver, certificate, unit = run.solver, state.certificate, state.unit(run.solver.accuracy)
    accuracy, norms = solver.accuracy, run.system.norms
    wanted = certificate.error <= accuracy * unit or (run.default and certificate.at_floor)
    # A relative rounding floor is also about how wrong K^{-1} is, and with it the certificate: beyond .1 it is none.
    if wanted and certificate.error_floor <= 0.1 * unit:
        return
    if not np.isfinite(certificate.error):
        _refuse_contradiction(run, state, n)
    parts = certificate.error + certificate.error_floor, certificate.error_floor
    reached, floor = ((part / unit if unit > 0 else np.inf) for part in parts)
    worst = ""
    # Where the gap is no number, or friction has none of it, it sits nowhere.
    if norms is not None and np.isfinite(certificate.error) and certificate.friction.max(initial=0.0) > 0:
        worst = f" The largest share of the gap sits at {norms.name(int(np.argmax(certificate.friction)))}."
    said = f" The solver said: {state.status}." if state.status else ""
    raise NotCertified(
        f"step {n} at t = {state.t:.6g}: {solver.name} reached a certified relative energy error of {reached:.1e}, "
        f"asked was {accuracy:.1e}.{said}{worst} "
        f"{_uncondensed(run)}{_advice(solver, reached, accuracy, floor)}. In Python check=False goes on regardless.",
        step=n,
        time=state.t,
        reached=reached,
        asked=accuracy,
        floor=floor,
    )


def _refuse_contradiction(run: PreparedRun, state: State, n: int) -> None:
    """Raise SceneError where no displacement meets all rigid limits: D'p = 0 and p . e < 0 for some p >= 0 (Farkas)."""
    from scipy.optimize import linprog  # Importing it takes a fifth of a second.

    limits, rigid = run.system.limits, np.flatnonzero(run.operators.compliance == 0)
    if limits is None or len(rigid) == 0:
        return
    e = state.data.remaining_gap[rigid]
    balanced: Any = sp.vstack([run.operators.D[rigid].T, sp.csr_matrix(np.ones((1, len(rigid))))])
    p = linprog(e, A_eq=balanced, b_eq=np.eye(balanced.shape[0])[-1]).x
    if p is None or not p @ e < -SAME * np.abs(e).max():
        return
    against = [limits.name(int(rigid[j])) for j in np.flatnonzero(p > SAME)]
    raise SceneError(
        f"step {n} at t = {state.t:.6g}: no displacement meets the limits at {' and '.join(against)}, which contradict "
        f"each other by {-(p @ e) / p.max():.6g}. Enlarge a gap, or give one of them a compliance."
    )


def refuse_unbalanced(program: StepProgram, condensation: Condensation, n: int, now: StepData) -> None:
    """Raise SceneError when no forces of friction and limits balance the load of step `n` on K's kernel."""
    operators, N, kernel = program.operators, program.operators.kernel, condensation.system.kernel
    motion = None if N is None else operators.kernel_balance.unbalanced_motion(program.w, N.T @ program.g)
    if kernel is None or N is None or motion is None:
        return
    field = N @ motion
    parts = np.linalg.lstsq(kernel.modes[condensation.retained], field, rcond=None)[0].astype(float)
    # Unknowns of a joint that read a jump move by less than the bodies themselves.
    field /= np.abs(kernel.modes @ parts).max()
    slip = operators.rows.read(field)
    bias = float(now.bias @ slip)  # The bias of one-way friction is part of g; of the load it is none.
    push = float(field @ program.g) + bias
    holds = float(program.w @ np.linalg.norm(operators.blocks(slip), axis=1)) + bias
    holds = holds if holds > 1e-12 * push else 0.0  # Less is rounding: no slip, or a bound that is zero one way.
    raise SceneError(
        f"step {n} at t = {now.t:.6g}: only friction and one-sided contact hold the body against {kernel.name(parts)}. "
        f"The load pushes it there with a force of {push:.6g} and friction holds {holds:.6g} at most: "
        f"{push - holds:.6g} are lacking, and there is no equilibrium. Change the load, raise the bound, add a "
        "support, or move the body by PrescribedDisplacement instead."
    )


def say_floor(floors: Floats, accuracy: float) -> None:
    """Log it when round-off may account for more than the accuracy asked; `floors` (N + 1,) are relative."""
    n = int(np.argmax(floors))
    if floors[n] > accuracy:
        log.info(
            "step %d: certified as computed, but round-off, that of the data's last digits included, may account for "
            "as much as %.1e of the energy norm, more than the accuracy %.1e asked for",
            n,
            floors[n],
            accuracy,
        )


def _uncondensed(run: PreparedRun) -> str:
    """Advice where condensation lost digits that refinement could not bring back."""
    condensation = run.condensation
    lost = condensation.operators.kernel is None and not (condensation.whole or run.refines)
    if not lost or not needs_refinement(condensation, run.solver.accuracy):
        return ""
    return (
        "The factors of the stiffness are too coarse, and where several limits or norm terms read the same unknown "
        "nothing is refined: condense=False loses fewer digits. Else: "
    )


def _advice(solver: Solver, reached: float, accuracy: float, floor: float) -> str:
    if floor > 0.1:
        return (
            f"Round-off in the last digits of the data alone may change the answer by {floor:.1e} of its energy norm: "
            "take data that are farther from singular, such as a Poisson ratio farther from .5 or less contrast"
        )
    if not reached < 0.5:
        return f"Nothing was answered that could be relied on: {solver.advice}"
    if floor > accuracy:
        return f"Round-off alone allows {floor:.1e}: ask for no more than that"
    return f"Ask for accuracy={2 * reached:.0e} or more, {solver.advice}"


def pose_step(run: PreparedRun, before: State, now: StepData, w: Floats | None = None) -> PosedStep:
    """Pose the step that leads from `before` to what drives the system now; with weights `w` (m,), if they are given.

    By default weights that depend on the answer follow the pressures of `before`, and slips so far.
    """
    if w is None:
        norms = run.system.norms
        w = np.zeros(0) if norms is None else norms.weights_under(now.t, before.p, before.ledger.slipped)
    g = before.unbalanced + (now.force.retained - before.data.force.retained)
    if now.tilted:
        g = g - run.operators.rows.force_of(now.bias)
    e = now.remaining_gap - run.operators.limits.read(before.y)
    b = before.data.prescribed_slip - now.prescribed_slip
    return PosedStep(run, before, StepProgram(run.operators, g, w, b, e), now)


@dataclass(frozen=True)
class PosedStep:
    """One step being solved.

    Where friction is one-way, |lam_i - c_i| <= w_i, its bias c is a force in the program, -B'c in g, and multipliers of
    the program are those of states less c.
    """

    run: PreparedRun
    before: State
    program: StepProgram
    data: StepData

    @property
    def bias(self) -> Floats:
        """c (m, block)."""
        return self.run.operators.blocks(self.data.bias)

    @property
    def biases(self) -> tuple[Floats, Floats] | None:
        """c before the step and at its end, where one is not zero."""
        return (self.before.bias, self.bias) if self.before.data.tilted or self.data.tilted else None

    def solve_balanced(self, n: int, share: float = 1.0, near: State | None = None) -> State:
        """The solution, as `solve` finds it, of step `n`.

        Where nothing balances the load on K's kernel there is none: solvers that are given the kernel are not asked
        then, and of proximal points the certificate is infinite.

        SceneError where nothing balances the load.
        """
        refuse = partial(refuse_unbalanced, self.program, self.run.condensation, n, self.data)
        if self.run.solver.semidefinite:
            refuse()
        state = self.solve(share, near)
        if not np.isfinite(state.certificate.gap):
            refuse()
        return state

    def solve(self, share: float = 1.0, near: State | None = None) -> State:
        """Ask, certify, and ask more sharply where the size of u_n shows that too little was asked.

        Errors are relative to |u_n|, which the first answer tells: a solver is asked three times, as long as gaps fall.
        A `share` of its accuracy is asked where the answer is but a part of something. It begins with the multipliers
        of the state `near`, by default with those that the steps before let expect.
        """
        scales = self.run.scaling
        alpha = self.size
        if alpha == 0.0:
            return self._still(np.zeros_like(self.before.lam), "nothing pushes")
        if self.before.scale == 0.0 and (held := scales.scale(self.program, alpha).at_rest()) is not None:
            at_rest = scales.restore(Answer(np.zeros_like(self.before.y), held, 0, p=self.before.p), alpha)
            still = self._still(at_rest.lam, "nothing slips")
            # While nothing has moved at all there is no size to which an accuracy could refer.
            if still.scale == 0.0:
                return still
        accuracy = share * self.run.accuracy
        norm = float(np.sqrt(scales.kappa)) * alpha
        if norm < SMALLEST_NORM and norm <= accuracy * self.before.unit(accuracy):
            return self._still(self.before.lam - self.bias, "nothing pushes that counts")
        checked_norm(norm, self.data.t)
        size = max(self.before.unit(accuracy), norm)
        guess = self.before.expected(self.data.t) if near is None else (near.lam, near.p)
        unheld = alpha
        best = self._asked(alpha, unheld, 0.5 * (accuracy * size) ** 2, guess, 0)
        spent = best.iterations
        for _ in range(2):
            if best.accepted(accuracy) or spent >= self.run.most:
                break
            size = SHARE * min(size, best.unit(accuracy))
            if best.unit(accuracy) > 0:
                # For a body that is carried far this is much less than the motion of its unknowns suggests.
                alpha = min(alpha, float(power_of_two(best.unit(accuracy) / np.sqrt(scales.kappa))))
            state = self._asked(alpha, unheld, 0.5 * (accuracy * size) ** 2, guess, spent)
            spent += state.iterations
            if state.certificate.gap >= best.certificate.gap:
                break
            best = state
        return best if spent == best.iterations else replace(best, iterations=spent)

    @cached_property
    def size(self) -> float:
        """alpha of the step; 0 where nothing moves it."""
        return self.run.scaling.size(self.program)

    @property
    def ordinary(self) -> bool:
        """True if contact has pressed before, or sweeps tell where it will, and numbers can hold the step's energy."""
        scales = self.run.scaling
        norm = float(np.sqrt(scales.kappa)) * self.size
        return (self.before.p.any() or scales.operators.sweepable) and SMALLEST_NORM <= norm <= LARGEST_NORM

    def _still(self, lam: Floats, status: str) -> State:
        """The state where it was, exactly."""
        nothing = np.zeros_like(self.before.y), np.zeros_like(self.before.p)
        exact = Certificate(0.0, np.zeros(len(self.program.w)), 0.0, nothing[1])
        return self.state_after(Answer(nothing[0], lam, 0, status, p=nothing[1]), exact)

    def _asked(self, alpha: float, unheld: float, gap: float, guess: tuple[Floats, Floats], spent: int) -> State:
        """The solver's answer within the bounds, certified; its iterations are those left after so many."""
        scales, name = self.run.scaling, self.run.solver.name
        scaled = scales.scale(self.program, alpha, unheld)
        target, begin = scales.energy(gap, alpha), scales.guess(guess[0] - self.bias, guess[1], alpha)
        with named_failures(name):
            answer = fitting(self.run.after(spent).prepared.solve(scaled, target, *begin), scaled, name)
        d, lam, p = scaled.admissible_point(answer.d, answer.lam, answer.p)
        certificate = scaled.certificate_at(d, lam, p).times(1.0 / scales.energy(1.0, alpha))
        answer = scales.restore(replace(answer, d=d, lam=lam, p=p), alpha)
        return self.state_after(answer, certificate)

    def state_after(self, answer: Answer, certificate: Certificate) -> State:
        """The state that an answer of the program leads to."""
        d, before, operators, w = answer.d, self.before, self.run.operators, self.program.w
        y, slip, unbalanced = before.y + d, self.program.slip(d), self.program.g
        if self.data.tilted:
            answer = replace(answer, lam=answer.lam + self.bias)
            unbalanced = unbalanced + operators.rows.force_of(self.data.bias)
        unbalanced, lam, bound = unbalanced - operators.force(d), answer.lam, bound_after(self, w, answer.p, slip)
        rubbed = Rubbed(lam, slip, w, (before.bound, bound), self.biases)
        ledger = advance(
            self.run.condensation, before.ledger, (before.data, self.data), y, answer=answer, rubbed=rubbed
        )
        scale, accuracy = float(np.maximum(before.scale, ledger.norm)), self.run.accuracy
        floor = certificate.error_floor
        size, noise = data_norms(self.run.condensation, self.data, scale, floor, accuracy)
        return State(
            t=self.data.t,
            y=y,
            unbalanced=unbalanced,
            data=self.data,
            weights=w,
            bound=bound,
            lam=lam,
            p=answer.p,
            slip=slip,
            certificate=certificate,
            ledger=ledger,
            scale=scale,
            iterations=answer.iterations,
            status=answer.status,
            safeguards=answer.safeguards,
            size=max(before.size, size, ground_norm(operators, self.data.ground, self.program.w)),
            noise=noise,
            earlier=Earlier(before.t, before.lam, before.p, before.y),
            dragged=before.dragged,
        )


def bound_after(attempt: PosedStep, w: Floats, p: Floats, slip: Floats) -> Floats:
    """The weights (m,) at the slips after a step of such weights: those ahead of a law that reads past slips alone."""
    norms, t, past = attempt.run.system.norms, attempt.data.t, attempt.before.ledger.slipped
    if norms is None or not norms.remembers:
        return w
    alone = np.abs(norms.weights_under(t, p, past) - w) <= SAME * w
    return np.where(alone, norms.weights_under(t, p, past + lengths(slip)), w)


def certified_in_full(run: PreparedRun, state: State, lost: sp.csr_matrix | None = None) -> State:
    """The state with all its unknowns and the certificate of the full system; `lost` is the rounding error of K."""
    if state.full is not None:
        return state
    y = run.condensation.recover(state.y, state.data.force)
    phi = state.data.force.phi
    force, held = _balanced(run, state, phi if lost is None else phi - lost @ y)
    full = full_certificate(run.condensation, force, y, held, state.certificate)
    return _in_full(run, state, y, (force, held), full)


def together(run: PreparedRun) -> int:
    """States to certify in full at once: TOGETHER where K is factorised, fewer where a dozen arrays would be large."""
    most = AT_ONCE // max(12 * run.system.n, 1)
    return max(1, min(TOGETHER, most)) if run.condensation.linear.eliminates else 1


def certified_together(run: PreparedRun, states: Sequence[State]) -> list[State]:
    """At most `together` states as `certified_in_full` has them, but for rounding.

    PARDISO solves for eight in less than the time of four, and K is made extended once. There are always as many
    columns, zeros where there are fewer states: digits do not depend on how many there are.
    """
    some, condensation = [state for state in states if state.full is None], run.condensation
    if not some:
        return list(states)
    count = together(run)
    y = condensation.recover_together([one.y for one in some], [one.data.force for one in some], count)
    both = [_balanced(run, one, one.data.force.phi) for one in some]
    force, held = (columns(each, count) for each in zip(*both, strict=True))
    r, size = out_of_balance(run.system, force, y, held)
    floors = [rounding(condensation, size[:, k]) for k in range(len(some))]
    parts = zip((0.5 * condensation.factor.energies_of_columns(r)).tolist(), floors, strict=False)
    full = [replace(one.certificate, equilibrium=a, floor=b) for one, (a, b) in zip(some, parts, strict=False)]
    found = map(partial(_in_full, run), some, y.T, both, full)
    return [next(found) if state.full is None else state for state in states]


def _balanced(run: PreparedRun, state: State, phi: Floats) -> tuple[Floats, Floats]:
    """The force phi (n,) and what holds a state's unknowns against it."""
    # The bias is on both sides, lest its own rounding be none where the two cancel.
    bias = run.system.B.T @ state.data.bias
    held = run.system.multiplier_force(state.lam, state.p) - bias
    if run.system.follows_answer:
        held = -bias
        held[run.condensation.retained] += state.unbalanced
    return phi - bias, held


def _in_full(run: PreparedRun, state: State, y: Floats, balanced: tuple[Floats, Floats], full: Certificate) -> State:
    """The state with all unknowns y, refined inside where these miss the accuracy, and certificates of both systems."""
    (force, held), own = balanced, state.certificate
    if full.error > SHARE * run.accuracy * state.unit(run.accuracy) and len(state.y) < run.system.n:
        r = residual(force, run.system.K, y, held)
        y = run.condensation.refine_interior(y, r)
        full = full_certificate(run.condensation, force, y, held, own)
    equilibrium, floor = np.maximum([full.equilibrium, full.floor], [own.equilibrium, own.floor]).tolist()
    return replace(state, full=y, certificate=replace(own, equilibrium=equilibrium, floor=floor))


def refined_state(attempt: PosedStep, state: State) -> State:
    """The state after iterative refinement against the original K; slips, ledger and certificate are those of it."""
    run, before, operators = attempt.run, attempt.before, attempt.run.operators
    remaining_gap, retained = state.data.remaining_gap, run.condensation.retained
    force, lam = state.data.force.phi - run.system.B.T @ state.data.bias, state.lam - attempt.bias
    stick = np.linalg.norm(lam + Shifts.of(operators).norms[:, None] * state.slip, axis=1) <= state.weights
    y = run.condensation.recover(state.y, state.data.force)
    held = {"gap": remaining_gap, "lam": lam, "p": state.p, "stick": stick, "slip": state.slip}
    y, lam, p = refined(run.condensation, operators, force, y, **held)
    lam, p = replace(attempt.program, w=state.weights).project(lam), np.maximum(p, 0.0)
    # What was free to move may have moved a rounding error beyond its bound.
    bounds, beyond = operators.compliance == 0, operators.limits.read(y[retained]) - remaining_gap
    y[retained[operators.limits.columns]] -= np.where(bounds, np.maximum(beyond, 0.0), 0.0) / operators.D.data
    # Sticking terms keep their slip to the last bit; slipping ones may have lost their direction to rounding.
    slip = state.slip + operators.blocks(operators.rows.read(y[retained] - state.y))
    aligned = _aligned(attempt.run.operators, state.weights, lam=lam, slip=slip, stick=stick)
    y[retained[operators.rows.columns]] += (aligned - slip).ravel() / operators.B.data
    slip, moved, excess = aligned, y[retained] - state.y, operators.limits.read(y[retained]) - remaining_gap
    over = limit_gaps(operators.compliance, p, excess, EPS * (np.abs(remaining_gap) + np.abs(excess)))
    # Bounds that act are as far as they were; what their difference of two places says of that is rounding.
    acts = bounds & (state.p > 0)
    over[acts] = state.certificate.limits[acts] * (p[acts] / state.p[acts])
    # Where weights depend on the answer its distance to a solution stays; else the gap of what is refined says all.
    away = state.certificate.distance if run.system.follows_answer else 0.0
    friction, forces = norm_gaps(state.weights, lam, slip), run.system.multiplier_force(lam, p)
    lam = lam + attempt.bias
    own = replace(state.certificate, equilibrium=0.0, friction=friction, limits=over, distance=away, moved=0.0)
    answer = state.answer(state.y - before.y + moved, lam, p)
    between, ends = (before.data, state.data), (before.unknowns, y)
    bound = bound_after(attempt, state.weights, p, slip)
    rubbed = Rubbed(lam, slip, state.weights, (before.bound, bound), attempt.biases)
    ledger = advance_in_full(run.system, before.ledger, between, ends, answer=answer, rubbed=rubbed)
    return replace(
        state,
        y=y[retained],
        full=y,
        unbalanced=operators.multiplier_force(lam, p),
        lam=lam,
        p=p,
        slip=slip,
        certificate=full_certificate(run.condensation, force, y, forces, own),
        ledger=ledger,
        scale=float(np.maximum(before.scale, ledger.norm)),
        bound=bound,
    )


def posed_sharply(attempt: PosedStep, refined: State) -> PosedStep:
    """The step posed with the forces g on the retained unknowns that a refined state balances.

    g = K d + B'lam + D'p plus the reduced residual. On weak springs the response x to a load is large, and g = S x_c
    carries the rounding of S times that: too much for sets and pressures.
    """
    run, d = attempt.run, refined.y - attempt.before.y
    held = run.system.multiplier_force(refined.lam, refined.p)
    r = residual(attempt.data.force.phi, run.system.K, refined.unknowns, held)
    left = run.condensation.reduce(r, remembered=False)
    g = refined.unbalanced + run.operators.force(d) + left.retained - run.operators.rows.force_of(attempt.data.bias)
    return replace(attempt, program=replace(attempt.program, g=g))


def _aligned(operators: Operators, w: Floats, lam: Floats, slip: Floats, stick: Bools) -> Floats:
    """Slips (m, block) that point where their multipliers do, but for those that stick.

    Turning a slip by e costs an energy of about e^2 / 2 over the term's flexibility. A slip whose gap is smaller than
    that is left as it is: where contact is open, the direction of a multiplier is that of rounding.
    """
    square = np.einsum("ij,ij->i", lam, lam)
    share = np.divide(np.einsum("ij,ij->i", lam, slip), square, out=np.zeros_like(square), where=square > 0)
    turned = np.where(square[:, None] > 0, np.maximum(share, 0.0)[:, None] * lam, slip)
    cost = 0.5 * np.einsum("ij,ij->i", turned - slip, turned - slip)
    stays = stick | (cost >= operators.norm_flexibility * norm_gaps(w, lam, slip))
    return np.where(stays[:, None], slip, turned)
