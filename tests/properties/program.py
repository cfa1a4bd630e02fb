"""Properties of a step's program: convexity, admissible multipliers, optimality, and true certificates."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import strategies as st
from strategies import SEEDS, cases, exponents, for_all

import vemcvx as vx
from properties.rounding import EPS, marched
from vemcvx.program.certificate import norm_gaps

SHARP = vx.Newton(accuracy=1e-10)
POOR = st.floats(2, 6).map(lambda x: vx.Clarabel(accuracy=10**-x, options=dict.fromkeys(("tol_gap_rel",), 10**-x)))


def draw_increments(run, n, size, rng):
    """Return a random increment, three variations of the answer, the increment without friction, and zero."""
    d, program = run.increment(n), run.program(n)
    free = np.linalg.solve(run.case.K, program.g)
    random = size * run.energy.norm(free) * np.linalg.solve(run.energy.factor, rng.normal(size=len(d)))
    return [random, d + random, d + 1e-6 * random, free, np.zeros_like(d), d * rng.uniform(0, 2)]


@for_all(case=cases(), size=exponents(-3, 1), seed=SEEDS, share=st.floats(0, 1))
def objective_is_strongly_convex(case, size, seed, share):
    """P((1 - t) a + t b) <= (1 - t) P(a) + t P(b) - t (1 - t)/2 |a - b|_K^2 for t = 1/2 and a random t.

    P is the objective of the step. The statement is an identity for quadratic terms, and the triangle inequality for
    norms. `blur` bounds the rounding errors of P and of |a - b|_K^2.
    """
    run, rng = marched(case, SHARP), np.random.default_rng(seed)
    for n in range(1, len(case.times)):
        program, points = run.program(n), draw_increments(run, n, size, rng)
        for a, b in pairwise(points):
            for t in (0.5, share):
                between = (1 - t) * a + t * b
                gain = 0.5 * t * (1 - t) * run.energy.norm(a - b) ** 2
                chord = (1 - t) * program.objective(a) + t * program.objective(b)
                blur = run.blur_of_objective(n, a, b, np.abs(a) + np.abs(b))
                assert program.objective(between) <= chord - gain + blur


@for_all(case=cases(), exponent=st.floats(3, 8), which=st.sampled_from("NC"))
def answers_obey_the_law_of_friction(case, exponent, which):
    """Multipliers obey |lam_i| <= w_i, K y + B'lam = f up to the certified error, and sum w|s| - lam.s <= gap.

    Here y is the state, f the load, s the slip of a step, and w are the weights. Each summand of the gap is between 0
    and the gap. So |f - B'lam - K y|_{K^-1} <= sqrt(2 gap), and w|s| - lam.s <= gap. By theorem 2
    (:mod:`vemcvx.program.certificate`), the certified gap may belong to d - v instead of the increment d, with an
    energy norm |v|_K <= error / 2. The slip s then changes by B v, and w|s| - lam.s by at most 2w |B v|. |B_i v| is at
    most |v|_K times the root of `norm_flexibility`. Bounds include rounding errors of stored states. In blocks of two
    components, |lam| <= w holds up to the rounding of a division and a root.
    """
    solver = {"N": vx.Newton, "C": vx.Clarabel}[which](accuracy=10**-exponent)
    run = marched(case, solver)
    t = run.trajectory
    for n in range(1, len(case.times)):
        lam, w = t.multipliers[n], case.weights[n]
        assert (np.linalg.norm(lam, axis=1) <= w * (1 + (0 if case.block == 1 else 4 * EPS))).all()
        force = case.loads[n] - case.B.T @ lam.ravel()
        slack = run.energy.rounding_of_forces(np.abs(case.loads[n]) + abs(case.B).T @ np.abs(lam.ravel()), t.state[n])
        assert run.energy.force_norm(force - case.K @ t.state[n]) <= run.errors[n] + slack
        friction_gap, blur = run.friction_gap(n)
        blur += run.errors[n] * float(run.capped_weights(n) @ np.sqrt(run.operators.norm_flexibility))
        assert friction_gap <= t.gap[n] + t.floor[n] + blur


@for_all(case=cases(), size=exponents(-8, 1), seed=SEEDS)
def no_competitor_is_better(case, size, seed):
    """No increment c has an objective P(c) below P(d) - G, where d is the stored increment.

    G is primal minus dual objective at d. So P(d) - P(d*) <= G for the exact d*, by weak duality. The gap of a
    certificate can be less than G, because theorem 2 bounds |d - d*|_K, but not P(d) - P(d*). Strong convexity gives
    1/2 |c - d*|^2 <= P(c) - P(d*) <= P(c) - P(d) + G. So |d - c|_K <= error + sqrt(2 (P(c) - P(d) + G)).
    """
    run, rng = marched(case, SHARP), np.random.default_rng(seed)
    for n in range(1, len(case.times)):
        program, d = run.program(n), run.increment(n)
        lam = run.trajectory.multipliers[n]
        own = program.certify(d, lam)
        duality = own.equilibrium + own.floor + norm_gaps(program.w, lam, program.slip(d)).sum()
        for c in draw_increments(run, n, size, rng):
            blur = run.blur_of_objective(n, c, d)
            above = program.objective(c) - program.objective(d) + duality + blur
            assert above >= 0
            slack = run.energy.of_blurred_state(EPS * (np.abs(c) + np.abs(d)))
            assert run.energy.norm(d - c) <= np.sqrt(2 * (own.gap + own.floor)) + np.sqrt(2 * above) + slack


@for_all(case=cases(), poor=POOR, size=exponents(-6, 1), seed=SEEDS)
def certificates_bound_the_true_error(case, poor, size, seed):
    """A poor answer and Newton's sharp answer to a step differ by at most the sum of both certified errors.

    Random increments c with Newton's multipliers are certified, too. If c has the active sets of the exact d*, the gap
    at c is exactly 1/2 |c - d*|_K^2, so a certificate that is slightly too small fails. `known` bounds the rounding
    error of the residual in the energy norm.
    """
    run, rng = marched(case, poor), np.random.default_rng(seed)
    shape = (len(case.weights[0]), case.block)
    newton = vx.Newton().prepare(run.operators)
    for n in range(1, len(case.times)):
        program = run.program(n)
        answer = newton.solve(program, (1e-12 * run.size) ** 2, np.zeros(shape))
        own = program.certify(answer.d, answer.lam)
        sharp = np.sqrt(2 * own.gap) + np.sqrt(2 * own.floor)
        known = run.energy.rounding_of_forces(case.loads[n], run.trajectory.state[n - 1])
        distance = run.energy.norm(run.increment(n) - answer.d)
        assert distance <= run.errors[n] + sharp + known
        for c in draw_increments(run, n, size, rng):
            beside = program.certify(c, answer.lam)
            blur = run.energy.of_blurred_state(EPS * (np.abs(c) + np.abs(answer.d)))
            known = run.energy.rounding_of_forces(program.g, c, answer.d)
            assert run.energy.norm(c - answer.d) <= np.sqrt(2 * (beside.gap + beside.floor)) + sharp + blur + known
