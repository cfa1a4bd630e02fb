"""Norm terms of infinite weight are equality constraints."""

import numpy as np
import pytest
from scipy.linalg import null_space

import vemcvx as vx


@pytest.mark.parametrize("block", [1, 2])
def test_terms_of_infinite_weight_always_stick(block):
    """Every solver finds the minimiser under B_1 d = b_1, and the multiplier that balances all forces."""
    rng, n, m = np.random.default_rng(3), 8, 3
    root, B, D = rng.normal(size=(n, n)), rng.normal(size=(m * block, n)), rng.normal(size=(2, n))
    K, g, b = root @ root.T + np.eye(n), 3.0 * rng.normal(size=n), 0.1 * rng.normal(size=m * block)
    w, e, fixed = np.array([0.3, np.inf, 0.1]), np.array([0.05, 0.2]), np.repeat([False, True, False], block)
    program = vx.StepProgram(vx.Operators(K, B, block, D=D), g, w, b, e)
    # Let d = d_0 + Z y with B_1 d_0 = b_1 and B_1 Z = 0. The program for y omits term 1.
    start, Z = np.linalg.pinv(B[fixed]) @ b[fixed], null_space(B[fixed])
    operators = vx.Operators(Z.T @ K @ Z, B[~fixed] @ Z, block, D=D @ Z)
    reduced = vx.StepProgram(operators, Z.T @ (g - K @ start), w[[0, 2]], b[~fixed] - B[~fixed] @ start, e - D @ start)
    y = solve(vx.Newton(), reduced)
    d = start + Z @ y.d
    lam = np.linalg.lstsq(B[fixed].T, g - K @ d - B[~fixed].T @ y.lam.ravel() - D.T @ y.p, rcond=None)[0]
    for solver in (vx.Newton(), vx.Clarabel(), vx.OSQP() if block == 1 else vx.ThroughCvxpy("SCS")):
        answer = solve(solver, program)
        certificate = program.certify(answer.d, answer.lam, answer.p)
        assert certificate.error < 1e-6
        assert np.abs(answer.d - d).max() <= 1e-6
        assert answer.lam[1] == pytest.approx(lam, abs=1e-5)
    # The certificate corrects d, and the error includes the correction.
    assert program.certify(d + 0.01, answer.lam, answer.p).error > 0.01
    assert program.objective(d + 0.01) == np.inf
    assert program.certify(d).error < 1e-6


def solve(solver, program):
    return solver.prepare(program.operators).solve(program, 1e-14, np.zeros((len(program.w), program.operators.block)))


def test_a_weight_that_becomes_infinite_locks_a_spring():
    """A load stretches the spring by 3/2. Then the term locks the spring, and the load vanishes."""
    norms = vx.Norms(np.eye(1), lambda t: np.array([0.0 if t <= 1 else np.inf]))
    run = vx.march(vx.System(2.0 * np.eye(1), lambda t: np.array([3.0 * min(t, 2.0 - t)]), norms), [0.0, 1.0, 1.5, 2.0])
    assert run.state[:, 0] == pytest.approx([0.0, 1.5, 1.5, 1.5], abs=1e-14)
    assert run.multipliers[:, 0, 0] == pytest.approx([0.0, 0.0, -1.5, -3.0], abs=1e-13)
    assert run.dissipated == pytest.approx(np.zeros(4), abs=1e-14)
    assert run.dissipated_second_order == pytest.approx(np.zeros(4), abs=1e-14)
