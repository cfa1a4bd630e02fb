"""Newton on discs: right where slips are tiny, turn, or are none at all."""

import numpy as np
import pytest
import scipy.sparse as sp
from blocks_in_space import block, on_floor
from scenes import mostly_long

import vemcvx as vx
from vemcvx.program import Operators, StepProgram
from vemcvx.solvers.default import LastResort

pytestmark = pytest.mark.arithmetic

TIMES = np.linspace(0.0, 1.0, 9)


def turning(t):
    angle, pull = 2 * np.pi * t, 0.5 * min(1.0, 4 * t)
    return np.array([pull * np.cos(angle), pull * np.sin(angle), -0.2 * pull])


def pressed(t):
    return turning(t) - [0.0, 0.0, 0.6 * min(1.0, 4 * t)]


def to_and_fro(t):
    return np.array([0.7, 0.3, -0.1]) * np.sin(6 * t)


SCENES = {
    "bilateral, turning": (turning, {"bound": 0.2}),
    "bilateral, to and fro": (to_and_fro, {"bound": 0.2}),
    "one-sided, turning": (pressed, {"bound": 0.1, "contact": "unilateral"}),
    "Coulomb, turning": (pressed, {"coefficient": 0.3, "contact": "unilateral"}),
}


def scene(name, n=4, **more):
    pull, given = SCENES[name]
    return on_floor(block(n), pull, **given, **more)


def test_nothing_depends_on_the_frames():
    """Turned by an angle of its own at every node: the same displacements, and forces turned with them."""
    plain = vx.march(scene("one-sided, turning"), TIMES)
    angles = np.random.default_rng(0).uniform(0, 2 * np.pi, plain.multipliers.shape[1])
    turned = vx.march(scene("one-sided, turning", frames=angles), TIMES)
    assert np.abs(turned.state - plain.state).max() <= 1e-10 * np.abs(plain.state).max()
    c, s = np.cos(angles), np.sin(angles)
    back = np.stack([[c, -s], [s, c]]).transpose(2, 0, 1)
    forces = np.einsum("mij,tmj->tmi", back, turned.multipliers)
    assert np.abs(forces - plain.multipliers).max() <= 1e-9 * np.abs(plain.multipliers).max()
    assert np.array_equal(turned.sticking, plain.sticking)


KINDS = ("plain", "stiff", "weights", "none", "limits", "all", "rows", "edge", "stiff edge")


def program(seed, kind):
    """A random program.

    "stiff": eigenvalues over seven orders; "weights" over fourteen; "none": a third of them zero; "limits": half of
    them bounds, half soft; "rows": of B that share unknowns; "edge": slips of 1e-3 to 1e-14, or none, whose
    multipliers are on their bounds, and so near to where no direction is defined.
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


def answered(asked, accuracy=1e-8):
    """Newton's answer, in a run with Clarabel behind it, and whether it is within the accuracy, or its rounding."""
    target = 0.5 * accuracy**2 * abs(asked.g @ asked.operators.factor.solve(asked.g))
    newton = LastResort(vx.Newton(max_iterations=2000).prepare(asked.operators))
    for solve in (newton.solve, newton.retry):
        answer = solve(asked, target, np.zeros((len(asked.w), 2)))
        certificate = asked.certify(asked.feasible(answer.d), answer.lam, answer.p)
        if certificate.gap <= max(target, certificate.floor):
            return answer, True
    return answer, False


def wrong(kind, count):
    """The seeds whose answers miss 1e-8; 1e-7 of the load's energy where slips are 1e-14 to 1e-3 of the motions."""
    accuracy = 1e-7 if "edge" in kind else 1e-8
    return [seed for seed in range(count) if not answered(program(seed, kind), accuracy)[1]]


@pytest.mark.parametrize("kind", KINDS)
def test_random_programs(kind):
    assert wrong(kind, 5) == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_thousands_of_random_programs(kind):
    assert wrong(kind, 400) == []


@mostly_long("polygon", [4, 16, 64], 1)
def test_osqp_takes_polygons_and_says_what_they_miss(polygon):
    """The gap of the true program is at most 1 - cos(pi / P) of what slips lose, and that is the certificate."""
    system, between = scene("bilateral, to and fro", 3), [0.0, 0.2]
    exact = vx.march(system, between)
    found = vx.march(system, between, solver=vx.OSQP(polygon=polygon), check=False)
    apart = found.state[1] - exact.state[1]
    assert np.sqrt(apart @ (system.K @ apart)) <= np.sqrt(2 * found.gap[1]) + np.sqrt(2 * exact.gap[1])
    missed = (1 - np.cos(np.pi / polygon)) * float(found.weights[-1] @ found.slipped[-1])
    assert 0.01 * missed < found.gap[1] <= missed * (1 + 1e-6) + 1e-12 * exact.norm[1] ** 2
    with pytest.raises(vx.NotCertified, match=r"OSQP reached .* but 1\.0e-06 was requested.*raise polygon"):
        vx.march(system, between, solver=vx.OSQP(polygon=polygon))


def test_osqp_refuses_discs():
    with pytest.raises(
        vx.NotAccepted, match=r"^solver OSQP: the program has second-order cones.*polygon=16 replaces discs"
    ):
        vx.march(scene("bilateral, turning", 2), [0.0, 0.2], solver=vx.OSQP())
    for wrong in (3, 2.5, "x", True):
        with pytest.raises(vx.SceneError, match=r"^OSQP: found polygon = .*at least 4"):
            vx.OSQP(polygon=wrong)


@mostly_long("coefficient", [0.1, 0.6, 1.5], 1)
def test_coulombs_law_is_solved_on_sets(coefficient):
    """By Newton's method on the whole law: friction stays within its bound, and meets it where discs slip."""
    pull, given = SCENES["Coulomb, turning"]
    history = vx.march(on_floor(block(4), pull, **{**given, "coefficient": coefficient}), TIMES)
    assert history.certificate_kind == "for the given friction"
    assert history.iterations.max() <= 20
    size = np.linalg.norm(history.multipliers, axis=2)
    assert (size <= coefficient * history.pressures * (1 + 1e-12)).all()
    slips = ~history.sticking[1:] & (history.pressures[1:] > 0)
    assert slips.any()
    assert size[1:][slips] == pytest.approx(coefficient * history.pressures[1:][slips], rel=1e-10)
