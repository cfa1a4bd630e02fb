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
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, SAME, Floats, columns, lengths, power_of_two
from vemcvx.base.errors import NotCertified, SceneError
from vemcvx.linear import AT_ONCE
from vemcvx.program.certificate import Certificate
from vemcvx.program.condensation import Condensation, Reduced
from vemcvx.program.operators import Operators, product
from vemcvx.program.scaling import SMALLEST_NORM, checked_norm
from vemcvx.program.step_program import Answer, StepProgram, fitting
from vemcvx.program.system import System
from vemcvx.program.tolerances import SHARE
from vemcvx.solvers import Solver
from vemcvx.solvers.law import StepLaw
from vemcvx.solvers.solver import named_failures
from vemcvx.stepping.fixed_point import followed
from vemcvx.stepping.ledger import Rubbed, StepData, advance
from vemcvx.stepping.state import Earlier, PreparedRun, State

log = logging.getLogger("vemcvx")

TOGETHER = 8
"""States that are certified in full at once: of 8,256 unknowns in a third of the time that one by one take."""


def data_norm(condensation: Condensation, force: Reduced, norm: float, accuracy: float) -> float:
    """Return the energy norm above that the data can cause; zero where states of energy norm `norm` are not zero."""
    if force.norm == 0.0 or norm > accuracy * force.norm:
        return 0.0
    x = force.x
    unit = float(power_of_two(np.abs(x).max(initial=0.0)))
    x = x / unit
    square, soft = float(x @ x), float(x @ condensation.factor.solve(x))
    return unit * square / float(np.sqrt(soft)) if square > 0 else 0.0


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
        f"{_advice(solver, reached, accuracy, floor)}. In Python check=False goes on regardless.",
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
    push = float(field @ program.g)
    holds = float(program.w @ np.linalg.norm(operators.blocks(slip), axis=1))
    holds = holds if holds > 1e-12 * push else 0.0  # Less is rounding: no slip.
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
    g = balanced(run, before, now, before.unbalanced + (now.force.retained - before.data.force.retained))
    e = now.remaining_gap - run.operators.limits.read(before.y)
    b = before.data.prescribed_slip - now.prescribed_slip
    return PosedStep(run, before, StepProgram(run.operators, g, w, b, e), now)


def balanced(run: PreparedRun, before: State, now: StepData, g: Floats) -> Floats:
    """The force g (n,) of a step without what pushes along K's kernel by the rounding of the forces that it is made of.

    These are the loads at both ends of the step, what was out of balance, and the forces inside the body.
    """
    N, operators = run.operators.kernel, run.operators
    if N is None:
        return g
    forces = before.unbalanced, now.force.retained, before.data.force.retained
    size = sum(np.abs(force) for force in forces) + product(operators.absolute, np.abs(before.y))
    push = N.T @ g
    return g - N @ np.where(np.abs(push) <= 64 * EPS * (np.abs(N).T @ size), push, 0.0)


