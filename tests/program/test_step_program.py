"""A program in public: posed to any solver, certified with the multipliers that are given, or read off the answer."""

from __future__ import annotations

import re

import numpy as np
import pytest
import scipy.sparse as sp
from test_certificate import random_program, solution

import vemcvx as vx
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import Answer, SolvedProgram, StepProgram

EPS = float(np.finfo(float).eps)


def with_limits(seed, own, soft=False):
    """Norm terms and limits that read unknowns of their own, or share them; more unknowns than rows."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(10, 10))
    B, D = (np.eye(10)[2:5], np.eye(10)[6:9]) if own else (rng.normal(size=(3, 10)), rng.normal(size=(3, 10)))
    compliance = np.array([0.0, 0.5, 0.1]) if soft else np.zeros(3)
    operators = Operators(A @ A.T + np.eye(10), sp.csr_matrix(B), D=sp.csr_matrix(D), compliance=compliance)
    g, w = 4 * rng.normal(size=10), rng.uniform(0.1, 1.0, 3)
    return StepProgram(operators, g, w, 0.1 * rng.normal(size=3), rng.uniform(-0.1, 0.2, 3))


def answered(program):
    """The answer of our own solver, whose certificate is at the rounding floor."""
    lam = np.zeros((program.operators.count, program.operators.block))
    answer = vx.Newton().prepare(program.operators).solve(program, 1e-30, lam, np.zeros(len(program.e)))
    certificate = program.certify(answer.d, answer.lam, answer.p)
    assert certificate.gap <= certificate.floor < 1e-12
    return answer


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("own", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_multipliers_are_read_off_the_answer(seed, own, soft):
    """The rows are independent, so there is one pair with K d = g - B'lam - D'p, known here from the solver."""
    program = with_limits(seed, own, soft)
    assert (program.operators.own_columns is not None) == own
    answer = answered(program)
    rows = np.vstack([program.operators.B.toarray(), program.operators.D.toarray()])
    spread = np.linalg.norm(np.linalg.pinv(rows.T), 2) * np.linalg.cond(program.operators.K)
    for given in ({}, {"lam": answer.lam}, {"p": answer.p}):
        lam, p = program.multipliers(answer.d, **given)
        assert np.abs(lam - answer.lam).max() < 1e3 * EPS * spread
        assert np.abs(p - answer.p).max() < 1e3 * EPS * spread
        # Second order where r is concerned; first order in the multipliers of what slips or is open.
        assert program.certify(answer.d, **given).gap < 1e3 * EPS * spread


@pytest.mark.parametrize("seed", range(4))
def test_a_certificate_without_multipliers_is_one(seed):
    """Of any d within its bounds; and it is small where the error is."""
    program = with_limits(seed, own=True)
    exact, gaps = answered(program).d, []
    rng = np.random.default_rng(seed)
    for size in (1e-6, 1e-3, 1.0):
        d = program.feasible(exact + size * rng.normal(size=len(exact)))
        found = program.certify(d)
        assert 0.5 * (d - exact) @ program.operators.K @ (d - exact) <= found.gap + found.floor
        gaps.append(found.gap)
    assert max(gaps[:2]) < 1e-3 * gaps[2]


@pytest.mark.parametrize("seed", range(30))
def test_a_point_just_beyond_a_vertex_is_moved_back_onto_it(seed):
    """K = I, two oblique bounds that meet in a vertex, forces p > 0 there: d off by 1e-9 is certified to about that.

    With c = |off|, p.(e - D d) is at most (p_1 + p_2) |D| |d - d*|, and the nearest point is no farther than 2 c / sin.
    """
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.05, 0.95) * np.pi
    D = np.array([[1.0, 0.0], [np.cos(angle), np.sin(angle)]])
    vertex, p = rng.normal(size=2), rng.uniform(1.0, 3.0, 2)
    operators = Operators(np.eye(2), sp.csr_matrix((0, 2)), D=sp.csr_matrix(D))
    program = StepProgram(operators, vertex + D.T @ p, np.zeros(0), np.zeros(0), D @ vertex)
    d = program.feasible(vertex + 1e-9 * rng.normal(size=2))
    assert np.isfinite(program.objective(d))
    assert np.linalg.norm(d - vertex) < 4 * 5e-9 / np.sin(angle)
    assert program.certify(d, p=p).gap < p.sum() * 4 * 5e-9 / np.sin(angle)


def test_of_equal_multipliers_those_cost_nothing_that_belong_to_what_touches():
    """min 1/2 d^2 - 2 d under d <= 1 and d <= 3: p = 1, all of it of the bound that is met."""
    operators = Operators(np.eye(1), sp.csr_matrix((0, 1)), D=sp.csr_matrix(np.ones((2, 1))))
    program = StepProgram(operators, np.array([2.0]), np.zeros(0), np.zeros(0), np.array([1.0, 3.0]))
    _, p = program.multipliers(np.ones(1))
    # The other bound takes the part level / (level + z) of it, with level = 1e-6 z.
    assert p == pytest.approx([1.0, 0.0], abs=2e-6)
    assert program.certify([1.0]).gap <= 2 * 2e-6


def test_on_a_kernel_the_multipliers_read_off_are_in_balance():
    """Two free points, held by friction: lam sums to the load, and the seminorm's certificate is finite."""
    K, kernel = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.full((2, 1), 0.5**0.5)
    operators = Operators(K, sp.eye_array(2, format="csr"), kernel=kernel, anchor=np.array([0.25, 0.0]))
    program = StepProgram(operators, np.array([1.5, 0.1]), np.ones(2), np.zeros(2))
    lam, _ = program.multipliers(np.array([0.4, 0.0]))
    assert lam.sum() == pytest.approx(1.6, abs=8 * EPS)
    # K d = g - lam for d = (x, 0) with lam = (1, 0.6): x = 0.5.
    assert program.certify([0.5, 0.0]).gap <= 1e-14
    assert 0.01 / 2 <= program.certify([0.4, 0.0]).gap < np.inf


