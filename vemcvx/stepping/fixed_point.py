"""Friction that depends on pressure or slip: a fixed point of convex programs inside each step, and what proves it.

With T(w) the answer of the step's convex program for the weights w, and p(T(w)) its pressures, Coulomb's law asks for

    w = law(p(T(w))),     w_{k+1} = law(p(T(w_k))),   beginning with the pressures of the step before.

Existence, uniqueness and contraction are known for small coefficients (Necas, Jarusek and Haslinger 1980; Eck and
Jarusek 1998), but the increments of an iteration are no proof that it contracts. An answer d_k = T(w_k) is therefore
compared with a solution of the step: the sets at d_k, of terms that stick or slip and limits that act, make one linear
system. :mod:`vemcvx.solvers.coulomb` solves it; its solution d_s solves the step if it obeys the inequalities of the
sets (theorems there, in the plane and in space). Then

    |d_k - d|_K <= |d_k - d_s|_K + (error of one linear solve)      for a solution d of the step:

a *bound* on the distance to a solution; with coefficients that are not small there may be others. Active-set solvers
answer with d_s itself, mostly found from the sets of the step before, without a program. Answers of all other solvers
keep their d_k, with the forces of d_s, which balance and follow the law to rounding, as pressures of a solver do not.
The gap is half the square of the bound plus the parts of friction and limits in the gap of these forces at d_k, so that

    work - dE - loss = 1/2 a(du, du) + p . dz     up to     |d_k - d_s|_K |d_k|_K + that work.

Where weights follow the slip, of the step and before it, convexity proves the certificate, if the rate of softening is
known and small (:mod:`vemcvx.stepping.state`). The iteration is accelerated then (Anderson 1965): law(T(w)) is taken to
be affine between the last weights tried, and the next weights are the fixed point of that. The proof holds for any
answer, whichever way it was found.

Without proof, because sets do not settle or the law is not known to be piecewise affine, the certificate is an
*estimate*:

    CAUTION (i_k rate + e_k) / (1 - rate),     rate: the largest of the last WINDOW ratios of the increments
    i_k = |d_k - d_{k-1}|_K + sum |w_k - w_{k-1}| |s| / |u|_K,    s: the larger slips,  u: the largest state,

e_k the certified error of the program, and infinite before there are WINDOW ratios. (The sum is there because a body
between walls may slip no further while weights still grow. The last ratio alone is no estimate of the constant of
contraction: it may be small by chance.) An iteration that does not contract is an error.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import length_hint

import numpy as np

from vemcvx.arrays import SAME, Floats, lengths
from vemcvx.errors import NotContracting, SceneError
from vemcvx.program.certificate import Certificate, limit_gaps, norm_gaps
from vemcvx.program.operators import Norms
from vemcvx.program.tolerances import SHARE
from vemcvx.solvers.coulomb import SOLVED, solution_near
from vemcvx.solvers.solver import Iterate
from vemcvx.stepping.posed_step import PosedStep, posed_sharply, refined_state
from vemcvx.stepping.state import PreparedRun, State

log = logging.getLogger("vemcvx")

MOST_PROGRAMS = 200
WINDOW = 3
CAUTION = 4.0
SLOWEST = 0.98
"""Iterations that contract more slowly than this, ten times in a row, will not get there in MOST_PROGRAMS."""
FEW_SETS = 10
"""Systems that may be solved from the sets of the step before; a bolted joint under cycles of load needs 4 to 6."""


def mixed(tried: list[tuple[Floats, Floats]]) -> Floats:
    """The weights to try next, after pairs (w, law(T(w))), by Anderson's acceleration."""
    last = tried[-6:]
    followed = np.array([f for _, f in last])
    missed = followed - [w for w, _ in last]
    share = np.linalg.lstsq(np.diff(missed, axis=0).T, missed[-1], rcond=1e-10)[0]
    best: Floats = np.maximum(followed[-1] - share @ np.diff(followed, axis=0), 0.0)
    return best