@dataclass(frozen=True)
class PosedStep:
    """One step being solved."""

    run: PreparedRun
    before: State
    program: StepProgram
    data: StepData

    def solve_balanced(self, n: int) -> State:
        """The solution, as `solve` finds it, of step `n`.

        SceneError where nothing balances the load on K's kernel.
        """
        refuse = partial(refuse_unbalanced, self.program, self.run.condensation, n, self.data)
        if not self.run.system.follows_answer:
            refuse()
        state = self.solve()
        if not np.isfinite(state.certificate.gap):
            refuse()
        return state

    def solve(self) -> State:
        """Ask, certify, and ask more sharply where the size of u_n shows that too little was asked.

        Errors are relative to |u_n|, which the first answer tells: a solver is asked three times, as long as gaps fall.
        """
        program, before, accuracy = self.program, self.before, self.run.accuracy
        size = program.size
        if size == 0.0:
            return self._still(np.zeros_like(before.lam), "nothing pushes")
        if before.scale == 0.0 and (held := program.at_rest()) is not None:
            still = self._still(held, "nothing slips")
            # While nothing has moved at all there is no size to which an accuracy could refer.
            if still.scale == 0.0:
                return still
        if size < SMALLEST_NORM and size <= accuracy * before.unit(accuracy):
            return self._still(before.lam, "nothing pushes that counts")
        checked_norm(size, self.data.t)
        size = max(before.unit(accuracy), size)
        guess = before.expected(self.data.t)
        best = self._asked(0.5 * (accuracy * size) ** 2, guess, 0)
        spent = best.iterations
        for _ in range(2):
            if best.accepted(accuracy) or not np.isfinite(best.certificate.gap):
                break
            size = SHARE * min(size, best.unit(accuracy))
            state = self._asked(0.5 * (accuracy * size) ** 2, guess, spent)
            spent += state.iterations
            if state.certificate.gap >= best.certificate.gap:
                break
            best = state
        return best if spent == best.iterations else replace(best, iterations=spent)

    def _still(self, lam: Floats, status: str) -> State:
        """The state where it was, exactly."""
        nothing = np.zeros_like(self.before.y), np.zeros_like(self.before.p)
        exact = Certificate(0.0, np.zeros(len(self.program.w)), 0.0, nothing[1])
        return self.state_after(Answer(nothing[0], lam, 0, status, p=nothing[1]), exact)

    def _asked(self, gap: float, guess: tuple[Floats, Floats], spent: int) -> State:
        """The solver's answer within the bounds, certified; its iterations are those left after so many."""
        program, law, run = self.program, self.law, self.run.after(spent)
        with named_failures(run.solver.name):
            if law is None:
                answer = fitting(run.prepared.solve(program, gap, *guess), program, run.solver.name)
            else:
                answer = followed(run.solver, run.prepared, program, law=law, target=gap, guess=guess)
                slip = lengths(program.slip(answer.d))
                law.check_slope(answer.p, slip)
                program = replace(program, w=law.at(answer.p, slip))
        d, lam, p = program.admissible_point(answer.d, answer.lam, answer.p)
        floor = program.rounding_floor(d, lam, p, self.before.y)
        certificate = replace(program.certificate_at(d, lam, p), floor=floor, given_friction=law is not None)
        return replace(self, program=program).state_after(replace(answer, d=d, lam=lam, p=p), certificate)

    @property
    def law(self) -> StepLaw | None:
        """The law of the step's weights; None where they are given."""
        norms = self.run.system.norms
        if norms is None or norms.law is None:
            return None
        return StepLaw.of(norms, self.data.t, self.before.ledger.slipped, len(self.program.e))

    def state_after(self, answer: Answer, certificate: Certificate) -> State:
        """The state that an answer of the program leads to."""
        d, before, operators, w = answer.d, self.before, self.run.operators, self.program.w
        y, slip, unbalanced = before.y + d, self.program.slip(d), self.program.g - operators.force(d)
        lam, bound = answer.lam, bound_after(self, w, answer.p, slip)
        rubbed = Rubbed(lam, slip, w, (before.bound, bound))
        ledger = advance(
            self.run.condensation, before.ledger, (before.data, self.data), y, answer=answer, rubbed=rubbed
        )
        scale, accuracy = float(np.maximum(before.scale, ledger.norm)), self.run.accuracy
        size = data_norm(self.run.condensation, self.data.force, scale, accuracy)
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
            earlier=Earlier(before.t, before.lam, before.p),
            dragged=before.dragged,
        )


def bound_after(attempt: PosedStep, w: Floats, p: Floats, slip: Floats) -> Floats:
    """The weights (m,) at the slips after a step of such weights: those ahead of a law that reads past slips alone."""
    norms, t, past = attempt.run.system.norms, attempt.data.t, attempt.before.ledger.slipped
    if norms is None or not norms.remembers:
        return w
    alone = np.abs(norms.weights_under(t, p, past) - w) <= SAME * w
    return np.where(alone, norms.weights_under(t, p, past + lengths(slip)), w)


def certified_in_full(run: PreparedRun, state: State) -> State:
    """The state with all its unknowns and the certificate of the full system."""
    return certified_together(run, [state])[0]


def together(run: PreparedRun) -> int:
    """States to certify in full at once: TOGETHER where K is factorised, fewer where a dozen arrays would be large."""
    most = AT_ONCE // max(12 * run.system.n, 1)
    return max(1, min(TOGETHER, most)) if run.condensation.linear.eliminates else 1


def certified_together(run: PreparedRun, states: Sequence[State]) -> list[State]:
    """The states with all their unknowns and certificates of the full system: r = force - B'lam - D'p - K y.

    The unknowns are corrected once by what is left out of balance inside. Rows see retained unknowns only: their parts,
    and the floor, are those of the condensed certificate.
    """
    some, condensation, system = [state for state in states if state.full is None], run.condensation, run.system
    if not some:
        return list(states)
    held = [one.data.force.phi - system.multiplier_force(one.lam, one.p) for one in some]
    force, y = columns(held, len(held)), condensation.recover([one.y for one in some], [one.data.force for one in some])
    left, energies = _left(run, force, y)
    most = [0.5 * (SHARE * run.accuracy * one.unit(run.accuracy)) ** 2 for one in some]
    if not condensation.whole and (energies > most).any():
        y = y + condensation.held(left)
        energies = _left(run, force, y)[1]
    found = iter(zip(y.T, energies.tolist(), strict=True))
    return [_in_full(state, *next(found)) if state.full is None else state for state in states]


def _left(run: PreparedRun, force: Floats, y: Floats) -> tuple[Floats, Floats]:
    """What forces (n, k) leave out of balance at y (n, k), less what motions of no energy feel; energies (k,)."""
    left = _off_kernel(run.system, force - run.system.K @ y)
    return left, 0.5 * run.condensation.factor.energies_of_columns(left)


def _off_kernel(system: System, force: Floats) -> Floats:
    """Forces without what pushes along motions of no energy: multipliers hold that, not the anchors."""
    return force if (kernel := system.kernel) is None else force - kernel.basis @ (kernel.basis.T @ force)


def _in_full(state: State, y: Floats, equilibrium: float) -> State:
    own = state.certificate
    return replace(state, full=y, certificate=replace(own, equilibrium=max(equilibrium, own.equilibrium)))