@pytest.mark.parametrize("block", [1, 2])
@pytest.mark.parametrize("cones", [None, True])
def test_cvxpy_answers_with_our_signs(block, cones):
    program = random_program(7, block=block)
    posed = program.to_cvxpy(cones)
    assert posed.lam is None
    posed.problem.solve(solver="CLARABEL", tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
    d, lam = solution(program)
    assert posed.problem.value == pytest.approx(program.objective(d), abs=1e-8)
    # Interior points end at gaps near 1e-10: errors of its root in d, and in K d = g - B'lam.
    assert np.abs(posed.d.value - d).max() < 1e-4
    assert np.abs(posed.lam - lam).max() < 1e-4
    assert posed.p.shape == (0,)
    assert program.certify(posed.d.value, posed.lam, posed.p).gap < 1e-9


def test_cvxpy_answers_with_limits():
    for soft in (False, True):
        program = with_limits(5, own=False, soft=soft)
        posed, exact = program.to_cvxpy(), answered(program)
        posed.problem.solve(solver="CLARABEL", tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10)
        assert np.abs(posed.p - exact.p).max() < 1e-4 < exact.p.max()
        # Asked was 1e-10 of the objective.
        gap = program.certify(program.feasible(posed.d.value), posed.lam, posed.p).gap
        assert gap < 1e-9 * (1 + abs(program.objective(exact.d)))


def test_a_system_has_programs():
    """A slider under t: the programs of its steps, each with its answer, which another solver may find as well."""
    kernel = vx.Kernel([[1.0], [1.0]], ["sliding"])
    system = vx.System([[1.0, -1.0], [-1.0, 1.0]], lambda t: [t, 0.0], vx.Norms(np.eye(2), 0.5), kernel=kernel)
    programs = list(vx.programs_of_march(system, [0.0, 0.6, 0.9]))
    assert [program.step for program in programs] == [1, 2]
    for program, held in zip(programs, [0.1, 0.4], strict=True):
        assert program.answer.lam.ravel() == pytest.approx([0.5, held], abs=1e-12)
        posed = program.to_cvxpy()
        posed.problem.solve(solver="CLARABEL")
        assert program.certify(posed.d.value, posed.lam, posed.p).error < 1e-3


def test_what_is_no_answer_is_refused():
    program = with_limits(0, own=True)
    wrong = (
        ({"d": np.zeros(3)}, "certify: d: found an array of shape (3,); wanted numbers of shape (10,)."),
        ({"d": np.zeros(10), "lam": np.zeros(4)}, "certify: lam: found an array of shape (4,)"),
        ({"d": np.zeros(10), "p": "high"}, "certify: p: found 'high', which does not read"),
    )
    for given, words in wrong:
        with pytest.raises(vx.SceneError, match=re.escape(words)):
            program.certify(**given)


def beside(w, b=1.0):
    """Minimise |d|^2 / 2 + w |d_1 + d_2 - b|: 1/4 at d = (1/2, 1/2) for b = 1 and any w >= 1/2."""
    return StepProgram(Operators(np.eye(2), sp.csr_matrix([[1.0, 1.0]])), np.zeros(2), np.array([w]), np.array([b]))


@pytest.mark.parametrize("w", [1.0, 1e6, 1e10])
def test_bounds_hold_where_what_sticks_was_put_in_place(w):
    """A slip of 2e-14 costs w times that; the certificate is of the place after it, and no difference of objectives."""
    answer = Answer(np.array([0.5 + 2e-14, 0.5]), np.array([[-0.5]]), 0)
    low, high = SolvedProgram.of(beside(w), answer, 1, 1.0).bounds
    assert low <= 0.25 <= high


@pytest.mark.parametrize(("w", "b"), [([1.0, 1.0], [1.0]), ([1.0], [1.0, 0.0]), ([[1.0]], [1.0])])
def test_a_program_has_the_shapes_of_its_operators(w, b):
    operators = Operators(np.eye(2), sp.csr_matrix([[1.0, 1.0]]))
    with pytest.raises(vx.SceneError, match=r"StepProgram: [wb]: found .*; wanted \(1,\)"):
        StepProgram(operators, np.zeros(2), np.array(w), np.array(b))


@pytest.mark.parametrize("w", [-1.0, np.nan])
def test_a_weight_that_pays_for_slip_is_not_certified(w):
    with pytest.raises(vx.SceneError, match=f"certify: found the weight {w:g} of term 0; weights are >= 0"):
        beside(w).certify(np.array([0.5, 0.5]))
