"""Programs that users make: matrices as they come, limits that are none, certificates without multipliers."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp

import vemcvx as vx
from vemcvx.program import Operators, StepProgram

pytestmark = pytest.mark.arithmetic
SOLVERS = pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel(), vx.OSQP()], ids=lambda s: s.name)


def test_a_bound_and_friction_on_one_unknown_are_certified_without_multipliers():
    """d'd/2 - 2 d + |d|/2 with d <= .4: at d = .4 friction takes 1/2 and the bound 1.1."""
    one = sp.csr_matrix([[1.0]])
    program = StepProgram(Operators(np.eye(1), one, D=one), [2.0], [0.5], [0.0], [0.4])
    lam, p = program.multipliers(np.array([0.4]))
    assert lam[0, 0] == 0.5
    assert p == pytest.approx([1.1], rel=1e-15)
    assert program.certify([0.4]).error < 1e-15
    # At d = .3 the error is .1, and the bound takes no force.
    assert 0.1 <= program.certify([0.3]).error < 0.6


@pytest.mark.parametrize("soft", [0.0, 0.2])
def test_soft_thresholding_in_a_box(soft):
    """Six unknowns, each |g| - w beyond the threshold, cut at the box, or (c (|g| - w) + e)/(1 + c) if that gives."""
    rng = np.random.default_rng(3)
    eye = np.eye(6)
    operators = Operators(eye, eye, D=np.vstack([eye, -eye]), compliance=np.full(12, soft))
    for _ in range(100):
        g, w, e = 2 * rng.normal(size=6), rng.uniform(0.1, 1.0, 6), rng.uniform(0.1, 1.0, 6)
        free = np.maximum(np.abs(g) - w, 0.0)
        inside = np.minimum(free, e) if soft == 0 else np.where(free > e, (free * soft + e) / (1 + soft), free)
        program = StepProgram(operators, g, w, np.zeros(6), np.append(e, e))
        certificate = program.certify(np.sign(g) * inside)
        assert certificate.error <= 1e-15 + certificate.error_floor


def exact_program(seed, block):
    """A program whose answer is known by construction, in numbers of few bits, with gaps and weights of all sizes."""
    rng = np.random.default_rng(seed)
    n, m, r = 8, 3, 2
    root = rng.integers(-3, 4, (n, n)).astype(float)
    K = root @ root.T + np.diag(2.0 ** rng.integers(-6, 3, n))
    B, D = rng.integers(-2, 3, (m * block, n)).astype(float), rng.integers(-2, 3, (r, n)).astype(float)
    d = rng.integers(-64, 65, n) / 64
    # Slips s = B d - b along (3, 4)/5 in two components: lam = w s/|s| is a number of few bits, too.
    way = (
        np.array([[3.0, 4.0], [-4.0, 3.0], [3.0, -4.0]])[:, :block] if block == 2 else np.array([[1.0], [-1.0], [1.0]])
    )
    kind, w = rng.integers(0, 3, m), 5.0 * rng.integers(1, 8, m)
    size = 5.0 if block == 2 else 1.0
    lam = (w / size)[:, None] * way * np.where(kind == 1, 0.5, 1.0)[:, None]
    s = np.where((kind == 0)[:, None], way * 2.0 ** rng.integers(-6, 1, m)[:, None], 0.0)
    p, c = rng.integers(0, 5, r) / 4.0, np.array([0.0, 0.25])
    z = np.where(p > 0, c * p, -rng.integers(0, 3, r) / 4.0)
    operators = Operators(K, B, block, D=D, compliance=c)
    g = K @ d + B.T @ lam.ravel() + D.T @ p
    # All sums are exact: their terms are multiples of 2^-24 below 2^20.
    assert all(Fraction(x).denominator <= 2**24 and abs(x) < 2**20 for x in g.tolist())
    return StepProgram(operators, g, w, B @ d - s.ravel(), D @ d - z), d, lam, p


def distance(K, one, two):
    """|one - two|_K in rational numbers, but for the last root."""
    away = [Fraction(a) - Fraction(b) for a, b in zip(one.tolist(), two.tolist(), strict=True)]
    square = sum(
        x * Fraction(k) * y for x, row in zip(away, K.tolist(), strict=True) for k, y in zip(row, away, strict=True)
    )
    return float(square) ** 0.5


