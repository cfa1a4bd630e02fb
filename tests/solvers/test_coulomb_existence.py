"""Coulomb's law on discs: how far an answer is from a solution is proven, also of answers that are no good yet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from blocks_in_space import block, on_floor
from faces_that_meet import TIMES, random_scene

import vemcvx as vx
from vemcvx.linear import pardiso
from vemcvx.program import operators
from vemcvx.program.operators import Operators, PressureLaw, Rows
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers import coulomb, sets_system
from vemcvx.solvers.coulomb import distance_to_a_solution
from vemcvx.solvers.newton import Sets
from vemcvx.solvers.sets_system import Response, SetsSystem
from vemcvx.solvers.solver import Iterate

pytestmark = pytest.mark.arithmetic


def pulled(t):
    return np.array([0.4 * np.cos(3 * t), 0.4 * np.sin(3 * t), -0.7]) * min(1.0, 4 * t)


def rubbing(coefficient, n=3):
    return on_floor(block(n), pulled, coefficient=coefficient, contact="unilateral")


def distances(monkeypatch, run):
    """[(to what Newton's method ends at, its bound)] of all answers on sets that a bound is proven for; |d|_K = 1."""
    found, met = [], coulomb._from_sets

    class Seen(coulomb.Found):
        def holds(self, program):
            tried.append(self)
            return super().holds(program)

    tried = []

    def on_sets(*args):
        answer = original(*args)
        return Seen(**{name: getattr(answer, name) for name in answer.__dataclass_fields__})

    def from_sets(program, law, start, response, rounds, w=None):
        tried.clear()
        end = met(program, law, start, response, rounds, w)
        if end is not None:
            unit, last = program.operators.energy_norm, end.point.d
            for answer in tried.copy():
                bound = distance_to_a_solution(program, law, answer, response)
                if bound is not None:
                    found.append(np.array([unit(answer.point.d - last), bound + answer.error]) / unit(last))
        return end

    original = coulomb.on_sets
    monkeypatch.setattr(coulomb, "on_sets", on_sets)
    monkeypatch.setattr(coulomb, "_from_sets", from_sets)
    run()
    return np.reshape(found, (-1, 2))


@pytest.mark.parametrize("turns", [0, 1])
@pytest.mark.parametrize("coefficient", [0.1, 0.3, 0.6])
def test_answers_are_as_near_to_a_solution_as_proven(monkeypatch, coefficient, turns):
    """Every set on the way that has a proof: the end of the way, known to 1e-12, is within the bound."""
    # Near the end bounds are small: the way is to begin far from it, at the answer before, and to take small steps.
    monkeypatch.setattr(coulomb, "swept", lambda program, law, start: start)
    monkeypatch.setattr(coulomb, "TURNS", turns)
    away, bound = distances(monkeypatch, lambda: vx.march(rubbing(coefficient), np.linspace(0, 1, 5))).T
    assert (away <= bound + 1e-12).all()
    early = away > 1e-10
    assert early.any()
    assert np.median(bound[early] / away[early]) < 1e3
    assert np.median(bound[~early]) < 1e-11


@pytest.mark.parametrize("coefficient", [0.3, 1.5])
def test_certificates_in_space_are_bounds(coefficient):
    history = vx.march(rubbing(coefficient), np.linspace(0, 1, 5))
    assert history.certificate_kind == "bound"
    assert history.certificate[1:].min() > 0
    assert history.certificate.max() < 1e-10


def test_the_system_that_was_solved_proves_its_answer(monkeypatch):
    """Its factor serves twice: most steps need no system of the point itself."""
    made, solved = [], []

    class Counted(SetsSystem):
        def __init__(self, *given):
            made.append(given)
            super().__init__(*given)

    def on_sets(*given):
        solved.append(given)
        return original(*given)

    original = coulomb.on_sets
    monkeypatch.setattr(coulomb, "SetsSystem", Counted)
    monkeypatch.setattr(coulomb, "on_sets", on_sets)
    history = vx.march(rubbing(0.3), np.linspace(0, 1, 5))
    assert history.certificate_kind == "bound"
    assert history.certificate.max() < 1e-10
    assert len(made) - len(solved) <= 1


def test_what_is_nearly_anything_else_is_not_proven(monkeypatch):
    """Slips within rounding of none, forces of what sticks at their bound, pressures of nothing: no bound."""
    seen = []

    def watched(*given):
        seen.append(given)
        return distance_to_a_solution(*given)

    monkeypatch.setattr(coulomb, "distance_to_a_solution", watched)
    vx.march(rubbing(0.6), [0.0, 0.5, 1.0])
    program, law, found, response = seen[-1]
    sets = found.sets
    assert distance_to_a_solution(program, law, found, response) is not None
    slips, sticks = ~sets.stick & (law.weights(found.point.p) > 0), sets.stick
    assert slips.any()
    lam = found.point.lam.copy()
    lam[np.argmax(slips)] *= -1.0
    off = replace(found, point=replace(found.point, lam=lam))
    assert distance_to_a_solution(program, law, off, response) is None
    coarse = replace(found, forces=float(np.linalg.norm(lam, axis=1).max()))
    assert distance_to_a_solution(program, law, coarse, response) is None
    if sticks.any():
        lam = found.point.lam.copy()
        i = int(np.argmax(sticks))
        lam[i] = [2 * law.weights(found.point.p)[i], 0.0]
        over = replace(found, point=replace(found.point, lam=lam))
        assert distance_to_a_solution(program, law, over, response) is None


@pytest.mark.slow
@pytest.mark.parametrize("start", range(0, 120, 20))
def test_random_scenes_are_as_near_to_a_solution_as_proven(monkeypatch, start):
    proven = 0
    for seed in range(start, start + 20):
        scene, mesh, kind = random_scene(seed)
        if kind in ("coulomb", "compl"):
            with monkeypatch.context() as patch:
                # The way is made long, as above; on every other scene answers are corrected once on their factor.
                patch.setattr(coulomb, "swept", lambda program, law, start: start)
                patch.setattr(coulomb, "TURNS", seed % 2)
                found = distances(patch, lambda scene=scene, mesh=mesh: vx.simulate(scene, mesh, TIMES))
            proven += len(found)
            assert (found[:, 0] <= found[:, 1] + 1e-11).all(), seed
    assert proven > 10


def on_given_sets(K, B, D, compliance, at, J, curvature, moves):
    """What is proven of a point (d, lam, p) where limits act and discs slip along the first axis, by `moves`."""
    (d, lam, p), w0 = at, np.maximum(np.linalg.norm(at[1], axis=1) - J @ at[2], 0.0)
    law = PressureLaw(lambda p: w0 + J @ p, lambda p: Rows(sp.csr_matrix(J)))
    operators = Operators(K, sp.csr_matrix(B), 2, D=sp.csr_matrix(D), compliance=compliance)
    force = K @ d + B.T @ lam.ravel() + D.T @ p
    program = StepProgram(operators, force, w0 + J @ p, B @ d - moves, D @ d - compliance * p)
    ahead = np.tile([1.0, 0.0], (len(lam), 1))
    sets = Sets(np.zeros(len(lam), dtype=bool), ahead, curvature, np.ones(len(p), dtype=bool))
    response = Response(operators)
    point = coulomb.Found(
        sets=sets,
        once=sets,
        law=law.piece(p),
        weights=w0 + J @ p,
        point=Iterate(d, lam, p),
        error=0.0,
        forces=1e-10,
        motions=np.full(B.shape[0] + len(p), 1e-13),
        system=SetsSystem(operators, sets, Rows(sp.csr_matrix(J)), response),
    )
    return distance_to_a_solution(program, law, point, response)


def test_rows_beside_limits_that_nearly_follow_from_others_move():
    """Of e_1 and e_1 + 1e-5 e_2, coordinates of length 1e5: beside these the rest of B looked like rounding."""
    D, B = np.array([[1, 0, 0, 0], [1, 1e-5, 0, 0.0]]), np.array([[0, 1, 0.1, 0], [0, 1, 0, 0.1]])
    at = np.array([0, 0, 1.0, 0]), np.array([[1.0, 0.01]]), np.array([1e4, 1e4])
    found = on_given_sets(np.eye(4), B, D, np.zeros(2), at, np.zeros((1, 2)), np.ones(1), np.array([1.0, 0]))
    assert found is None or found >= 9.9e-4


def test_what_slips_without_weight_holds_nothing():
    """The second limit of the row acts with no force, and the disc that follows it kept the curvature of its sets."""
    k = 90.0
    K, D = np.array([[1, 0, 0], [0, 1, k], [0, k, 1e4 + k * k]]), np.array([[0, 0, 1.0], [0, 0, 1.0]])
    B, J = np.array([[1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0.0]]), np.array([[0, 1.0], [1.0, 0]])
    at = np.zeros(3), np.array([[0, 0], [1e3, 0.02]]), np.array([1e3, 0.0])
    found = on_given_sets(K, B, D, np.array([0, 1.0]), at, J, np.array([1e4, 0.1]), np.array([1e4, 0, 1e4, 0]))
    assert found is None or found >= 1.63


def answer_by_hand(K, A, H, c, pulled, psi, push):
    """(d, x), by residuals in extended precision: the first disc sticks, psi + push s is added to what others have."""
    n, m = K.shape[0], A.shape[0] - len(c)
    M, right = np.zeros((n + len(A), n + len(A))), np.zeros(n + len(A))
    M[:n, :n], M[:n, n:] = K, A.T
    M[n : n + 2, :n] = A[:2]
    # lam_i - q_i (J p)_i - (h_i (I - q_i q_i') + push) s_i = psi_i, and z_j = c_j p_j.
    M[n + 2 : n + m, :n] = -((H + push) @ A[:m])[2:]
    M[n + 2 :, n + 2 :] = np.eye(len(A) - 2)
    M[n + 2 : n + m, n + m :] = -pulled[2:]
    M[n + m :, :n], M[n + m :, n + m :] = A[m:], -np.diag(c)
    right[n + 2 : n + m] = psi[2:]
    found = np.zeros(len(right))
    for _ in range(3):
        off = right - M.astype(np.longdouble) @ found
        found += np.linalg.solve(M, off.astype(float))
    return found[:n], found[n:]


@pytest.mark.long
def test_forces_that_follow_motions_are_answered_within_bounds():
    """Random systems: curvatures that are too small or too large by a given part, the worst of 16 signs of these."""
    rng, met, nearest = np.random.default_rng(3), 0, 0.0
    for _ in range(40):
        n, m, r = 9, 4, 2
        root, A = rng.normal(size=(n, n)), rng.normal(size=(2 * m + r, n))
        K, c = root @ root.T + 0.3 * np.eye(n), np.array([0.0, 0.5])
        turn = rng.uniform(0, 2 * np.pi, m)
        q = np.column_stack([np.cos(turn), np.sin(turn)]) * (np.arange(m) > 0)[:, None]
        h = 10.0 ** rng.uniform(-1, 2, m) * (np.arange(m) > 0)
        J = 0.2 * rng.uniform(size=(m, r)) * (np.arange(m) > 0)[:, None]
        sets = Sets(np.arange(m) == 0, q, h, np.ones(r, dtype=bool))
        operators = Operators(K, sp.csr_matrix(A[: 2 * m]), 2, D=sp.csr_matrix(A[2 * m :]), compliance=c)
        system = SetsSystem(operators, sets, Rows(sp.csr_matrix(J)), Response(operators))
        t, u = rng.uniform(size=(2, m)) * (np.arange(m) > 0)
        lacking = h * np.append(np.zeros(2), 10.0 ** rng.uniform(-3, -0.7, m - 2))
        lacking[1] = 3 * h[1] * (h[1] < 0.3)
        bounds = system.answers(t, u, lacking)
        if bounds is None:
            continue
        met += 1
        beside = np.column_stack([-q[:, 1], q[:, 0]])
        blocks = [np.outer(one, one) for one in beside]
        H = scipy.linalg.block_diag(*(h[i] * blocks[i] for i in range(m)))
        pulled = np.einsum("ij,ik->ijk", q, J).reshape(2 * m, r)
        for _ in range(16):
            a, b, sign = rng.choice([-1.0, 1.0], (3, m))
            psi = ((a * t)[:, None] * q + (b * u)[:, None] * beside).ravel()
            push = scipy.linalg.block_diag(*(sign[i] * lacking[i] * blocks[i] for i in range(m)))
            d, x = answer_by_hand(K, A, H, c, pulled, psi, push)
            s, lam = (A[: 2 * m] @ d).reshape(m, 2), x[: 2 * m].reshape(m, 2)
            energy = np.sqrt(d @ K @ d + d @ A[: 2 * m].T @ H @ A[: 2 * m] @ d + (A[-1] @ d) ** 2 / c[1])
            sizes = np.abs(np.einsum("ij,ij->i", s, q)), np.abs(np.einsum("ij,ij->i", s, beside)), A[2 * m :] @ d
            found = bounds.along, bounds.across, bounds.excess
            assert all((np.abs(size) <= bound + 1e-12).all() for size, bound in zip(sizes, found, strict=True))
            assert energy <= bounds.energy
            assert (np.abs(x[2 * m :]) <= bounds.forces).all()
            assert np.hypot(*lam[0]) <= bounds.multipliers[0]
            nearest = max(nearest, energy / bounds.energy)
    assert met >= 20
    assert nearest > 0.1


def test_curvatures_that_are_off_count_by_the_worst_of_many_and_alone_where_they_are_few():
    """Against the norm itself, of forces l_i |g_i| in the energy of K and curvatures, some of which are none."""
    rng, nearest = np.random.default_rng(5), []
    for _ in range(60):
        n, m = 9, 4
        root, B = rng.normal(size=(n, n)), rng.normal(size=(2 * m, n))
        K, turn = root @ root.T + 0.3 * np.eye(n), rng.uniform(0, 2 * np.pi, m)
        q, beside = np.stack([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]).swapaxes(1, 2)
        h, lacking = 10.0 ** rng.uniform(-2, 4, m), 10.0 ** rng.uniform(-3, 2, m)
        h[rng.random(m) < 0.2] = 0.0
        operators = Operators(K, sp.csr_matrix(B), 2)
        sets = Sets(np.zeros(m, dtype=bool), q, h, np.zeros(0, dtype=bool))
        system = SetsSystem(operators, sets, Rows(sp.csr_matrix((m, 0))), Response(operators))
        across = np.einsum("ij,ijk->ik", beside, B.reshape(m, 2, n))
        N = K + (across.T * h) @ across
        exact = scipy.linalg.eigh((across.T * lacking) @ across, N, eigvals_only=True)[-1]
        nearest.append(exact / system._bent_by(lacking))
    assert 0.99 < max(nearest) <= 1 + 1e-12


@pytest.mark.parametrize("installed", [True, False], ids=["default", "SuperLU"])
@pytest.mark.parametrize("softness", [0.0, 0.3], ids=["rigid", "soft"])
def test_many_contacts_are_solved_on_all_unknowns_alike(monkeypatch, softness, installed):
    """Sparse systems on all unknowns where those of contact are too many for dense ones: the same, proven as well."""
    system = on_floor(block(3), pulled, coefficient=0.3, contact="unilateral")
    limits = replace(system.limits, compliance=softness * (np.arange(system.limits.count) % 2))
    system, times = replace(system, limits=limits), np.linspace(0, 1, 5)
    made = []

    def opened(M):
        made.append(M)
        return linear_opened(M)

    linear_opened = sets_system.opened
    monkeypatch.setattr(sets_system, "opened", opened)
    dense = vx.march(system, times, condense=False)
    assert not made
    monkeypatch.setattr(operators, "AT_ONCE", 0)
    if not installed:
        monkeypatch.setattr(pardiso, "_solver_class", lambda: None)
    sparse = vx.march(system, times, condense=False)
    assert made
    assert all(sp.issparse(M) for M in made)
    apart = [np.sqrt(max(d @ (system.K @ d), 0.0)) for d in dense.state - sparse.state]
    size = np.sqrt(max(d @ (system.K @ d) for d in dense.state))
    assert max(apart) <= 1e-12 * size
    np.testing.assert_array_equal(sparse.estimated, dense.estimated)
    assert softness or not dense.estimated.any()


def test_a_system_stands_in_the_memory_of_the_last_and_answers_as_if_it_were_the_first():
    rng, m, n = np.random.default_rng(5), 5, 15
    root = rng.normal(size=(n, n))
    operators = Operators(
        root @ root.T + np.eye(n), sp.eye_array(2 * m, n, format="csr"), 2, D=sp.eye_array(n).tocsr()[2 * m :]
    )
    J, response, made = Rows(sp.csr_matrix(0.2 * np.eye(m))), Response(operators), []
    for stuck in (1, 3, 2):
        stick = np.arange(m) < stuck
        q = np.where(stick[:, None], 0.0, [0.6, 0.8])
        sets = Sets(stick, q, np.where(stick, 0.0, 2.0), np.ones(m, dtype=bool))
        force, wanted = rng.normal(size=n), rng.normal(size=3 * m)
        systems = SetsSystem(operators, sets, J, response), SetsSystem(operators, sets, J, Response(operators))
        answers = [(*system.solve(force, wanted), system.gain) for system in systems]
        assert all(np.array_equal(one, other) for one, other in zip(*answers, strict=True))
        made.append(systems[0]._reactions)
    assert np.shares_memory(made[0], made[1])
    assert np.shares_memory(made[1], made[2])
