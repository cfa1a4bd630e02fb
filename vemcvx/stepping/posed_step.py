"""One step posed and answered: scaled, asked of the solver, certified.

With y_n = y_{n-1} + d_n, the force out of balance after a step, g_n - K d_n, is carried into the next one,
g_{n+1} = (g_n - K d_n) + (load_{n+1} - load_n): increments keep their digits when steps are tiny beside y.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from vemcvx.arrays import Floats, power_of_two
from vemcvx.program.certificate import Certificate, limit_gaps, norm_gaps
from vemcvx.program.scaling import LARGEST, SMALLEST, checked_norm
from vemcvx.program.step_program import Answer, StepProgram, fitting
from vemcvx.program.terms import Norms
from vemcvx.program.tolerances import ASKED_AGAIN
from vemcvx.solvers.coulomb import WeightLaw, solution_near
from vemcvx.solvers.newton import Iterate
from vemcvx.solvers.solver import named_failures
from vemcvx.stepping.acceptance import data_norms, ground_norm, refuse_unbalanced
from vemcvx.stepping.ledger import StepData, advance
from vemcvx.stepping.state import Earlier, PreparedRun, State

ATTEMPTS = 3
"""Most times that a solver is asked. Errors are relative to |u_n|, which the first answer tells: where too little was
asked, a smaller gap is, for as long as gaps decrease."""


def pose_step(run: PreparedRun, before: State, now: StepData, w: Floats | None = None) -> PosedStep:
    """Pose the step that leads from `before` to what drives the system now; with weights `w` (m,), if they are given.

    By default weights that depend on the answer follow the pressures of `before`, and slips so far.
    """
    if w is None:
        norms = run.system.norms
        w = np.zeros(0) if norms is None else norms.weights_under(now.t, before.p, before.ledger.slipped)
    g = before.unbalanced + (now.force.retained - before.data.force.retained)
    e = now.remaining_gap - run.operators.limits.read(before.y)
    b = before.data.prescribed_slip - now.prescribed_slip
    return PosedStep(run, before, StepProgram(run.operators, g, w, b, e), now)


@dataclass(frozen=True)
class PosedStep:
    """One step being solved."""

    run: PreparedRun
    before: State
    program: StepProgram
    data: StepData

    def solve_balanced(self, n: int, share: float = 1.0, near: State | None = None) -> State:
        """The solution, as `solve` finds it, of step `n`.

        Where nothing balances the load on K's kernel there is none: solvers that are given the kernel are not asked
        then, and of proximal points the certificate is infinite.

        Raises
        ------
        SceneError
            Nothing balances the load.
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

        Parameters
        ----------
        share : float
            Of the solver's accuracy: less is asked where the answer is but a part of something.
        near : State, optional
            Whose multipliers to begin with; by default those that the steps before let expect.
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
        checked_norm(norm, self.data.t)
        size = max(self.before.unit(accuracy), norm)
        guess = self.before.expected(self.data.t) if near is None else (near.lam, near.p)
        free = alpha
        best = self._asked(alpha, free, 0.5 * (accuracy * size) ** 2, guess, 0)
        spent = best.iterations
        for _ in range(ATTEMPTS - 1):
            if best.accepted(accuracy) or spent >= self.run.most:
                break
            size = ASKED_AGAIN * min(size, best.unit(accuracy))
            if best.unit(accuracy) > 0:
                # Of a body that is carried far this is much less than the motion of its unknowns let expect.
                alpha = min(alpha, float(power_of_two(best.unit(accuracy) / np.sqrt(scales.kappa))))
            state = self._asked(alpha, free, 0.5 * (accuracy * size) ** 2, guess, spent)
            spent += state.iterations
            if state.certificate.gap >= best.certificate.gap:
                break
            best = state
        return best if spent == best.iterations else replace(best, iterations=spent)

    @property
    def ordinary(self) -> bool:
        """Whether contact has pressed before, and what drives the step has an energy that numbers can hold."""
        norm = float(np.sqrt(self.run.scaling.kappa)) * self.run.scaling.size(self.program)
        return bool(self.before.p.any()) and SMALLEST <= norm <= LARGEST

    def _still(self, lam: Floats, status: str) -> State:
        """The state where it was, exactly."""
        nothing = np.zeros_like(self.before.y), np.zeros_like(self.before.p)
        exact = Certificate(0.0, np.zeros(len(self.program.w)), 0.0, nothing[1])
        return self.state_after(Answer(nothing[0], lam, 0, status, p=nothing[1]), exact)

    def _asked(self, alpha: float, free: float, gap: float, guess: tuple[Floats, Floats], spent: int) -> State:
        """The solver's answer within the bounds, certified; its iterations are those left after so many."""
        scales, name = self.run.scaling, self.run.solver.name
        scaled = scales.scale(self.program, alpha, free)
        target, begin = scales.energy(gap, alpha), scales.guess(*guess, alpha)
        with named_failures(name):
            answer = fitting(self.run.after(spent).prepared.solve(scaled, target, *begin), scaled, name)
        d, lam, p = scaled.admissible_point(answer.d, answer.lam, answer.p)
        certificate = scaled.certificate_at(d, lam, p).times(1.0 / scales.energy(1.0, alpha))
        answer = scales.restore(replace(answer, d=d, lam=lam, p=p), alpha)
        return self.state_after(answer, certificate, scales.weights(scaled, alpha))

    def solution_near(self, state: State, norms: Norms, rounds: Iterator[int]) -> State | None:
        """A solution of the step with weights that follow the limits, on the sets of a state; None if it is none."""
        scales, t = self.run.scaling, self.data.t
        alpha = scales.size(self.program)
        if alpha == 0.0:
            return replace(state, certificate=state.certificate.away(0.0))
        up, down = scales.sigma / (scales.kappa * alpha), scales.kappa * alpha / scales.tau
        past = self.before.ledger.slipped
        weights, slope = partial(norms.weights_under, t, past=past), partial(norms.slope_under, t, past=past)
        law = WeightLaw(weights, slope).scaled(up, down)
        start = Iterate(scales.shrink(state.y - self.before.y, alpha), *scales.guess(state.lam, state.p, alpha))
        scaled = scales.scale(self.program, alpha)
        found = solution_near(scaled, law, start, self.run.response, rounds)
        if found is None:
            return None
        at, w = found.point, found.weights
        floor = replace(scaled, w=w).rounding_floor(at.d, at.lam, at.p)
        own = Certificate(0.0, np.zeros_like(w), floor, np.zeros_like(at.p)).away(found.error, not found.proven)
        answer = state.answer(at.d, at.lam, at.p)
        whole = replace(self, program=replace(self.program, w=w / up))
        return whole.state_after(scales.restore(answer, alpha), own.times(1.0 / scales.energy(1.0, alpha)))

    def convex_certificate(self, state: State, margin: float) -> Certificate:
        """The certificate of a state under the weights of its own slip, which is that of this program over the margin.

        See :mod:`vemcvx.stepping.state`.
        """
        scales = self.run.scaling
        alpha = scales.size(self.program)
        if alpha == 0.0:
            return state.certificate
        scaled = scales.scale(self.program, alpha)
        lam, p = scales.guess(state.lam, state.p, alpha)
        own = scaled.certify(scales.shrink(state.y - self.before.y, alpha), scaled.project(lam), p)
        own = own.times(1.0 / scales.energy(1.0, alpha))
        return replace(own, floor=own.floor / margin**2).away(own.error / margin, False)

    def under_own_weights(self, state: State, certificate: Certificate) -> State:
        """A state that was found for other weights, under those of this program."""
        d, lam = state.y - self.before.y, self.program.project(state.lam)
        return self.state_after(state.answer(d, lam, state.p), certificate)

    def with_forces_of(self, state: State, under: State, certificate: Certificate) -> State:
        """The motion of a state under the forces of another; what these miss of work on it adds to the certificate."""
        # y_n - y_{n-1} is d but for rounding, by which it may be beyond a bound, and that would cost no end of work.
        program, d = self.program, self.program.feasible(state.y - self.before.y)
        friction = norm_gaps(program.w, under.lam, program.slip(d))
        limits = limit_gaps(program.operators.compliance, under.p, program.excess(d), program.excess_blur(d))
        certificate = replace(certificate, friction=friction, limits=limits)
        return self.state_after(state.answer(d, under.lam, under.p), certificate)

    def state_after(self, answer: Answer, certificate: Certificate, capped_weights: Floats | None = None) -> State:
        """The state that an answer leads to."""
        capped_weights = self.program.w if capped_weights is None else capped_weights
        before, y = self.before, self.before.y + answer.d
        slip = self.program.slip(answer.d)
        ledger = advance(
            self.run.condensation,
            before.ledger,
            (before.data, self.data),
            y,
            answer=answer,
            slip=slip,
            w=capped_weights,
        )
        scale, accuracy = float(np.maximum(before.scale, ledger.norm)), self.run.accuracy
        floor = certificate.error_floor
        size, noise = data_norms(self.run.condensation, self.data, scale, floor, accuracy)
        return State(
            t=self.data.t,
            y=y,
            unbalanced=self.program.g - self.run.operators.force(answer.d),
            data=self.data,
            weights=self.program.w,
            capped_weights=capped_weights,
            lam=answer.lam,
            p=answer.p,
            slip=slip,
            certificate=certificate,
            ledger=ledger,
            scale=scale,
            iterations=answer.iterations,
            status=answer.status,
            safeguards=answer.safeguards,
            size=max(before.size, size, ground_norm(self.run.operators, self.data.ground, capped_weights)),
            noise=noise,
            earlier=Earlier(before.t, before.lam, before.p),
            dragged=before.dragged,
        )
