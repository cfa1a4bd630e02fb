"""One step of backward Euler, (2.34): posed, scaled, solved, certified, entered into the ledger.

With y_n = y_{n-1} + d_n, the force out of balance after a step, g_n - K d_n, is carried into the next one,
g_{n+1} = (g_n - K d_n) + (load_{n+1} - load_n): increments keep their digits when steps are tiny beside y.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.program.certificate import EPS, Certificate, certify, limit_gaps, norm_gaps, rounding_floor
from vemcvx.program.extended import residual
from vemcvx.program.refinement import full_certificate, pulled, refined
from vemcvx.program.scaling import SMALLEST, checked_norm, power_of_two
from vemcvx.program.step_program import Answer, StepProgram
from vemcvx.solvers.quasi import Law, settled
from vemcvx.solvers.sets import Point, Shifts
from vemcvx.stepping.acceptance import caused_beside
from vemcvx.stepping.fixed_point import Dependent, resolved
from vemcvx.stepping.ledger import Drive, advance, advance_in_full, drive
from vemcvx.stepping.seminorm import answered, proximal, refuse_unbalanced
from vemcvx.stepping.state import Run, State

Floats = NDArray[np.float64]

MENDED = 0.1
"""Inner unknowns of a kept step are refined once when the full certificate reaches this part of the accuracy."""
ATTEMPTS = 3
"""A solver that misses is asked again for a hundredth of the gap, now that the size of u_n is known, while that helps:
one that is at the end of its digits gives the same answer again."""


def step(run: Run, before: State, n: int, t: float) -> State:
    """The state at `t`, one step after `before`.

    Raises
    ------
    NotCertified
        The step misses the solver's accuracy, and the run is to be checked.
    """
    now = drive(run.system, run.condensation, t)
    norms = run.system.norms
    weights = np.zeros(0) if norms is None else norms.weights_under(t, before.p)
    attempt = trial(run, before, now, weights)
    same = now.still_as(before.drive) and np.array_equal(weights, before.weights)
    # A given start may be out of balance by more than a step's accuracy.
    if same and before.accepted(run.accuracy):
        guess = Answer(np.zeros_like(before.y), before.lam, 0, "nothing changed", p=before.p)
        state = attempt.enter(guess, before.certificate, before.walls)
    else:
        state = solved(run, before, now, weights, n)
    if run.refines:
        state = sharpened(attempt, state)
    if run.check:
        run.insist(state, n)
    return state


def solved(run: Run, before: State, now: Drive, weights: Floats, n: int) -> State:
    """The step to what drives the system now; `weights` (m,) are those to begin with, if they depend on the answer."""
    norms, attempt = run.system.norms, trial(run, before, now, weights)
    if norms is not None and norms.law is not None:
        return _under_pressure(run, before, now, weights, n)
    refuse_unheld(attempt, n)
    return attempt.solve()


def refuse_unheld(posed: Trial, n: int) -> None:
    """Raise SceneError when nothing balances the load of step `n` on a motion that K does not feel."""
    run = posed.run
    if run.form.kernel is not None:
        refuse_unbalanced(posed.program, run.system.kernel, run.condensation.touched, n, posed.drive.t)


def _under_pressure(run: Run, before: State, now: Drive, weights: Floats, n: int) -> State:
    """The step where weights depend on the forces of the limits."""

    def pose(run: Run, w: Floats) -> Trial:
        return trial(run, before, now, w)

    # Where nothing else holds the body, friction of yesterday's pressures may not: begin with no end of it.
    free = run.form.kernel is not None
    start = np.full(len(weights), np.abs(pose(run, weights).program.g).sum()) if free else weights
    return resolved(Dependent(run, now.t, n, pose, partial(refuse_unheld, n=n)), start)


def sharpened(attempt: Trial, state: State) -> State:
    """The state after iterative refinement against the original K; slips, ledger and certificate are those of it."""
    run, before, form = attempt.run, attempt.before, attempt.run.form
    force, reach, touched = state.drive.force, state.drive.reach, run.condensation.touched
    stick = np.linalg.norm(state.lam + Shifts.of(form).norms[:, None] * state.slip, axis=1) <= state.walls
    y = run.condensation.recover(state.y, force)
    y, lam, p = refined(run.condensation, form, force.phi, y, state.lam, state.p, stick)
    size = np.linalg.norm(lam, axis=1)
    share = np.divide(state.walls, size, out=np.ones_like(size), where=size > state.walls)
    lam, p = lam * share[:, None], np.maximum(p, 0.0)
    # What was free to move may have moved a rounding error beyond its bound.
    y[touched[form.limits.columns]] -= np.maximum(form.limits.read(y[touched]) - reach, 0.0) / form.D.data
    # What sticks has not moved, and keeps its slip to the last bit; what slips may have lost its direction to rounding.
    slip = state.slip + form.blocks(form.rows.read(y[touched] - state.y))
    lawful = np.where(stick[:, None], slip, along(lam, slip))
    y[touched[form.rows.columns]] += (lawful - slip).ravel() / form.B.data
    slip, moved, excess = lawful, y[touched] - state.y, form.limits.read(y[touched]) - reach
    over = limit_gaps(form.softness, p, excess, EPS * (np.abs(reach) + np.abs(excess)))
    # Bounds that act are as far as they were; what their difference of two places says of that is rounding.
    acts = state.p > 0
    over[acts] = state.certificate.limits[acts] * (p[acts] / state.p[acts])
    # Where weights depend on the answer its distance to a solution stays; else the gap of what is refined says all.
    depends = run.system.norms is not None and run.system.norms.law is not None
    friction, away = norm_gaps(state.walls, lam, slip), state.certificate.distance if depends else 0.0
    own = replace(state.certificate, equilibrium=0.0, friction=friction, limits=over, distance=away)
    answer = Answer(state.y - before.y + moved, lam, state.iterations, state.status, state.safeguards, p)
    ledger = advance_in_full(run.system, before, state.drive, y, answer, slip, state.walls)
    return replace(
        state,
        y=y[touched],
        full=y,
        unbalanced=form.rows.pull(lam.ravel()) + form.limits.pull(p),
        lam=lam,
        p=p,
        slip=slip,
        certificate=full_certificate(run.condensation, force.phi, y, pulled(run.system, lam, p), own),
        ledger=ledger,
        scale=float(np.maximum(before.scale, ledger.norm)),
    )


def along(lam: Floats, slip: Floats) -> Floats:
    """The slips (m, block) nearest to those given that point where their multipliers do; any where these vanish."""
    square = np.einsum("ij,ij->i", lam, lam)
    share = np.divide(np.einsum("ij,ij->i", lam, slip), square, out=np.zeros_like(square), where=square > 0)
    return np.where(square[:, None] > 0, np.maximum(share, 0.0)[:, None] * lam, slip)


def completed(run: Run, state: State, lost: sp.csr_matrix | None = None) -> State:
    """The state with all its unknowns and the certificate of the full system; `lost` is what rounding took off K."""
    if state.full is not None:
        return state
    y = run.condensation.recover(state.y, state.drive.force)
    force = state.drive.force.phi if lost is None else state.drive.force.phi - lost @ y
    own = state.certificate
    held = pulled(run.system, state.lam, state.p)
    if run.system.norms is not None and run.system.norms.law is not None:
        held = np.zeros_like(y)
        held[run.condensation.touched] = state.unbalanced
    full = full_certificate(run.condensation, force, y, held, own)
    if full.error > MENDED * run.accuracy * state.unit(run.accuracy) and len(state.y) < run.system.n:
        r = residual(force, run.system.K, y, held)
        y = run.condensation.mend(y, r)
        full = full_certificate(run.condensation, force, y, held, own)
    equilibrium, floor = np.maximum([full.equilibrium, full.floor], [own.equilibrium, own.floor]).tolist()
    return replace(state, full=y, certificate=replace(own, equilibrium=equilibrium, floor=floor))


def trial(run: Run, before: State, now: Drive, weights: Floats) -> Trial:
    """Pose the step that leads from `before` to what drives the system now."""
    g = before.unbalanced + (now.force.touched - before.drive.force.touched)
    e = now.reach - run.form.limits.read(before.y)
    return Trial(run, before, StepProgram(run.form, g, weights, before.drive.drag - now.drag, e), now)


@dataclass(frozen=True)
class Trial:
    """One step being solved."""

    run: Run
    before: State
    program: StepProgram
    drive: Drive

    def solve(self, share: float = 1.0, near: State | None = None) -> State:
        """Ask, certify, and ask more sharply where the size of u_n shows that too little was asked.

        Parameters
        ----------
        share : float
            Of the solver's accuracy: less is asked where the answer is but a part of something.
        near : State, optional
            Whose multipliers to begin with; by default those of the step before.
        """
        scales = self.run.scaling
        alpha = scales.size(self.program)
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
        if norm < SMALLEST and norm <= accuracy * self.before.unit(accuracy):
            return self._still(self.before.lam, "nothing pushes that counts")
        checked_norm(norm, self.drive.t)
        size = max(self.before.unit(accuracy), norm)
        best: State | None = None
        free, spent = alpha, 0
        for _ in range(ATTEMPTS):
            state = self._ask(alpha, free, 0.5 * (accuracy * size) ** 2, near or self.before, spent)
            spent += state.iterations
            if best is not None and state.certificate.gap >= best.certificate.gap:
                break
            best = state
            if best.accepted(accuracy) or spent >= self.run.most:
                break
            size = 0.1 * min(size, best.unit(accuracy))
            if best.unit(accuracy) > 0:
                # Of a body that is carried far this is much less than the motion of its unknowns let expect.
                alpha = min(alpha, float(power_of_two(best.unit(accuracy) / np.sqrt(scales.kappa))))
        return replace(best, iterations=spent)  # type: ignore[type-var]

    def _still(self, lam: Floats, status: str) -> State:
        """The state where it was, exactly."""
        nothing = np.zeros_like(self.before.y), np.zeros_like(self.before.p)
        exact = Certificate(0.0, np.zeros(len(self.program.w)), 0.0, nothing[1])
        return self.enter(Answer(nothing[0], lam, 0, status, p=nothing[1]), exact)

    def _ask(self, alpha: float, free: float, target: float, near: State, spent: int) -> State:
        scales = self.run.scaling
        scaled = scales.scale(self.program, alpha, free)

        def ask(program: StepProgram, target: float, lam: Floats, p: Floats, more: int) -> Answer:
            return self.run.after(spent + more).prepared.solve(program, target, lam, p)

        asked = scaled, scales.energy(target, alpha), *scales.guess(near.lam, near.p, alpha)
        step_by_step = scaled.form.kernel is not None and not self.run.solver.semidefinite
        answer = proximal(ask, self.run.most - spent, *asked) if step_by_step else answered(ask, *asked)
        certificate = certify(scaled, answer.d, answer.lam, answer.p).times(1.0 / scales.energy(1.0, alpha))
        return self.enter(scales.restore(answer, alpha), certificate, scales.weights(scaled, alpha))

    def settled(self, state: State, rounds: Iterator[int]) -> State | None:
        """A solution of the step with weights that follow the limits, on the sets of a state; None if it is none."""
        scales, norms, t = self.run.scaling, self.run.system.norms, self.drive.t
        alpha = scales.size(self.program)
        if alpha == 0.0:
            return replace(state, certificate=state.certificate.away(0.0))
        up, down = scales.sigma / (scales.kappa * alpha), scales.kappa * alpha / scales.tau
        law = Law(partial(norms.weights_under, t), partial(norms.slope_under, t)).scaled(up, down)  # type: ignore
        start = Point(scales.shrink(state.y - self.before.y, alpha), *scales.guess(state.lam, state.p, alpha))
        scaled = scales.scale(self.program, alpha)
        found = settled(scaled, law, start, self.run.response, rounds)
        if found is None:
            return None
        at, w = found.point, found.weights
        floor = rounding_floor(replace(scaled, w=w), at.d, at.lam, at.p)
        own = Certificate(0.0, np.zeros_like(w), floor, np.zeros_like(at.p)).away(found.error, not found.proven)
        answer = Answer(at.d, at.lam, state.iterations, state.status, state.safeguards, at.p)
        whole = replace(self, program=replace(self.program, w=w / up))
        return whole.enter(scales.restore(answer, alpha), own.times(1.0 / scales.energy(1.0, alpha)))

    def reconsidered(self, state: State, certificate: Certificate) -> State:
        """A state that was found for other weights, under those of this program."""
        d, lam = state.y - self.before.y, self.program.project(state.lam)
        return self.enter(Answer(d, lam, state.iterations, state.status, state.safeguards, state.p), certificate)

    def moved(self, state: State, under: State, certificate: Certificate) -> State:
        """The motion of a state under the forces of another; what these miss of work on it adds to the certificate."""
        program, d = self.program, state.y - self.before.y
        friction = norm_gaps(program.w, under.lam, program.slip(d))
        limits = limit_gaps(program.form.softness, under.p, program.excess(d), program.excess_blur(d))
        answer = Answer(d, under.lam, state.iterations, state.status, state.safeguards, under.p)
        return self.enter(answer, replace(certificate, friction=friction, limits=limits))

    def enter(self, answer: Answer, certificate: Certificate, walls: Floats | None = None) -> State:
        """The state that an answer leads to."""
        walls = self.program.w if walls is None else walls
        before, y = self.before, self.before.y + answer.d
        slip = self.program.slip(answer.d)
        ledger = advance(self.run.condensation, before, self.drive, y, answer, slip, walls)
        scale, accuracy = float(np.maximum(before.scale, ledger.norm)), self.run.accuracy
        floor = certificate.error_floor
        size, noise = caused_beside(self.run.condensation, self.drive, scale, floor, accuracy)
        return State(
            self.drive.t,
            y,
            self.program.g - self.run.form.force(answer.d),
            self.drive,
            self.program.w,
            walls,
            answer.lam,
            answer.p,
            slip,
            certificate,
            ledger,
            scale,
            answer.iterations,
            answer.status,
            answer.safeguards,
            size=max(before.size, size),
            noise=noise,
        )