@pytest.mark.parametrize("block", [1, 2])
def test_error_and_floor_are_never_exceeded(block):
    """By Newton's answers and by perturbed ones; but for slips below 1e-9 of the motions, which count as none."""
    for seed in range(40):
        program, exact, lam, p = exact_program(seed, block)
        K, size = program.operators.K, program.operators.energy_norm(exact)
        own = program.certify(exact, lam, p)
        assert own.error <= 1e-13 * size
        answer = vx.Newton().prepare(program.operators).solve(program, 1e-30, np.zeros_like(lam), np.zeros_like(p))
        assert distance(K, answer.d, exact) <= 1e-10 * size
        rng, found = np.random.default_rng(seed), [(answer.d, answer.lam, answer.p)]
        for off in (1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-3):
            d = program.feasible(exact + off * rng.normal(size=len(exact)))
            found += [(d, lam, p), (d, lam * (1 + off), p + off), (d, None, None)]
        for d, *multipliers in found:
            certificate, away = program.certify(d, *multipliers), distance(K, d, exact)
            unseen = 1e-9 * size if away <= 1e-8 * size else 0.0
            assert away <= (certificate.error + certificate.error_floor) * (1 + 1e-9) + unseen


@SOLVERS
@pytest.mark.parametrize("far", [1e8, 1e20, np.inf])
@pytest.mark.parametrize("compliance", [0.0, 0.1])
def test_a_limit_that_is_far_is_none(solver, far, compliance):
    """The same as with one limit; its force is none."""
    rng = np.random.default_rng(0)
    A, f, eye = rng.normal(size=(4, 4)), 5 * rng.normal(size=4), np.eye(4)

    def run(rows, e, solver):
        terms = {"norms": vx.Norms(eye[:2], 0.3), "limits": vx.Limits(rows, e, compliance)}
        return vx.march(vx.System(A @ A.T + eye, lambda t: t * f, **terms), [0.0, 0.5, 1.0], solver=solver)

    one, two = run(eye[2:3], [0.05], vx.Newton()), run(eye[2:], [0.05, far], solver)
    assert np.abs(one.state - two.state).max() < 1e-6
    assert one.pressures[-1, 0] > 0
    assert two.pressures[:, 0] == pytest.approx(one.pressures[:, 0], abs=1e-5)
    assert two.pressures[:, 1].max() < 1e-12


def test_minus_infinity_is_no_gap():
    for wrong in (-np.inf, np.nan):
        with pytest.raises(vx.SceneError, match="^Limits: e: found NaN or infinite"):
            vx.Limits(np.eye(2), [1.0, wrong])


def test_operators_take_matrices_as_they_come():
    """Lists, dense and sparse ones are one program: min 1/2 (2 x^2 + 3 y^2) - 3 x - 5 y + |x| with y <= 1/2."""
    for K in ([[2, 0], [0, 3]], np.diag([2.0, 3.0]), np.diag([2, 3]), sp.csc_array(np.diag([2.0, 3.0]))):
        for kind in (list, np.array, sp.csr_matrix, sp.csc_array):
            operators = Operators(K, kind([[1.0, 0.0]]), D=kind([[0.0, 1.0]]))
            program = StepProgram(operators, [3.0, 5.0], [1.0], [0.0], [0.5])
            assert program.certify([1.0, 0.5], [1.0], [3.5]).error < 1e-15


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"K": [[2.0, 1.0], [0.0, 3.0]]}, r"K: found a row \d that is not column \d; it must be symmetric"),
        ({"K": np.ones((2, 3))}, r"K: found a matrix of shape \(2, 3\); it must be square"),
        ({"K": np.ones(2)}, r"K: found an array of shape \(2,\); wanted a matrix"),
        ({"K": "stiff"}, "K: found 'stiff', which does not read"),
        ({"K": [[np.nan, 0.0], [0.0, 1.0]]}, "K: found NaN"),
        ({"B": [1.0, 0.0]}, r"B: found an array of shape \(2,\); wanted a matrix"),
        ({"B": np.ones((1, 3))}, "B: found 3 columns; K has 2 unknowns"),
        ({"D": [["far", 0.0]]}, "D: found .*which does not read"),
        ({"block": 2}, "found B with 1 rows and block = 2"),
        ({"D": np.eye(2), "compliance": np.ones(3)}, r"compliance: found an array of shape \(3,\); wanted \(2,\)"),
        ({"D": np.eye(2), "compliance": -np.ones(2)}, "found the compliance -1; it must be >= 0"),
    ],
)
def test_operators_that_are_none(given, words):
    with pytest.raises(vx.SceneError, match=rf"^Operators: {words}"):
        Operators(**{"K": np.eye(2), "B": [[1.0, 0.0]], **given})


@pytest.mark.parametrize("name", ["d", "lam", "p"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_what_is_no_number_is_not_certified(name, wrong):
    program = StepProgram(Operators(np.eye(1), [[1.0]], D=[[1.0]]), [2.0], [0.5], [0.0], [0.4])
    with pytest.raises(vx.SceneError, match=rf"^certify: {name}: found NaN or infinite"):
        program.certify(**{"d": [0.4], "lam": [0.5], "p": [1.1], name: [wrong]})
