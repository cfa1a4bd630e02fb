"""Programs of steps: certificates, multipliers, cvxpy, and accepted matrices."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import mostly_long

import vemcvx as vx
from vemcvx.program import Answer, Certificate, Operators, SolvedProgram, StepProgram

pytestmark = pytest.mark.arithmetic
EPS = float(np.finfo(float).eps)
separate = pytest.mark.parametrize("separate", [False, True])
SHARP = {"solver": "CLARABEL", "tol_gap_abs": 1e-10, "tol_gap_rel": 1e-10, "tol_feas": 1e-10}


def draw_program(seed, block=1, separate=False):
    """Return a random program. If `separate`, no two rows share an unknown."""
    rng = np.random.default_rng(seed)
    n, m, r = 14, 3, 4
    A = rng.normal(size=(n, n))
    if separate:
        free, odd = rng.permutation(n), [-1, 0.5, 2]
        columns, mine = free[: m * block], free[m * block : m * block + r]
        B = sp.csr_matrix((rng.choice(odd, m * block), (np.arange(m * block), columns)), (m * block, n))
        D = sp.csr_matrix((rng.choice(odd, r), (np.arange(r), mine)), (r, n))
    else:
        B, D = sp.csr_matrix(rng.normal(size=(m * block, n))), sp.csr_matrix(rng.normal(size=(r, n)))
    compliance = np.where(np.arange(r) == 2, 0.1 + rng.random(), 0.0)
    operators = Operators(A @ A.T + np.eye(n), B, block, D=D, compliance=compliance)
    data = 5 * rng.normal(size=n), 3 * rng.random(m), 0.1 * rng.normal(size=m * block), 0.2 * rng.random(r)
    return StepProgram(operators, *data)


def solve_with_newton(program):
    """Return Newton's answer and the certificate."""
    none = np.zeros((program.operators.count, program.operators.block))
    prepared = vx.Newton(max_iterations=2000).prepare(program.operators)
    answer = prepared.solve(program, 1e-30, none, np.zeros(len(program.e)))
    certificate = program.certify(answer.d, answer.lam, answer.p)
    assert certificate.gap <= 1e-20 + certificate.floor
    return answer, certificate


@separate
@mostly_long("block", [1, 2, 3], 1)
def test_the_gap_bounds_the_error(block, separate):
    """1/2 |d - d*|_K^2 <= gap <= primal minus dual for every feasible d."""
    rng = np.random.default_rng(5)
    for seed in range(3):
        program = draw_program(seed, block, separate)
        best, own = solve_with_newton(program)
        K, computed = program.operators.K, []
        for size in (1e-6, 1e-3, 1.0):
            d = program.feasible(best.d + size * rng.normal(size=best.d.shape))
            lam = program.project(best.lam + size * rng.normal(size=best.lam.shape))
            p = np.maximum(best.p + size * rng.normal(size=best.p.shape), 0.0)
            certificate, apart = program.certify(d, lam, p), d - best.d
            computed.append(program.certify(d))
            assert min(certificate.friction.min(), certificate.limits.min(), certificate.equilibrium) >= 0
            error = 0.5 * apart @ (K @ apart)
            assert error <= certificate.gap * (1 + 1e-9) + own.gap + certificate.floor
            assert error <= computed[-1].gap + computed[-1].floor
            v = np.linalg.solve(K, program.g - program.operators.multiplier_force(lam, p))
            dual = -0.5 * v @ K @ v - lam.ravel() @ program.b - p @ program.e
            dual -= 0.5 * p @ (program.operators.compliance * p)
            # By theorem 2 of `vemcvx.program.certificate`, the gap may be less than primal minus dual.
            plain = pytest.approx(program.objective(d) - dual, rel=1e-9, abs=1e-12)
            assert certificate.gap == plain or (certificate.moved > 0 and certificate.gap < plain.expected)
        assert not separate or max(one.gap for one in computed[:2]) < 1e-3 * computed[2].gap


def test_infeasible_increments_are_not_certified():
    program = draw_program(1)
    feasible = program.feasible(np.ones(14))
    assert np.isfinite(program.certify(feasible, np.zeros((3, 1)), np.zeros(4)).gap)
    beyond = feasible + 10 * np.linalg.pinv(program.operators.D.toarray())[:, 0]
    assert program.certify(beyond, np.zeros((3, 1)), np.zeros(4)).gap == np.inf
    assert program.objective(beyond) == np.inf


