"""Friction laws of slip rates, and limits on velocities."""

import warnings

import cvxpy as cp
import numpy as np
import pytest

import vemcvx as vx

K, G, C, F = 2.0, 0.5, 3.0, 4.0  # stiffness, friction at rest, dashpot, force


def pulled(t):
    return [F if t > 0.0 else 0.0]


def slide(steps, solver=None):
    """Return the run of a slider on a spring, with the friction G + C v at the speed v."""
    law = vx.Law(lambda t, p, past, rate: G + C * rate, softening=0.0, rates=True)
    system = vx.System(K=[[K]], load=pulled, norms=vx.Norms(B=[[1.0]], w=0.0, law=law))
    return vx.march(system, np.linspace(0.0, 2.0, steps + 1), solver=solver)


def sink(steps):
    """Return the run of a spring and a dashpot, K y + C y' = F."""
    limits = vx.Limits(D=[[1.0]], e=0.0, compliance=1.0 / C, rates=True)
    return vx.march(vx.System(K=[[K]], load=pulled, limits=limits), np.linspace(0.0, 2.0, steps + 1))


@pytest.mark.parametrize(("run", "force"), [(slide, F - G), (sink, F)])
def test_an_unknown_relaxes_like_an_exponential_with_errors_of_order_one(run, force):
    errors = []
    for steps in (20, 40):
        found = run(steps)
        errors.append(np.abs(found.state[:, 0] - force / K * (1.0 - np.exp(-K * found.times / C))).max())
        assert found.certificate_kind == "bound"
        assert found.work_second_order[-1] == pytest.approx(found.energy[-1] + found.dissipated_second_order[-1])
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.05)


def test_clarabel_solves_the_slider_like_newton():
    assert np.abs(slide(10, vx.Clarabel()).state - slide(10).state).max() < 1e-8


def test_a_body_that_may_only_retreat_stays_where_it_was_farthest():
    system = vx.System(K=[[K]], load=lambda t: [-np.sin(t)], limits=vx.Limits(D=[[1.0]], e=0.0, rates=True))
    run = vx.march(system, np.linspace(0.0, 6.0, 25))
    force = -np.sin(run.times)
    assert run.state[:, 0] == pytest.approx(np.minimum.accumulate(force) / K, abs=1e-14)
    assert run.pressures[:, 0] == pytest.approx(force - np.minimum.accumulate(force), abs=1e-13)
    assert run.dissipated[-1] == 0.0


KINDS = {  # name: (law at speed v, potential for cvxpy at slip r in a step of length k), with parameters a and b
    "linear": (lambda a, b, v: a + b * v, lambda a, b, r, k: a * r + b / (2 * k) * cp.square(r)),
    "square": (lambda a, b, v: a + b * v**2, lambda a, b, r, k: a * r + b / (3 * k**2) * cp.power(r, 3)),
    "root": (lambda a, b, v: a + b * np.sqrt(v), lambda a, b, r, k: a * r + b / (1.5 * k**0.5) * cp.power(r, 1.5)),
    "bounded": (lambda a, b, v: a + b * v / (1.0 + v), None),
    "steep": (lambda a, b, v: a * np.minimum(1e3 * v, 1.0) + b * v, None),
}


def random_run(seed):
    """Return a system with a random monotone law, the run, and the law's potential and parameters."""
    rng = np.random.default_rng(seed)
    block, m, r = int(rng.integers(1, 3)), int(rng.integers(1, 6)), int(rng.integers(0, 3))
    n = m * block + int(rng.integers(0, 4))
    A = rng.normal(size=(n, n))
    matrix = (A @ A.T + 0.3 * np.eye(n)) * 10 ** rng.uniform(-2, 2)
    B = rng.normal(size=(m * block, n)) if rng.random() < 0.5 else np.eye(n)[: m * block]
    kind = list(KINDS)[int(rng.integers(len(KINDS)))]
    a, b = rng.uniform(0, 1, m) * (rng.random(m) < 0.8), rng.uniform(0, 2, m) * 10 ** rng.uniform(-2, 2)
    f, D = 3.0 * rng.normal(size=(2, n)), rng.normal(size=(r, n))
    compliance, rates = rng.uniform(0.1, 1, r) * (rng.random(r) < 0.5), rng.random(r) < 0.5
    law = vx.Law(lambda t, p, past, rate: KINDS[kind][0](a, b, rate), softening=0.0, rates=True)
    system = vx.System(
        K=matrix,
        load=lambda t: f[0] * t + f[1] * np.sin(2 * t),
        norms=vx.Norms(B=B, w=0.0, block=block, law=law),
        limits=vx.Limits(D=D, e=np.zeros(r), compliance=compliance, rates=rates) if r else None,
    )
    times = np.cumsum(np.append(0.0, rng.uniform(0.05, 0.6, 4)))
    return system, vx.march(system, times), KINDS[kind][1], (a, b)


def objective(system, before, t, k, potential, parts):
    """Return the unknowns, the objective and the constraints of a step in cvxpy."""
    y, block, limits = cp.Variable(len(before)), system.norms.block, system.limits
    d, B = y - before, system.B.toarray()
    total = 0.5 * cp.quad_form(y, cp.psd_wrap(system.K.toarray())) - system.load(t) @ y
    for j, (a, b) in enumerate(zip(*parts, strict=True)):
        total += potential(a, b, cp.norm(B[j * block : (j + 1) * block] @ d), k)
    if limits is None:
        return y, total, []
    z = [row @ (d if rate else y) for row, rate in zip(limits.D.toarray(), limits.rates, strict=True)]
    soft = np.where(limits.rates, k, 1.0) * limits.compliance
    total += sum(cp.square(cp.pos(one)) / (2 * c) for one, c in zip(z, soft, strict=True) if c > 0)
    return y, total, [one <= 0 for one, c in zip(z, soft, strict=True) if c == 0]


