"""Laws of friction that depend on slip."""

import cvxpy as cp
import numpy as np
import pytest
from own_law import Law
from scenes import mostly_slow, small

import vemcvx as vx
from slip_weakening import SlipWeakening

STEEL, HELD = vx.Elasticity(200.0, 0.3), vx.Clamp(on="right")
TOUCHING = vx.BilateralContact(on="bottom")
TIMES = np.linspace(0.0, 1.0, 7)


def to_and_fro(x, t):
    return np.column_stack([12 * np.sin(5 * t) * (1.3 - x[:, 1]), -2 * t + 0 * x[:, 0]])


def weakening(t, pressure, before, slip):
    return np.maximum(4.0 - 30.0 * (before + slip), 1.0)


def simulate(*friction, solver=None, times=TIMES, load=to_and_fro, contact=TOUCHING, **options):
    scene = vx.Scene(STEEL, HELD, vx.Traction(load, on="left"), contact, *friction)
    return vx.simulate(scene, small("voronoi", 4), times, solver=solver or vx.Newton(1e-9), **options)


@pytest.mark.long
def test_coulombs_coefficient_may_fall_with_slip():
    """A block is pressed by p and sheared. Friction is mu(A) p after the accumulated slip A."""
    young, height, p, k = 26.0, 0.5, 2.0, 5.0
    times, stiff = np.linspace(0.0, 1.0, 11), young / 2 / height
    q, a = np.zeros(len(times)), np.zeros(len(times))
    for n, U in enumerate(0.12 * times[1:], start=1):
        slip = max(stiff * (U - a[n - 1]) - (0.5 - k * a[n - 1]) * p, 0.0) / (stiff - k * p)
        if 0.5 - k * (a[n - 1] + slip) < 0.2:
            slip = max(U - a[n - 1] - 0.2 * p / stiff, 0.0)
        a[n] = a[n - 1] + slip
        q[n] = stiff * (U - a[n])

    def bound(t, pressure, before, slip):
        return np.maximum(0.5 - k * (before + slip), 0.2) * np.maximum(pressure, 0.0)

    def shear(x, t):
        return np.column_stack([0 * x[:, 0], np.where(x[:, 0] > 0.5, 1.0, -1.0) * np.interp(t, times, q)])

    scene = vx.Scene(
        vx.Elasticity(young, 0.0),
        vx.PrescribedDisplacement(lambda x, t: [0.12 * t, -p * height / young], on="top"),
        vx.Traction(shear, on=["left", "right"]),
        vx.UnilateralContact(on="bottom"),
        Law(bound, pressed=True),
    )
    mesh = vx.meshes.squares(3, box=((0, 1), (0, height)))
    history = vx.simulate(scene, mesh, times, initial="settled", solver=vx.Newton(1e-9))
    # The accuracy is 1e-9 in each of ten steps, relative to the energy of the pressed block.
    assert np.abs(-history.contact.traction[:, :, 0] - q[:, None]).max() < 1e-7
    assert np.abs(history.contact.slip[:, :, 0] - a[:, None]).max() < 1e-7
    assert 0 < q[-1] < 0.6 * q.max()


def worn_slope(t, forces, before):
    return np.maximum(0.6 - 20.0 * before, 0.2) * (forces >= 0)


def pressing_load(x, t):
    return to_and_fro(x, t) - [0.0, 9.0 * t]


def coulomb(t, pressure, before, slip):
    return 0.3 * np.maximum(pressure, 0.0)


def reads_the_slip(t, pressure, before, slip):
    return np.maximum(0.6 - 20.0 * (before + slip), 0.2) * np.maximum(pressure, 0.0)


