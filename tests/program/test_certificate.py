"""The certificate against its theorem, and against solutions known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import vemcvx as vx
from vemcvx.program.certificate import norm_gaps
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import StepProgram

pytestmark = pytest.mark.arithmetic


def random_program(seed, n=9, m=4, block=1):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    K = A @ A.T + 0.1 * np.eye(n)
    B = rng.normal(size=(m * block, n))
    w = rng.uniform(0.1, 1.0, size=m)
    return StepProgram(
        Operators(K, sp.csr_matrix(B), block), rng.normal(size=n) * 3, w, rng.normal(size=m * block) * 0.1
    )


def solution(program):
    """The solution by the hand-written solver, to the rounding floor."""
    prepared = vx.Newton().prepare(program.operators)
    answer = prepared.solve(program, 1e-30, np.zeros((program.operators.count, program.operators.block)))
    return answer.d, answer.lam


def test_inadmissible_multipliers_are_projected_first():
    program = random_program(0)
    d, lam = solution(program)
    assert program.certify(d, 1e6 * lam + 1.0).gap >= program.certify(d, lam).gap


def test_norm_gaps_do_not_cancel():
    """w|s| - lam.s for lam within one ulp of w s/|s| is of the size of the angle squared, not of rounding."""
    s = np.array([[3e-5, 4e-5]])
    angle = 1e-9
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    w = np.array([2.0])
    lam = w * (s / 5e-5) @ turn.T
    exact = 2.0 * 5e-5 * (1 - np.cos(angle))
    assert 2.0 * 5e-5 * angle**2 / 2 == pytest.approx(1e-22)
    assert exact == 0.0  # the naive formula has lost everything
    assert norm_gaps(np.maximum(w, np.linalg.norm(lam, axis=1)), lam, s)[0] == pytest.approx(5e-23 * 2, rel=1e-3)


def test_multipliers_on_their_circle_cost_nothing():
    """lam = w s / |s|, rounded: few floats have the length w, and what it lacks is no gap."""
    rng = np.random.default_rng(0)
    n = 200
    w, s = rng.uniform(0.5, 2.0, n), rng.normal(size=(n, 2))
    lam = w[:, None] * s / np.linalg.norm(s, axis=1)[:, None]
    program = StepProgram(
        Operators(np.eye(2 * n), sp.csr_matrix(np.eye(2 * n)), 2), (s + lam).ravel(), w, np.zeros(2 * n)
    )
    assert (np.linalg.norm(program.project(lam), axis=1) < w).any()
    certificate = program.certify(s.ravel(), lam)
    # Both are squares of rounding errors, 2 n of them.
    assert certificate.gap <= certificate.floor <= 2 * n * (8 * np.finfo(float).eps) ** 2 * 16


def test_slider_in_closed_form():
    """min 1/2 K d^2 - g d + w|d|: d = soft(g, w) / K, lam = clip(g, -w, w)."""
    for g in (-5.0, -0.3, 0.0, 0.4, 7.0):
        program = StepProgram(
            Operators(np.array([[2.0]]), sp.eye_array(1, format="csr")), np.array([g]), np.ones(1), np.zeros(1)
        )
        d, lam = solution(program)
        assert d[0] == pytest.approx(np.sign(g) * max(abs(g) - 1, 0) / 2, abs=1e-15)
        assert lam[0, 0] == pytest.approx(np.clip(g, -1, 1), abs=1e-15)
        assert program.certify(d, lam).gap < 1e-30


def test_small_units_do_not_fool_the_conic_solver():
    """Interior-point solvers call 40-70 % wrong answers solved in small units; scaled inside, they do not."""
    rng = np.random.default_rng(1)
    A = rng.normal(size=(12, 12))
    K, f = A @ A.T + np.eye(12), rng.normal(size=12) * 3
    norms = vx.Norms(np.eye(12)[:6], np.full(6, 0.5))
    plain = vx.march(vx.System(K, lambda t: t * f, norms), [0, 0.5, 1], solver=vx.Clarabel())
    tiny = vx.march(
        vx.System(1e-10 * K, lambda t: 1e-16 * t * f, vx.Norms(norms.B, 1e-16 * norms.w)),
        [0, 0.5, 1],
        solver=vx.Clarabel(),
    )
    assert tiny.certificate.max() < 1e-6
    assert np.allclose(tiny.state, 1e-6 * plain.state, rtol=1e-5, atol=1e-11 * np.abs(plain.state).max())