def judge(seed):
    """Check a run with a random law. Return True if cvxpy solved the first step."""
    system, run, potential, parts = random_run(seed)
    assert run.certificate_kind == "bound"
    assert (run.certified <= 1e-8 + 2.0 * run.certificate_floor).all()
    if potential is None:
        return False
    t, before = run.times, run.state
    y, total, rules = objective(system, before[0], t[1], t[1] - t[0], potential, parts)
    problem = cp.Problem(cp.Minimize(total), rules)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Clarabel may miss the accuracy.
        best = problem.solve(solver="CLARABEL")
    if problem.status != "optimal":
        return False
    y.value = before[1]
    # Clarabel violates rigid limits slightly, which lowers the objective by up to 1e-7.
    assert total.value - best <= 1e-9 * (before[1] @ system.K @ before[1]) + 1e-7 * abs(best)
    return True


@pytest.mark.parametrize("seed", range(12))
def test_random_monotone_laws_are_solved_and_certified(seed):
    judge(seed)


@pytest.mark.slow
def test_two_hundred_random_monotone_laws_are_solved_and_certified():
    assert sum(judge(seed) for seed in range(12, 212)) > 80


@pytest.mark.parametrize("kind", ["linear", "square", "root"])
def test_a_step_is_the_program_of_cvxpy_to_nine_digits(kind):
    value, potential = KINDS[kind]
    a, b, f = np.array([0.3, 0.2]), np.array([0.5, 2.0]), np.array([2.0, -3.0])
    matrix = np.array([[3.0, 1.0], [1.0, 2.0]])
    law = vx.Law(lambda t, p, past, rate: value(a, b, rate), softening=0.0, rates=True)
    system = vx.System(K=matrix, load=lambda t: f * t, norms=vx.Norms(B=np.eye(2), w=0.0, law=law))
    run = vx.march(system, [0.0, 0.7])
    y, total, rules = objective(system, np.zeros(2), 0.7, 0.7, potential, (a, b))
    best = cp.Problem(cp.Minimize(total), rules).solve(
        solver="CLARABEL", tol_gap_abs=1e-10, tol_gap_rel=1e-10, tol_feas=1e-10
    )
    if kind == "linear":  # Clarabel solves second-order cones to rounding.
        assert run.state[-1] == pytest.approx(y.value, rel=1e-9)
    y.value = run.state[-1]
    assert total.value == pytest.approx(best, rel=1e-9)


def test_a_law_that_falls_with_speed_gets_a_warning_and_a_certificate_for_the_given_friction():
    law = vx.Law(lambda t, p, past, rate: 1.0 + 2.0 / (1.0 + rate), softening=2.0, rates=True)
    system = vx.System(K=[[K]], load=lambda t: [4.0 * t], norms=vx.Norms(B=[[1.0]], w=0.0, law=law))
    # In steps of length k, the ratio of softening to stiffness is 2 / (k K).
    with pytest.warns(vx.SceneWarning, match="the ratio of softening to stiffness is 10;.*longer steps"):
        run = vx.march(system, np.linspace(0.0, 2.0, 21))
    assert run.certificate_kind == "for the given friction"


def block(*effects, **settings):
    """Return the run of a block of height 1 and length 2."""
    scene = vx.Scene(vx.Elasticity(young=100.0, poisson=0.0), *effects)
    mesh = vx.meshes.squares((4, 2), box=((0.0, 2.0), (0.0, 1.0)))
    return vx.simulate(scene, mesh, np.linspace(0.0, 1.0, 21), **settings)


def test_a_pressed_block_creeps_into_its_dashpots():
    with pytest.warns(vx.SceneWarning, match="nothing but friction or one-sided contact"):
        run = block(
            vx.Pressure(lambda x, t: np.full(len(x), 3.0 * (t > 0.0)), on="top"),
            vx.VelocityContact(on="bottom", damping=5.0),
            vx.PrescribedDisplacement(0.0, on=["left", "right"], direction=(1.0, 0.0)),
        )
    # The bottom sinks at the speed 3 / 5.
    assert run.displacement[-1, :, 1] == pytest.approx(-0.6 - 0.03 * run.mesh.points[:, 1], rel=1e-9)
    assert run.contact.pressure[-1] == pytest.approx(3.0)
    assert run.dissipated[-1] == pytest.approx(5.0 * 0.6**2 * 2.0)


def test_the_friction_of_a_belt_is_the_bound_at_its_speed():
    run = block(
        vx.Clamp(on="top"),
        vx.BilateralContact(on="bottom"),
        vx.SpeedFriction(lambda speed: 0.2 + 0.5 * speed, on="bottom", ground=lambda x, t: (2.0 * t, 0.0)),
    )
    # In the steady state, the slip rate is 2.
    assert run.force("bottom")[-1, 0] == pytest.approx(2.0 * 1.2, rel=1e-6)
    assert run.certificate_kind == "bound"


def test_a_body_that_only_friction_by_speed_holds_is_refused():
    floor, friction = vx.BilateralContact(on="bottom"), vx.SpeedFriction(lambda speed: 2.0 * speed, on="bottom")
    floats = pytest.warns(vx.SceneWarning, match="nothing but friction or one-sided contact holds the body")
    with floats, pytest.raises(vx.SceneError, match="found a law of slip rates, but nothing except"):
        block(floor, friction, vx.Traction((1.0, 0.0), on="right"), initial="settled")