@separate
@mostly_long("seed", range(4), 0, 1)
def test_multipliers_are_computed_from_an_increment(seed, separate):
    """The rows of B and D are independent, so that only one pair (lam, p) satisfies K d = g - B'lam - D'p."""
    program = draw_program(seed, separate=separate)
    operators, (answer, _) = program.operators, solve_with_newton(program)
    rows = np.vstack([operators.B.toarray(), operators.D.toarray()])
    spread = np.linalg.norm(np.linalg.pinv(rows.T), 2) * np.linalg.cond(operators.K)
    for given in ({}, {"lam": answer.lam}, {"p": answer.p}):
        lam, p = program.multipliers(answer.d, **given)
        assert np.abs(lam - answer.lam).max() < 1e3 * EPS * spread
        assert np.abs(p - answer.p).max() < 1e3 * EPS * spread
        assert program.certify(answer.d, **given).gap < 1e3 * EPS * spread


def test_multipliers_parallel_to_slips_have_a_gap_of_squared_rounding():
    """If the angle between lam and s is a, the gap is about w|s| a^2 / 2."""
    rng = np.random.default_rng(0)
    n = 200
    w, s = rng.uniform(0.5, 2.0, n), rng.normal(size=(n, 2))
    lam = w[:, None] * s / np.linalg.norm(s, axis=1)[:, None]
    operators = Operators(np.eye(2 * n), np.eye(2 * n), 2)
    program = StepProgram(operators, (s + lam).ravel(), w, np.zeros(2 * n))
    assert (np.linalg.norm(program.project(lam), axis=1) < w).any()
    certificate = program.certify(s.ravel(), lam)
    # Gap and floor are sums of 2 n squared rounding errors.
    assert certificate.gap <= certificate.floor <= 2 * n * (8 * EPS) ** 2 * 16
    angle = 1e-9
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    lost = np.linalg.norm(s, axis=1) * w * angle**2 / 2
    assert program.certify(s.ravel(), lam @ turn.T).friction == pytest.approx(lost, rel=1e-3)


@pytest.mark.parametrize("soft", [0.0, 0.2])
def test_soft_thresholding_in_a_box_is_certified(soft):
    """|d| = |g| - w in the box |d| <= e. Beyond the box, |d| is e, or (c (|g| - w) + e)/(1 + c) with compliance c."""
    rng = np.random.default_rng(3)
    eye = np.eye(6)
    operators = Operators(eye, eye, D=np.vstack([eye, -eye]), compliance=np.full(12, soft))
    for _ in range(30):
        g, w, e = 2 * rng.normal(size=6), rng.uniform(0.1, 1.0, 6), rng.uniform(0.1, 1.0, 6)
        free = np.maximum(np.abs(g) - w, 0.0)
        inside = np.minimum(free, e) if soft == 0 else np.where(free > e, (free * soft + e) / (1 + soft), free)
        certificate = StepProgram(operators, g, w, np.zeros(6), np.append(e, e)).certify(np.sign(g) * inside)
        assert certificate.error <= 1e-15 + certificate.error_floor


def make_exact_program(seed, block):
    """Return a program and the exact answer. All numbers have few bits."""
    rng = np.random.default_rng(seed)
    n, m, r = 8, 3, 2
    root = rng.integers(-3, 4, (n, n)).astype(float)
    K = root @ root.T + np.diag(2.0 ** rng.integers(-6, 3, n))
    B, D = rng.integers(-2, 3, (m * block, n)).astype(float), rng.integers(-2, 3, (r, n)).astype(float)
    d = rng.integers(-64, 65, n) / 64
    # For slips s along (3, 4) / 5, the forces w s / |s| have few bits.
    way = np.array([[3.0, 4.0], [-4.0, 3.0], [3.0, -4.0]]) if block == 2 else np.array([[1.0], [-1.0], [1.0]])
    kind, w = rng.integers(0, 3, m), 5.0 * rng.integers(1, 8, m)
    size = 5.0 if block == 2 else 1.0
    lam = (w / size)[:, None] * way * np.where(kind == 1, 0.5, 1.0)[:, None]
    s = np.where((kind == 0)[:, None], way * 2.0 ** rng.integers(-6, 1, m)[:, None], 0.0)
    p, c = rng.integers(0, 5, r) / 4.0, np.array([0.0, 0.25])
    z = np.where(p > 0, c * p, -rng.integers(0, 3, r) / 4.0)
    operators = Operators(K, B, block, D=D, compliance=c)
    g = K @ d + B.T @ lam.ravel() + D.T @ p
    # Sums of multiples of 2^-24 below 2^20 are exact.
    assert all(Fraction(x).denominator <= 2**24 and abs(x) < 2**20 for x in g.tolist())
    return StepProgram(operators, g, w, B @ d - s.ravel(), D @ d - z), d, lam, p


def compute_distance(K, one, two):
    """Return |one - two|_K, computed with whole numbers."""
    apart = [int((Fraction(a) - Fraction(b)) * 2**100) for a, b in zip(one.tolist(), two.tolist(), strict=True)]
    rows = (64 * K).astype(int).tolist()
    square = sum(x * k * y for x, row in zip(apart, rows, strict=True) for k, y in zip(row, apart, strict=True))
    return float(Fraction(square, 2**206)) ** 0.5


