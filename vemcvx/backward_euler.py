"""One step of backward Euler, (2.34): posed, scaled, solved, certified, entered into the ledger.

With y_n = y_{n-1} + d_n, the force out of balance after a step, g_n - K d_n, is carried into the next one,
g_{n+1} = (g_n - K d_n) + (load_{n+1} - load_n): increments keep their digits when steps are tiny beside y.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vemcvx.acceptance import insist
from vemcvx.certificate import EPS, Certificate, certify, norm_gaps
from vemcvx.condensation import Condensation
from vemcvx.ledger import Drive, Ledger, advance, drive
from vemcvx.linear import LinearSolver
from vemcvx.program import Answer, Form, StepProgram
from vemcvx.refine import full_certificate, needs_refinement, refined
from vemcvx.scaling import Scaling, scaling
from vemcvx.seminorm import answered, refuse_unbalanced
from vemcvx.solvers import Prepared, Solver, choose
from vemcvx.system import System

Floats = NDArray[np.float64]

ATTEMPTS = 3
"""A solver that misses is asked again for a hundredth of the gap, now that the size of u_n is known."""


@dataclass(frozen=True)
class Run:
    """What all steps share."""

    system: System
    condensation: Condensation
    scaling: Scaling
    solver: Solver
    prepared: Prepared
    check: bool
    refines: bool
    """whether the factors are too coarse for the accuracy, so that every step is refined"""

    def insist(self, state: State, n: int) -> None:
        """Raise NotCertified when the state after step `n` misses the solver's accuracy."""
        insist(self.solver, self.system.norms, state.certificate, state.scale, state.status, n, state.t)

    @property
    def form(self) -> Form:
        """The condensed form, in the units of the system."""
        return self.condensation.form


@dataclass(frozen=True)
class State:
    """Everything known at an instant; touched unknowns only."""

    t: float
    y: Floats
    """(m,)"""
    unbalanced: Floats
    """(m,) load - K y, which the norm terms hold"""
    drive: Drive
    weights: Floats
    """(m,) of the friction bounds"""
    walls: Floats
    """(m,) the weights, those far above every multiplier lowered"""
    lam: Floats
    slip: Floats
    """(m, block) s of the step that led here"""
    certificate: Certificate
    ledger: Ledger
    scale: float
    """largest energy norm of the states so far"""
    iterations: int
    status: str = ""
    """in the solver's own words"""
    safeguards: int = 0
    """how many of the iterations stood in for faster ones"""
    full: Floats | None = None
    """(n,) all unknowns, once somebody has asked for them"""


def prepare(
    system: System, solver: Solver | None, check: bool, condense: bool, linear: LinearSolver | None = None
) -> Run:
    """Factorise, condense, scale, and let the solver do what all steps share."""
    condensation = Condensation(system, condense, linear)
    chosen = choose(condensation.form, solver)
    scales = scaling(condensation.form)
    refines = condensation.form.rows.columns is not None and needs_refinement(condensation, chosen.accuracy)
    return Run(system, condensation, scales, chosen, chosen.prepare(scales.form.regular), check, refines)


def step(run: Run, before: State, n: int, t: float) -> State:
    """The state at `t`, one step after `before`.

    Raises
    ------
    NotCertified
        The step misses the solver's accuracy, and the run is to be checked.
    """
    now = drive(run.system, run.condensation, t)
    weights = np.zeros(0) if run.system.norms is None else run.system.norms.weights(t)
    attempt = trial(run, before, now, weights)
    if run.form.kernel is not None:
        refuse_unbalanced(attempt.program, run.system.kernel, run.condensation.touched, n, t)
    if now.still_as(before.drive) and np.array_equal(weights, before.weights):
        guess = Answer(np.zeros_like(before.y), before.lam, 0, "nothing changed")
        state = attempt.enter(guess, before.certificate)
    else:
        state = attempt.solve()
    if run.refines:
        state = sharpened(run, state)
    if run.check:
        run.insist(state, n)
    return state


