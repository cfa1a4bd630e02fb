"""Frictional steps in space on multigrid: matrix-free, inexact, certified, and as good as on direct factors."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from blocks_in_space import assert_within_both_certificates, block, on_floor
from scipy.sparse.linalg import LinearOperator, cg

import vemcvx as vx
from vemcvx.linear.multigrid import Hierarchy
from vemcvx.program.step_program import StepProgram
from vemcvx.program.tolerances import UNSEEN
from vemcvx.solvers.newton import Sets, answer_on
from vemcvx.solvers.solver import Iterate
from vemcvx.stepping.backward_euler import march
from vemcvx.stepping.state import prepare

pytest.importorskip("pyamg")

TIMES = np.linspace(0.0, 1.0, 7)


def turning(t):
    angle, pull = 2 * np.pi * t, 0.5 * min(1.0, 4 * t)
    return np.array([pull * np.cos(angle), pull * np.sin(angle), -0.2 * pull])


def systems():
    body = block(6)
    return {
        "bilateral": on_floor(body, turning, bound=0.2),
        "one-sided": on_floor(body, lambda t: turning(t) - [0, 0, min(1.0, 4 * t)], contact="unilateral", bound=0.1),
    }


@pytest.mark.long
@pytest.mark.parametrize("name", ["bilateral", "one-sided"])
def test_steps_on_multigrid_are_those_of_direct_factors(name):
    """Within both certificates, sticking the same terms; most of them stick and slip at some instant."""
    system = systems()[name]
    direct, iterative = (march(system, TIMES, linear=linear) for linear in (vx.SuperLU(), vx.Multigrid()))
    assert_within_both_certificates(system, direct, iterative)
    assert 0.2 < direct.sticking[1:].mean() < 0.8


@pytest.mark.long
def test_linear_systems_are_solved_no_more_sharply_than_sets_are_known(monkeypatch):
    """Two thirds, at most, of the conjugate gradients that it would take to solve each of them to rounding."""
    counted = []

    def counting(*args, **kwargs):
        counted.append(0)
        return cg(*args, **kwargs, callback=lambda x: counted.__setitem__(-1, counted[-1] + 1))

    system = systems()["bilateral"]
    factor = vx.Multigrid().factorise(system.K, system.near_kernel)
    monkeypatch.setattr("vemcvx.linear.multigrid.cg", counting)
    factor.solve(system.force(1.0))
    once = counted.pop()
    monkeypatch.setattr("vemcvx.linear.multigrid.cg", cg)
    monkeypatch.setattr("vemcvx.linear.factor.cg", counting)
    history = march(system, TIMES, linear=vx.Multigrid())
    assert len(counted) == history.iterations.sum() > 4 * (len(TIMES) - 1)
    assert sum(counted) < 2 / 3 * once * len(counted)


@pytest.mark.long
def test_stiffness_that_is_added_is_in_the_preconditioner():
    """Slips so small that their curvature is a hundred times K: every correction gains its digits nevertheless."""
    operators = prepare(systems()["bilateral"], vx.Newton(), True, True, vx.Multigrid()).scaling.operators
    m, n = operators.count, operators.K.shape[0]
    program = StepProgram(operators, operators.K @ np.cos(np.arange(n)), np.full(m, 1.0), np.zeros(2 * m))
    slipping = Sets(np.zeros(m, dtype=bool), np.tile([0.6, 0.8], (m, 1)), np.full(m, 300.0), np.zeros(0, dtype=bool))
    exact = answer_on(program, slipping).d
    near = Iterate(np.zeros(n), np.zeros((m, 2)), np.zeros(0))
    errors = []
    for _ in range(6):
        near = answer_on(program, slipping, near)
        errors.append(np.sqrt((near.d - exact) @ (operators.K @ (near.d - exact))))
    # The residual of every one is UNSEEN of the one before, in another norm.
    assert errors[-1] < (3 * UNSEEN) ** 5 * errors[0]


@pytest.mark.long
def test_flexibilities_are_estimated_by_a_few():
    """Of iterative factors: from above where looked at, hence nowhere far below."""
    system = systems()["bilateral"]
    exact, estimate = (
        prepare(system, vx.Newton(), True, True, linear).operators.norm_flexibility
        for linear in (vx.SuperLU(), vx.Multigrid())
    )
    assert (estimate > 0.5 * exact).all()
    assert (estimate < 4.0 * exact).all()


@pytest.mark.long
def test_what_is_held_and_what_is_stiff_is_known_on_every_level():
    """The coarse matrices are Galerkin's, and a cycle of K + S on the free unknowns is positive definite, below 1.

    It takes no more conjugate gradients there than the cycle of K takes for K, but for a few.
    """
    system, rng = systems()["bilateral"], np.random.default_rng(5)
    K, n, touched = system.K, system.n, system.retained
    free = np.ones(n, dtype=bool)
    free[touched[::2]] = False
    stiff = np.zeros(n)
    stiff[touched[1::2]] = 300.0 * K.diagonal()[touched[1::2]]
    S = sp.csr_matrix(sp.diags_array(stiff))
    whole = Hierarchy.of(K, system.near_kernel)
    cycle = vx.Multigrid().factorise(K, system.near_kernel).cycle(S, free)
    mask = sp.diags_array(free.astype(float))
    P = mask @ whole.P[0]
    exact = P.T @ ((K + S) @ P)
    coarse = whole.within(S, free).A[1]
    assert abs(coarse - exact).max() < 1e-12 * abs(exact).max()
    F = np.flatnonzero(free)
    basis = rng.normal(size=(n, 30)) * free[:, None]
    answers = np.column_stack([cycle(b) for b in basis.T])
    assert not answers[~free].any()
    both = basis.T @ answers
    assert np.abs(both - both.T).max() < 1e-12 * np.abs(both).max()
    assert np.linalg.eigvalsh(both).min() > 0
    taken = []
    for matrix, M in ((K, whole.cycle), ((K + S)[F][:, F], lambda b: cycle(np.bincount(F, b, n))[F])):
        calls: list[int] = []
        M = LinearOperator(matrix.shape, matvec=M, dtype=float)
        cg(matrix, rng.normal(size=matrix.shape[0]), rtol=1e-8, M=M, callback=lambda x, calls=calls: calls.append(1))
        taken.append(len(calls))
    assert taken[1] <= taken[0] + 5


def test_all_may_be_held():
    K = sp.csr_matrix(np.diag([1.0, 2.0, 2.0, 2.0]) - np.eye(4, k=1) - np.eye(4, k=-1))
    cycle = vx.Multigrid().factorise(K).cycle(sp.csr_matrix((4, 4)), np.zeros(4, dtype=bool))
    assert np.array_equal(cycle(np.zeros(4)), np.zeros(4))
