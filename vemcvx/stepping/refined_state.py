"""A step refined against K itself on all unknowns, where its factors have lost too many digits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vemcvx.arrays import EPS, Bools, Floats
from vemcvx.program.certificate import limit_gaps, norm_gaps
from vemcvx.program.iterative_refinement import full_certificate, refined, residual
from vemcvx.program.operators import Operators
from vemcvx.solvers.sets import Shifts
from vemcvx.stepping.ledger import advance_in_full
from vemcvx.stepping.posed_step import PosedStep
from vemcvx.stepping.state import State


def refined_state(attempt: PosedStep, state: State) -> State:
    """The state after iterative refinement against the original K; slips, ledger and certificate are those of it."""
    run, before, operators = attempt.run, attempt.before, attempt.run.operators
    force, remaining_gap, retained = state.data.force, state.data.remaining_gap, run.condensation.retained
    stick = np.linalg.norm(state.lam + Shifts.of(operators).norms[:, None] * state.slip, axis=1) <= state.capped_weights
    y = run.condensation.recover(state.y, force)
    held = {"gap": remaining_gap, "lam": state.lam, "p": state.p, "stick": stick, "slip": state.slip}
    y, lam, p = refined(run.condensation, operators, force.phi, y, **held)
    lam, p = replace(attempt.program, w=state.capped_weights).project(lam), np.maximum(p, 0.0)
    # What was free to move may have moved a rounding error beyond its bound.
    bounds, beyond = operators.compliance == 0, operators.limits.read(y[retained]) - remaining_gap
    y[retained[operators.limits.columns]] -= np.where(bounds, np.maximum(beyond, 0.0), 0.0) / operators.D.data
    # What sticks has not moved, and keeps its slip to the last bit; what slips may have lost its direction to rounding.
    slip = state.slip + operators.blocks(operators.rows.read(y[retained] - state.y))
    aligned = _aligned(attempt.run.operators, state.capped_weights, lam=lam, slip=slip, stick=stick)
    y[retained[operators.rows.columns]] += (aligned - slip).ravel() / operators.B.data
    slip, moved, excess = aligned, y[retained] - state.y, operators.limits.read(y[retained]) - remaining_gap
    over = limit_gaps(operators.compliance, p, excess, EPS * (np.abs(remaining_gap) + np.abs(excess)))
    # Bounds that act are as far as they were; what their difference of two places says of that is rounding.
    acts = bounds & (state.p > 0)
    over[acts] = state.certificate.limits[acts] * (p[acts] / state.p[acts])
    # Where weights depend on the answer its distance to a solution stays; else the gap of what is refined says all.
    away = state.certificate.distance if run.system.follows_answer else 0.0
    friction = norm_gaps(state.capped_weights, lam, slip)
    own = replace(state.certificate, equilibrium=0.0, friction=friction, limits=over, distance=away, moved=0.0)
    answer = state.answer(state.y - before.y + moved, lam, p)
    between, ends = (before.data, state.data), (before.unknowns, y)
    ledger = advance_in_full(run.system, before.ledger, between, ends, answer=answer, slip=slip, w=state.capped_weights)
    return replace(
        state,
        y=y[retained],
        full=y,
        unbalanced=operators.multiplier_force(lam, p),
        lam=lam,
        p=p,
        slip=slip,
        certificate=full_certificate(run.condensation, force.phi, y, run.system.multiplier_force(lam, p), own),
        ledger=ledger,
        scale=float(np.maximum(before.scale, ledger.norm)),
    )


def posed_sharply(attempt: PosedStep, refined: State) -> PosedStep:
    """The step with the forces on the retained unknowns that a refined state shows to act there.

    g = K d + B'lam + D'p and what the residual does there. On weak springs the response x to a load goes far, and g,
    taken as S x_c, is known to a rounding error of S times that: too little for sets and pressures.
    """
    run, d = attempt.run, refined.y - attempt.before.y
    held = run.system.multiplier_force(refined.lam, refined.p)
    r = residual(attempt.data.force.phi, run.system.K, refined.unknowns, held)
    left = run.condensation.reduce(r, remembered=False)
    return replace(
        attempt, program=replace(attempt.program, g=refined.unbalanced + run.operators.force(d) + left.retained)
    )


def _aligned(operators: Operators, w: Floats, lam: Floats, slip: Floats, stick: Bools) -> Floats:
    """Slips (m, block) that point where their multipliers do, but for those that stick.

    A slip that is turned by e costs an energy of about e^2 / 2 over the term's flexibility, and is left as it is where
    it costs no more than that: where contact is open, the direction of a multiplier is that of rounding.
    """
    square = np.einsum("ij,ij->i", lam, lam)
    share = np.divide(np.einsum("ij,ij->i", lam, slip), square, out=np.zeros_like(square), where=square > 0)
    turned = np.where(square[:, None] > 0, np.maximum(share, 0.0)[:, None] * lam, slip)
    cost = 0.5 * np.einsum("ij,ij->i", turned - slip, turned - slip)
    stays = stick | (cost >= operators.norm_flexibility * norm_gaps(w, lam, slip))
    return np.where(stays[:, None], slip, turned)