@mostly_long("seeds", [range(2), range(2, 40)], ids=["2", "38 more"])
@pytest.mark.parametrize("block", [1, 2])
def test_certificate_and_floor_bound_the_error(block, seeds):
    """Newton's answer and perturbed exact answers are tested."""
    for seed in seeds:
        program, exact, lam, p = make_exact_program(seed, block)
        K, size = program.operators.K, program.operators.energy_norm(exact)
        own = program.certify(exact, lam, p)
        assert own.error <= 1e-13 * size
        answer = vx.Newton().prepare(program.operators).solve(program, 1e-30, np.zeros_like(lam), np.zeros_like(p))
        assert compute_distance(K, answer.d, exact) <= 1e-10 * size
        rng, found = np.random.default_rng(seed), [(answer.d, answer.lam, answer.p)]
        for off in (1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-3):
            d = program.feasible(exact + off * rng.normal(size=len(exact)))
            found += [(d, lam, p), (d, lam * (1 + off), p + off), (d, None, None)]
        for d, *multipliers in found:
            certificate, error = program.certify(d, *multipliers), compute_distance(K, d, exact)
            ignored = 1e-9 * size if error <= 1e-8 * size else 0.0
            assert error <= (certificate.error + certificate.error_floor) * (1 + 1e-9) + ignored


def test_computed_multipliers_balance_the_load_on_a_kernel():
    """Friction holds two free points. The sum of `lam` is the sum of the load."""
    K, kernel = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.full((2, 1), 0.5**0.5)
    operators = Operators(K, sp.eye_array(2, format="csr"), kernel=kernel)
    program = StepProgram(operators, np.array([1.5, 0.1]), np.ones(2), np.zeros(2))
    lam, _ = program.multipliers(np.array([0.4, 0.0]))
    assert lam.sum() == pytest.approx(1.6, abs=8 * EPS)
    # The solution is d = (0.5, 0) with lam = (1, 0.6).
    assert program.certify([0.5, 0.0]).gap <= 1e-14
    assert 0.01 / 2 <= program.certify([0.4, 0.0]).gap < np.inf


@pytest.mark.parametrize("block", [1, 2])
def test_cvxpy_gives_the_same_increments_and_multipliers(block):
    program = draw_program(7, block=block)
    posed, (exact, _) = program.to_cvxpy(), solve_with_newton(program)
    assert posed.lam is None
    posed.problem.solve(**SHARP)
    assert posed.problem.value == pytest.approx(program.objective(exact.d), rel=1e-8)
    # The gap is near 1e-10, so errors of d and of multipliers are near 1e-5.
    for found, wanted in ((posed.d.value, exact.d), (posed.lam, exact.lam), (posed.p, exact.p)):
        assert np.abs(found - wanted).max() < 1e-4 < np.abs(wanted).max()
    gap = program.certify(program.feasible(posed.d.value), posed.lam, posed.p).gap
    assert gap < 1e-9 * (1 + abs(program.objective(exact.d)))


@pytest.mark.parametrize("w", [1.0, 1e6, 1e10])
def test_bounds_of_the_minimum_hold_if_a_sticking_term_slips_by_rounding(w):
    """|d|^2 / 2 + w |d_1 + d_2 - 1| is 1/4 at d = (1/2, 1/2). A slip of 2e-14 has the friction work 2e-14 w."""
    program = StepProgram(Operators(np.eye(2), [[1.0, 1.0]]), np.zeros(2), np.array([w]), np.array([1.0]))
    answer = Answer(np.array([0.5 + 2e-14, 0.5]), np.array([[-0.5]]), 0)
    low, high = SolvedProgram(program.operators, *program.data, answer=answer, step=1, t=1.0).bounds
    assert low <= 0.25 <= high


def test_operators_accept_lists_dense_and_sparse_matrices():
    """Minimise 1/2 (2 x^2 + 3 y^2) - 3 x - 5 y + |x| with y <= 1/2."""
    for K in ([[2, 0], [0, 3]], np.diag([2, 3]), sp.csc_array(np.diag([2.0, 3.0]))):
        for kind in (list, np.array, sp.csr_matrix, sp.csc_array):
            operators = Operators(K, kind([[1.0, 0.0]]), D=kind([[0.0, 1.0]]))
            program = StepProgram(operators, [3.0, 5.0], [1.0], [0.0], [0.5])
            assert program.certify([1.0, 0.5], [1.0], [3.5]).error < 1e-15


def test_a_gap_that_is_no_number_certifies_nothing():
    none = np.zeros(0)
    assert Certificate(np.nan, none, 0.0, none).gap == np.inf
    assert Certificate(-1.0, none, 0.0, none).error == np.inf
    assert Certificate(0.0, np.array([np.nan]), 0.0, none).error == np.inf