@dataclass(frozen=True)
class DependentStep:
    """A step whose weights depend on its answer: on the forces of its limits, or on its slip."""

    attempt: PosedStep  # the step with weights that follow the forces of the step before, and its slips
    norms: Norms
    n: int  # the step, for messages

    @property
    def run(self) -> PreparedRun:
        """The prepared run: data that all steps share."""
        return self.attempt.run

    @property
    def start(self) -> Floats:
        """Weights (m,) of the first program."""
        w = self.attempt.program.w
        # Friction under the earlier pressures may be too weak to hold a body without supports: begin with weights above
        # any load.
        held = self.run.operators.kernel is None
        return w if held else np.full(len(w), np.abs(self.attempt.program.g).sum())

    def pose(self, w: Floats, run: PreparedRun | None = None) -> PosedStep:
        """The step with the weights w (m,)."""
        return replace(self.attempt, run=run or self.run, program=replace(self.attempt.program, w=w))

    @property
    def replaces(self) -> bool:
        """True if a solution of the step may stand in for the solver's answer."""
        return self.run.solver.solves_on_sets

    def solve(self, w: Floats, near: State | None, spent: int) -> State:
        """The answer for the weights w (m,), begun near another, after so many iterations for the step.

        A program may take half of what iterations are left: sets may settle from an answer that is no good yet.
        """
        left = self.run.most - spent
        posed = self.pose(w, self.run.after(spent + int(left // 2) if np.isfinite(left) else 0))
        return posed.solve_balanced(self.n, SHARE, near)

    def from_before(self) -> tuple[State | None, int]:
        """A solution near the state that the one before lets expect, if a few sets find one, and how many it took.

        The sets of the step before are nearer than the answer to a program with its weights; for bodies without
        supports that program has the weights of `start`, under which all contacts stick.
        """
        if not (self.replaces and self.attempt.ordinary):
            return None, 0
        before, t = self.attempt.before, self.attempt.data.t
        return self.solution_near(before.ahead(t), 0, FEW_SETS)

    def solution_near(self, state: State, spent: int, most: float = np.inf) -> tuple[State | None, int]:
        """A solution of the step near the state, with the certificate of its own error, and how many sets it took.

        None if no solution is found, in as many sets as are left of the iterations, or `most` of them.
        """
        # With an iterative linear solver, W = A K^{-1} A' would take a solve for every row.
        if not (self.norms.sloped and self.run.operators.factor.exact):
            return None, 0
        most = int(min(self.run.most - spent, most, sys.maxsize))
        rounds = iter(range(most))
        found = self._on_sets(state, rounds)
        if found is not None and self.norms.remembers:
            self._check_slope(found)
        return found, most - length_hint(rounds)

    def _on_sets(self, state: State, rounds: Iterator[int]) -> State | None:
        """The solution of :mod:`vemcvx.solvers.coulomb` from the sets of the state, in the units of the system."""
        scales, posed = self.run.scaling, self.pose(state.weights)
        alpha = self.attempt.size or posed.size  # Where g is none, weights say what moves it.
        if alpha == 0.0:
            return replace(state, certificate=state.certificate.away(0.0))
        law = scales.law(self.norms.pressure_law(posed.data.t, posed.before.ledger.slipped), alpha)
        start = Iterate(
            scales.shrink(state.y - posed.before.y, alpha), *scales.guess(state.lam - posed.bias, state.p, alpha)
        )
        scaled = scales.scale(posed.program, alpha)
        found = solution_near(scaled, law, start, self.run.response, rounds)
        if found is None:
            return None
        at, w = found.point, found.weights
        followed = replace(scaled, w=w)
        floor = followed.rounding_floor(at.d, at.lam, at.p)
        # The gap under these weights knows nothing of sets. That of a solution is rounding, of whatever size.
        gap = np.sqrt(2.0 * followed.duality_gap(at.d, at.lam, at.p))
        error = gap if SOLVED * followed.operators.energy_norm(at.d) < gap < np.inf else found.error
        own = Certificate(0.0, np.zeros_like(w), floor, np.zeros_like(at.p)).away(error, not found.proven)
        answer = scales.restore(state.answer(at.d, at.lam, at.p), alpha)
        own = own.times(1.0 / scales.energy(1.0, alpha))
        return self.pose(scales.kappa * alpha * w / scales.sigma).state_after(answer, own)

    def _check_slope(self, found: State) -> None:
        """Raise SceneError where weights do depend on the slip of the step, which a slope is not known for."""
        own = self.law(found)
        off = np.abs(own - found.weights) - SAME * np.maximum(own, found.weights)
        if (off > 0).any():
            i = int(np.argmax(off))
            raise SceneError(
                f"friction: at {self.norms.name(i)} the slip of step {self.n} changes the weight from "
                f"{found.weights[i]:.6g} to {own[i]:.6g}, but its law has a slope, which is for laws that read the "
                "slip before the step alone; leave the slope out."
            )

    def certified(self, state: State, increments: list[float]) -> State:
        """The state under the weights of its own pressures and slip, after increments of such states."""
        w, stability, rate = self.law(state), self.run.stability, self.norms.softening
        posed = self.pose(w)
        if self.convex and stability is not None and rate is not None:
            self._check_softening(state, w, rate)
            # A multiplier at its bound stays there: what that misses of forces counts by its square.
            size, slip = lengths(state.lam - posed.bias), lengths(state.slip)
            slides = (slip > 0) & (w != state.weights) & (size >= (1.0 - SAME) * state.weights)
            along = np.divide(w, slip, out=np.zeros_like(w), where=slides)[:, None] * state.slip
            state = replace(state, lam=np.where(slides[:, None], along + posed.bias, state.lam))
            certificate = _convex_certificate(posed, state, stability.margin)
        else:
            last = [0.0] * (WINDOW + 1) if np.array_equal(w, state.weights) else increments
            # Smaller increments than these measure the solver's tolerance, not the contraction: all that follow add up
            # to at most half the accuracy.
            unit = self.run.accuracy * state.unit(self.run.accuracy)
            certificate = _estimated(state.certificate, last, 0.5 * (1.0 - SLOWEST) * unit * self.norms.remembers)
        d, lam = state.y - posed.before.y, posed.program.project(state.lam - posed.bias)
        return posed.state_after(state.answer(d, lam, state.p), certificate)

    @property
    def convex(self) -> bool:
        """True if weights follow the slip in a way that leaves the step convex."""
        stability = self.run.stability if self.norms.remembers else None
        return stability is not None and stability.margin > 0

    def _check_softening(self, state: State, w: Floats, rate: Floats) -> None:
        """Raise SceneError where weights have fallen faster than their law says."""
        start, slip = self.attempt.program.w, lengths(state.slip)
        over = start - w - rate * slip - SAME * (start + rate * (self.attempt.before.ledger.slipped + slip))
        if (over > 0).any():
            i = int(np.argmax(over))
            raise SceneError(
                f"friction: at {self.norms.name(i)} the weight fell from {start[i]:.6g} to {w[i]:.6g} over the slip "
                f"{slip[i]:.6g} of step {self.n}, faster than its law says: softening is {rate[i]:.6g}. State how fast "
                "it falls at most, or None for an estimate."
            )

    def with_forces_of(self, state: State, near: State) -> State:
        """The motion of the state under the forces of a solution near it, with the bound on its distance to that.

        The parts of friction and limits in the gap of these forces on the motion are added to the certificate.
        """
        posed = self.pose(near.weights)
        # y_n - y_{n-1} is d but for rounding, by which it may be beyond a bound, where the gap is infinite.
        program, d, lam = posed.program, posed.program.feasible(state.y - posed.before.y), near.lam - posed.bias
        error = self.run.operators.energy_norm(state.y - near.y) + near.certificate.error
        friction = norm_gaps(program.w, lam, program.slip(d))
        limits = limit_gaps(program.operators.compliance, near.p, program.excess(d), program.excess_blur(d))
        certificate = replace(near.certificate.away(error), friction=friction, limits=limits)
        return posed.state_after(state.answer(d, lam, near.p), certificate)

    def law(self, state: State) -> Floats:
        """Weights (m,) under the forces and after the slip of a state."""
        past, slip = self.attempt.before.ledger.slipped, lengths(state.slip)
        return self.norms.weights_under(self.attempt.data.t, state.p, past, slip)

    @property
    def subject(self) -> str:
        """The subject of messages: the quantity that contracts."""
        return f"the fixed point of friction that {'sees slip' if self.norms.remembers else 'follows contact'}"

    def still_changing(self, last: State, own: State) -> str:
        """The quantities that still change, in words: a program's answer, and that answer under its own weights."""
        if not self.norms.remembers:
            return "what sticks, slips and touches has not settled"
        change = (own.weights - last.weights) * np.sqrt(self.run.operators.norm_flexibility)
        i = int(np.argmax(np.abs(change)))
        place, stability = self.norms.name(i), self.run.stability
        stated = "" if stability is None else f" (softening over stiffness is {stability.rho:.3g} of the 1 it may be)"
        by = abs(float(own.weights[i] - last.weights[i]))
        return f"weights still change, at {place} by {by:.1e} of {last.weights[i]:.3g}{stated}"

    @property
    def advice(self) -> str:
        """Advice where the fixed point does not contract."""
        if not self.norms.remembers:
            return (
                "Take a smaller coefficient or bound, a cap, NormalCompliance in place of UnilateralContact, smaller "
                "steps, or a sharper solver (Newton). Where a bound jumps as contact opens (while_closed=True), a step "
                "may have no answer, however small it is: a place opens under friction and closes without."
            )
        if self.convex:
            return "The step has one answer, which is not found: let weights change more slowly with slip."
        return (
            "Where friction changes with slip faster than the body gives way, a step may have no or several answers, "
            "however small it is: take a law that changes over a longer slip, a stiffer body, or one that reads the "
            "slip before the step alone. If weights do not fall with slip, softening=0 says so, and helps."
        )

    def increment(self, one: State, other: State) -> float:
        """Energy norm of the difference, and the work of that of their weights on the larger slips, over the norm."""
        slip, accuracy = np.maximum(lengths(one.slip), lengths(other.slip)), self.run.accuracy
        work = float(np.abs(one.weights - other.weights) @ slip)
        apart, unit = self.run.operators.energy_norm(one.y - other.y), max(one.unit(accuracy), other.unit(accuracy))
        return apart + work / (unit or np.inf)


def resolved(step: DependentStep) -> State:
    """The state whose weights are those that its own pressures and slip call for.

    NotContracting where sets do not settle, and successive iterates do not come closer, or too slowly.
    """
    n, accuracy = step.n, step.run.accuracy
    found, iterations = step.from_before()
    if found is not None and found.accepted(accuracy):
        return replace(found, iterations=iterations, safeguards=0, rate=np.nan)
    w, safeguards = step.start, 0
    before: State | None = None
    increments: list[float] = []
    tried: list[tuple[Floats, Floats]] = []
    for count in range(1, MOST_PROGRAMS + 1):
        state = step.solve(w, before, iterations)
        iterations, safeguards = iterations + state.iterations, safeguards + state.safeguards
        near, rounds = step.solution_near(state, iterations)
        iterations += rounds
        if before is not None:
            increments.append(step.increment(state, before))
        if near is None:
            own = step.certified(state, increments)
        else:  # Solvers that solve on sets answer with the solution itself; of all others the motion stays.
            own = near if step.replaces else step.with_forces_of(state, near)
        rate = _rate(increments, 1)
        own = replace(own, iterations=iterations, safeguards=safeguards, rate=rate)
        error = own.certificate.error / (own.unit(accuracy) or np.inf)
        level = logging.INFO if count > 3 else logging.DEBUG
        log.log(level, "step %d, program %d: %d iterations so far, error %.1e", n, count, iterations, error)
        if own.accepted(accuracy) or (near is not None and step.replaces):
            return own
        if iterations >= step.run.most:
            return replace(own, status="iteration limit")
        followed = step.law(state)
        if step.norms.remembers and np.array_equal(followed, w):
            return own  # The same program would be answered alike.
        tried.append((w, followed))
        if _stagnates(increments):
            if near is not None:
                return own  # The sets have settled: it is the solver that comes no nearer to what they lead to.
            break
        w, before = mixed(tried) if step.convex else followed, state
    after = f"{count} programs {step.still_changing(state, own)}, and the estimated error is {error:.1e}"
    raise _not_contracting(step, state.t, rate, f"after {after}, asked was {accuracy:.1e}")


def _not_contracting(step: DependentStep, t: float, rate: float, why: str) -> NotContracting:
    how = f"contracts with the rate {rate:.3g} only" if rate >= 0.5 else "does not settle"
    how = f"does not contract, increments grow by the factor {rate:.3g}" if rate > 1.0 else how
    message = f"step {step.n} at t = {t:.6g}: {step.subject} {how}: {why}."
    return NotContracting(f"{message} {step.advice}", step=step.n, time=t, rate=rate)


def _rate(increments: list[float], window: int) -> float:
    """The largest of the last ratios of increments; NaN where there are not so many."""
    last = np.array(increments[-window - 1 :])
    if len(last) <= window:
        return np.nan
    return float(np.divide(last[1:], last[:-1], out=np.zeros(window), where=last[:-1] > 0).max())


def _stagnates(increments: list[float]) -> bool:
    """Return True if increments shrink too slowly, or twenty-five in a row do not halve the least of those before."""
    slow = len(increments) > 10 and all(b >= SLOWEST * a for a, b in pairwise(increments[-11:]))
    idle = len(increments) > 25 and min(increments[-25:]) >= 0.5 * min(increments[:-25])
    return slow or idle


def _convex_certificate(posed: PosedStep, state: State, margin: float) -> Certificate:
    """The certificate of a state under the weights of its own slip, which is that of this program over the margin.

    See :mod:`vemcvx.stepping.state`.
    """
    scales = posed.run.scaling
    alpha = scales.size(posed.program)
    if alpha == 0.0:
        return state.certificate
    scaled = scales.scale(posed.program, alpha)
    lam, p = scales.guess(state.lam - posed.bias, state.p, alpha)
    own = scaled.certify(scales.shrink(state.y - posed.before.y, alpha), scaled.project(lam), p)
    own = own.times(1.0 / scales.energy(1.0, alpha))
    return replace(own, floor=own.floor / margin**2).away(own.error / margin, False)


def _estimated(own: Certificate, increments: list[float], quiet: float) -> Certificate:
    """An estimate of how far further programs would move an answer, from the certificate of its own program."""
    rate, last = _rate(increments, WINDOW), increments[-WINDOW - 1 :]
    error = CAUTION * (rate * increments[-1] + own.error) / (1.0 - rate) if rate < SLOWEST else np.inf
    if len(last) > WINDOW and max(last) <= quiet:
        error = min(error, max(last) / (1.0 - SLOWEST) + CAUTION * own.error)
    return own.away(error, estimate=True)


def refined_step(attempt: PosedStep, state: State, n: int) -> State:
    """The state refined; once more, posed with what the first time has shown to act, if it must be.

    Soft limits yield to the error of a program's forces. Bounds take that error and hold their place; but weights that
    follow pressures were evaluated before these were refined, which no gap shows: on springs of 1e-6 of the body's
    modulus they were off by 3e-8 under a certificate of 1e-12.
    """
    run, state = attempt.run, refined_state(attempt, state)
    follows, soft = run.system.follows_answer, bool(run.operators.compliance.any())
    if not follows and (not soft or state.accepted(run.accuracy)):
        return state
    again = posed_sharply(attempt, state)
    return refined_state(again, solved(again, n))


def solved(attempt: PosedStep, n: int) -> State:
    """The step; weights that depend on the answer begin with those it was posed with."""
    norms = attempt.run.system.norms
    if norms is not None and norms.law is not None:
        return resolved(DependentStep(attempt, norms, n))
    return attempt.solve_balanced(n)
