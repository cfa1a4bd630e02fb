"""Newton's method for friction forces in discs."""

import numpy as np
import pytest
import scipy.sparse as sp
from blocks_in_space import pose_block_on_floor
from scenes import mostly_long

import vemcvx as vx
from vemcvx.program import Operators, StepProgram
from vemcvx.solvers.default import RunSolver

pytestmark = pytest.mark.arithmetic

TIMES = np.linspace(0.0, 1.0, 9)


def rotating(t):
    angle, pull = 2 * np.pi * t, 0.5 * min(1.0, 4 * t)
    return np.array([pull * np.cos(angle), pull * np.sin(angle), -0.2 * pull])


def pressed(t):
    return rotating(t) - [0.0, 0.0, 0.6 * min(1.0, 4 * t)]


def to_and_fro(t):
    return np.array([0.7, 0.3, -0.1]) * np.sin(6 * t)


SYSTEMS = {
    "bilateral, to and fro": (to_and_fro, {"bound": 0.2}),
    "one-sided, rotating": (pressed, {"bound": 0.1, "is_bilateral": False}),
    "Coulomb, rotating": (pressed, {"coefficient": 0.3, "is_bilateral": False}),
}


def make_system(name, n=3, **options):
    pull, given = SYSTEMS[name]
    return pose_block_on_floor(n, pull, **{**given, **options})


KINDS = ("plain", "stiff", "weights", "none", "limits", "all", "rows", "edge", "stiff edge")


def draw_program(seed, kind):
    """Return a random program.

    "stiff": eigenvalues of K span seven decades. "weights": weights span fourteen decades. "none": a third
    of the weights are zero. "limits": half of the limits are rigid, half compliant. "rows": rows of B share unknowns.
    "edge": slips are 1e-14 to 1e-3, or zero with |lam_i| close to w_i.
    """
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    m = int(rng.integers(1, 14))
    r = int(rng.integers(0, m + 1)) if kind in ("limits", "all") else 0
    n = 2 * m + r + int(rng.integers(0, 6))
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    K = Q @ np.diag(10.0 ** rng.uniform(-6 if kind in ("stiff", "all", "stiff edge") else -2, 1, n)) @ Q.T
    B = sp.csr_matrix(np.eye(n)[: 2 * m])
    if kind == "rows":
        B = sp.csr_matrix(rng.normal(size=(2 * m, n)) * (rng.random((2 * m, n)) < 0.5))
    compliance = np.where(rng.random(r) < 0.5, 0.0, 10.0 ** rng.uniform(-3, 1, r))
    operators = Operators(0.5 * (K + K.T), B, 2, D=sp.csr_matrix(np.eye(n)[2 * m : 2 * m + r]), compliance=compliance)
    w = 10.0 ** (rng.uniform(-8, 6, m) if kind in ("weights", "all") else rng.uniform(-1, 1, m))
    w[rng.random(m) < (0.3 if kind in ("none", "all") else 0.0)] = 0.0
    e = np.abs(rng.normal(size=r)) * (rng.random(r) < 0.7)
    if "edge" not in kind:
        b = rng.normal(size=2 * m) * (rng.random(2 * m) < 0.3)
        return StepProgram(operators, K @ rng.normal(size=n) + rng.normal(size=n), w, b, e)
    direction = rng.normal(size=(m, 2))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    d = 1e-3 * rng.normal(size=n)
    d[: 2 * m] = (direction * (10.0 ** rng.uniform(-14, -3, m) * (rng.random(m) < 0.8))[:, None]).ravel()
    share = np.where(rng.random(m) < 0.8, 1.0, 1 - 1e-6)
    return StepProgram(operators, K @ d + B.T @ (share * w * direction.T).T.ravel(), w, np.zeros(2 * m), e)


def is_solved(program, accuracy=1e-8):
    """Return True if Newton or Clarabel reaches the accuracy or the rounding floor."""
    target = 0.5 * accuracy**2 * abs(program.g @ program.operators.factor.solve(program.g))
    newton = RunSolver.prepare(vx.Newton(max_iterations=2000), program.operators)
    for solve in (newton.solve, newton.retry):
        answer = solve(program, target, np.zeros((len(program.w), 2)))
        certificate = program.certify(program.feasible(answer.d), answer.lam, answer.p)
        if certificate.gap <= max(target, certificate.floor):
            return True
    return False


@pytest.mark.parametrize("count", [5, pytest.param(400, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_random_programs_are_solved(kind, count):
    """The error is at most 1e-8 of the load's energy norm, and 1e-7 for the kinds with "edge"."""
    accuracy = 1e-7 if "edge" in kind else 1e-8
    assert [seed for seed in range(count) if not is_solved(draw_program(seed, kind), accuracy)] == []


def test_osqp_refuses_discs():
    with pytest.raises(vx.NotAccepted, match=r"^solver OSQP: the program has second-order cones"):
        vx.march(make_system("bilateral, to and fro", 2), [0.0, 0.2], solver=vx.OSQP())


@mostly_long("coefficient", [0.1, 0.6, 1.5], 1)
def test_newton_solves_coulombs_law_on_discs(coefficient):
    """Friction reaches the bound at slipping nodes."""
    history = vx.march(make_system("Coulomb, rotating", 4, coefficient=coefficient), TIMES)
    assert history.certificate_kind == "for the given friction"
    assert history.iterations.max() <= 20
    size = np.linalg.norm(history.multipliers, axis=2)
    assert (size <= coefficient * history.pressures * (1 + 1e-12)).all()
    slips = ~history.sticking[1:] & (history.pressures[1:] > 0)
    assert slips.any()
    assert size[1:][slips] == pytest.approx(coefficient * history.pressures[1:][slips], rel=1e-10)