PRESSING = vx.UnilateralContact(on="bottom")
WRONG = {
    "a shape": (Law(lambda t, p, a, s: np.ones(3)), "Law: (law of friction: found|its law of friction failed)"),
    "a negative weight": (Law(lambda t, p, a, s: 1.0 - 1e3 * (a + s)), "found the weight -.* node"),
    "an error": (Law(lambda t, p, a, s: 1 / 0), "Law: its law of friction failed .* ZeroDivisionError"),
    "too few directions": (Law(weakening, directions=lambda n: n[:-1]), "Law: found directions of shape"),
    "a softening below zero": (Law(weakening, -1.0), "found the softening -"),
    "too small a softening": (Law(weakening, 20.0), r"changes the weight .* softening must be the largest"),
    "a slope": (Law(reads_the_slip, pressed=True, slope=worn_slope), "A law with `slope=` must not depend", PRESSING),
    "no pressed=True": (Law(coulomb), "p is empty without pressed=True"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_wrong_laws_are_refused(name):
    law, message, *contact = WRONG[name]
    load = pressing_load if contact else to_and_fro
    with pytest.raises(vx.SceneError, match=message):
        simulate(law, contact=contact[0] if contact else TOUCHING, load=load)


@pytest.mark.long
def test_friction_in_space_falls_with_the_length_of_the_path():
    """A block is sheared along a circle. Friction falls with the length of the path."""

    def around(x, t):
        return np.tile([0.08 * np.cos(3 * t) - 0.08, 0.08 * np.sin(3 * t), 0.0], (len(x), 1))

    scene = vx.Scene(
        vx.Elasticity(26.0, 0.3),
        vx.PrescribedDisplacement(around, on="top"),
        vx.PrescribedDisplacement(0.0, on=["left", "right", "front", "back"], direction=(0.0, 0.0, 1.0)),
        TOUCHING,
        SlipWeakening(1.0, 0.4, 0.1, on="bottom"),
    )
    times, stiff = np.linspace(0.0, 1.5, 7), 10.0 / 0.5
    mesh = vx.meshes.cubes(2, box=((0, 1), (0, 1), (0, 0.5)))
    history = vx.simulate(scene, mesh, times, solver=vx.Newton(1e-8))
    a, way = np.zeros((len(times), 2)), np.zeros(len(times))
    for n, t in enumerate(times[1:], start=1):
        pull = stiff * (around(np.zeros((1, 3)), t)[0, :2] - a[n - 1])
        size = np.linalg.norm(pull)
        step = max(size - max(1 - 6 * way[n - 1], 0.4), 0.0) / (stiff - 6)
        if way[n - 1] + step > 0.1:
            step = max(size - 0.4, 0.0) / stiff
        a[n], way[n] = a[n - 1] + step * pull / size, way[n - 1] + step
    assert np.abs(history.contact.slip[:, :, :2] - a[:, None]).max() < 1e-6
    assert np.abs(history.contact.accumulated_slip - way[:, None]).max() < 1e-6
    assert way[-1] > 0.1


def test_friction_acts_along_any_given_direction():
    """A block is pulled along e = (3, 4) / 5. Friction along e reaches the bound."""

    bound, held = 1.0, vx.PrescribedDisplacement(lambda x, t: [0.3 * t, 0.4 * t], on="top")
    along_e = lambda normals: np.tile([0.6, 0.8], (len(normals), 1))  # noqa: E731
    friction = Law(lambda t, pressure, before, slip: bound, softening=0.0, directions=along_e)
    history = vx.simulate(vx.Scene(STEEL, held, friction), vx.meshes.squares(3), [0.0, 0.5, 1.0])
    contact = history.contact
    assert not contact.sticking[1:].any()
    # The normal part of friction counts as pressure. The floor has e . n = -.8.
    assert contact.traction[-1] == pytest.approx(np.tile([-0.6 * bound, 0.0], (4, 1)), abs=1e-9)
    assert contact.pressure[-1] == pytest.approx(-0.8 * bound, abs=1e-9)
    assert contact.bound[1:] == pytest.approx(bound, abs=1e-12)
    along = np.linalg.norm(history.reaction("top"), axis=1)
    assert along[-1] == pytest.approx(bound, abs=1e-9)
    moved = np.abs(np.diff(history.displacement[:, contact.nodes] @ [0.6, 0.8], axis=0)).sum(axis=0)
    assert contact.accumulated_slip[-1] == pytest.approx(moved, rel=1e-9)


@pytest.mark.long
def test_error_budgets_refuse_laws_of_slip():
    with pytest.raises(vx.SceneError, match="error_budget: there is no estimate for Law: its weights depend on slip"):
        vx.error_budget(simulate(Law(weakening, 30.0)))


# In a fixed-point iteration, cvxpy solves the step, and the law updates the weights.


def random_system(rng, n=6, healing=False):
    """Return a small body and a law with weights that fall with slip."""
    m = n - 1
    root = rng.normal(size=(n, n))
    K = root @ root.T / n + 0.5 * np.eye(n)
    B = rng.normal(size=(m, n))
    push, turn = rng.normal(size=(2, n))
    peak = rng.uniform(0.3, 1.0, m)
    rest, k = peak * rng.uniform(0.1, 0.8, m), rng.uniform(0.1, 1.0, m)
    worst = np.linalg.eigvalsh(np.sqrt(k)[:, None] * (B @ np.linalg.solve(K, B.T)) * np.sqrt(k))[-1]
    k *= rng.uniform(0.2, 0.8) / worst
    heal = rng.uniform(0.0, 1.0, m) if healing else np.zeros(m)

    def law(t, p, past, slip):
        return np.maximum(peak - k * (past + slip), rest) + heal * t

    def load(t):
        return 3.0 * np.sin(4 * t) * push + t * turn

    return vx.System(K, load, vx.Norms(B, peak, law=vx.Law(law, softening=k))), law


def march_by_cvxpy(system, law, times):
    """Return the states, and the largest distance between the last two iterates of a step."""
    B, y, past, left = system.B.toarray(), np.zeros(system.n), np.zeros(system.norms.count), 0.0
    K, f, w = system.K.toarray(), cp.Parameter(system.n), cp.Parameter(system.norms.count, nonneg=True)
    d, states = cp.Variable(system.n), [np.zeros(system.n)]
    posed = cp.Problem(cp.Minimize(0.5 * cp.sum_squares(np.linalg.cholesky(K).T @ d) - f @ d + w @ cp.abs(B @ d)))
    for t in times[1:]:
        slip, last = np.zeros(len(past)), None
        for _ in range(60):
            f.value, w.value = system.force(t) - K @ y, law(t, None, past, slip)
            posed.solve(solver=cp.CLARABEL, tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
            slip = np.abs(B @ d.value)
            moved = np.inf if last is None else np.abs(d.value - last).max()
            last = d.value
            if moved < 1e-8:
                break
        left, y, past = max(left, moved), y + last, past + slip
        states.append(y)
    return np.array(states), left


@mostly_slow("seed", range(40))
def test_random_laws_against_an_independent_fixed_point(seed):
    """States differ by at most 20 times the errors of both methods."""
    rng = np.random.default_rng(seed)
    system, law = random_system(rng, n=int(rng.integers(2, 7)), healing=seed % 2 == 1)
    times = np.linspace(0.0, 1.5, 5)
    run = vx.march(system, times, solver=vx.Newton(1e-7))
    assert run.certificate.max() <= 1e-7
    found, left = march_by_cvxpy(system, law, times)
    slack = 20 * np.sqrt(2 * run.gap).sum() + 100 * left + 1e-6
    assert left < 1e-6
    assert np.abs(run.state - found).max() < slack < 1e-3
    way = np.abs(np.diff(run.state @ system.B.T.toarray(), axis=0)).cumsum(axis=0)
    assert run.slipped[1:] == pytest.approx(way, abs=1e-12 * np.abs(run.state).max())
    made = np.diff(run.slipped, axis=0)
    asked = np.array([law(t, None, run.slipped[n], made[n]) for n, t in enumerate(times[1:])])
    assert run.weights[1:] == pytest.approx(asked, abs=1e-9)