def sticking(run: Run, state: State) -> NDArray[np.bool_]:
    """Increments that the certificate cannot tell from zero: |s_i - s_i*| <= compliance^{1/2} |d - d*|."""
    form = run.form
    if form.count == 0:
        return np.zeros(0, dtype=bool)
    blur = EPS * np.abs(form.blocks(form.rows.absolute.read(np.abs(state.y)))).max(axis=1)
    error = state.certificate.error + state.certificate.error_floor
    return np.linalg.norm(state.slip, axis=1) <= error * np.sqrt(form.compliance) + blur


def sharpened(run: Run, state: State) -> State:
    """The state after iterative refinement against the original K."""
    force = state.drive.force
    y = run.condensation.recover(state.y, force)
    y, lam = refined(run.condensation, run.form, force.phi, y, state.lam, sticking(run, state))
    size = np.maximum(np.linalg.norm(lam, axis=1), np.finfo(float).tiny)
    lam = lam * np.minimum(1.0, state.walls / size)[:, None]
    certificate = full_certificate(run.condensation, force.phi, y, lam, norm_gaps(state.walls, lam, state.slip))
    touched = y[run.condensation.touched]
    return replace(
        state, y=touched, unbalanced=run.form.rows.pull(lam.ravel()), lam=lam, certificate=certificate, full=y
    )


def completed(run: Run, state: State, given: bool) -> State:
    """The state with all its unknowns and the certificate of the full system; one that was given has none."""
    if state.full is not None:
        return state
    force = state.drive.force
    y = run.condensation.recover(state.y, force)
    if given:
        return replace(state, full=y)
    own = state.certificate
    full = full_certificate(run.condensation, force.phi, y, state.lam, own.friction)
    worse = max(full.equilibrium, own.equilibrium), own.friction, max(full.floor, own.floor)
    return replace(state, full=y, certificate=Certificate(*worse))


def trial(run: Run, before: State, now: Drive, weights: Floats) -> Trial:
    """Pose the step that leads from `before` to what drives the system now."""
    g = before.unbalanced + (now.force.touched - before.drive.force.touched)
    return Trial(run, before, StepProgram(run.form, g, weights, before.drive.drag - now.drag), now)


@dataclass(frozen=True)
class Trial:
    """One step being solved."""

    run: Run
    before: State
    program: StepProgram
    drive: Drive

    def solve(self) -> State:
        """Ask, certify, and ask more sharply where the size of u_n shows that too little was asked."""
        alpha = self.run.scaling.size(self.program)
        if alpha == 0.0:
            still = Answer(np.zeros_like(self.before.y), np.zeros_like(self.before.lam), 0, "nothing pushes")
            return self.enter(still, certify(self.program, still.d, still.lam))
        accuracy = self.run.solver.accuracy
        size = max(self.before.scale, np.sqrt(self.run.scaling.kappa) * alpha)
        best: State | None = None
        for _ in range(ATTEMPTS):
            state = self._ask(alpha, 0.5 * (accuracy * size) ** 2)
            if best is None or state.certificate.gap < best.certificate.gap:
                best = state
            if best.certificate.gap <= 0.5 * (accuracy * best.scale) ** 2:
                break
            size = 0.1 * min(size, best.scale)
        return best  # type: ignore[return-value]

    def _ask(self, alpha: float, target: float) -> State:
        scales = self.run.scaling
        scaled = scales.scale(self.program, alpha)
        answer = answered(self.run.prepared, scaled, scales.energy(target, alpha), scales.guess(self.before.lam, alpha))
        certificate = certify(scaled, answer.d, answer.lam).times(1.0 / scales.energy(1.0, alpha))
        return self.enter(scales.restore(answer, alpha), certificate, scales.weights(scaled, alpha))

    def enter(self, answer: Answer, certificate: Certificate, walls: Floats | None = None) -> State:
        """The state that an answer leads to."""
        walls = self.program.w if walls is None else walls
        before, y = self.before, self.before.y + answer.d
        slip = self.program.slip(answer.d)
        ledger = advance(self.run.condensation, before, self.drive, y, answer, slip, walls)
        return State(
            self.drive.t,
            y,
            self.program.g - self.run.form.K @ answer.d,
            self.drive,
            self.program.w,
            walls,
            answer.lam,
            slip,
            certificate,
            ledger,
            max(before.scale, ledger.norm),
            answer.iterations,
            answer.status,
            answer.safeguards,
        )
