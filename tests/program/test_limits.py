"""One-sided terms: the certificate with limits, solvers on them, and contact that opens and closes in closed form."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import few_families

import vemcvx as vx
from vemcvx.program.operators import BOUNDS, SQUARED_POSITIVE_PARTS, Operators
from vemcvx.program.step_program import StepProgram

pytestmark = pytest.mark.arithmetic

YOUNG, POISSON = 10.0, 0.25
MU = YOUNG / (2 * (1 + POISSON))
LAM = 2 * MU * POISSON / (1 - 2 * POISSON)
OEDOMETER = LAM + 2 * MU


def random_program(seed, block=1, separate=False):
    """Norm terms and limits, a third of them soft, in general position or each on its own unknown."""
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


def solved(program):
    """To the rounding floor, by Newton."""
    none = np.zeros((program.operators.count, program.operators.block))
    answer = vx.Newton(max_iterations=2000).prepare(program.operators).solve(program, 1e-28, none)
    return answer, program.certify(answer.d, answer.lam, answer.p)


@pytest.mark.parametrize("separate", [False, True])
@pytest.mark.parametrize("block", [1, 2, 3])
def test_the_gap_bounds_the_error(block, separate):
    """1/2 |d - d*|_K^2 <= gap for every d within its bounds and all admissible multipliers; the gap is P - G."""
    rng = np.random.default_rng(5)
    for seed in range(8):
        program = random_program(seed, block, separate)
        best, own = solved(program)
        assert own.gap <= 1e-20 + own.floor
        for size in (1e-6, 1e-3, 1.0):
            d = program.feasible(best.d + size * rng.normal(size=best.d.shape))
            lam = program.project(best.lam + size * rng.normal(size=best.lam.shape))
            p = np.maximum(best.p + size * rng.normal(size=best.p.shape), 0.0)
            certificate, away = program.certify(d, lam, p), d - best.d
            assert min(certificate.friction.min(), certificate.limits.min(), certificate.equilibrium) >= 0
            error = 0.5 * away @ (program.operators.K @ away)
            assert error <= certificate.gap * (1 + 1e-9) + own.gap + certificate.floor
            v = np.linalg.solve(program.operators.K, program.g - program.multiplier_force(lam, p))
            dual = -0.5 * v @ program.operators.K @ v - lam.ravel() @ program.b - p @ program.e
            dual -= 0.5 * p @ (program.operators.compliance * p)
            # By theorem 2 it may be less than primal minus dual.
            plain = pytest.approx(program.objective(d) - dual, rel=1e-9, abs=1e-12)
            assert certificate.gap == plain or (certificate.moved > 0 and certificate.gap < plain.expected)


def test_beyond_a_bound_nothing_is_certified():
    program = random_program(1)
    inside = program.feasible(np.ones(14))
    assert np.isfinite(program.certify(inside, np.zeros((3, 1)), np.zeros(4)).gap)
    beyond = inside + 10 * np.linalg.pinv(program.operators.D.toarray())[:, 0]
    assert program.certify(beyond, np.zeros((3, 1)), np.zeros(4)).gap == np.inf
    assert program.objective(beyond) == np.inf


@pytest.mark.parametrize("separate", [False, True])
@pytest.mark.parametrize(
    ("solver", "block"), [(vx.Clarabel(), 1), (vx.Clarabel(), 2), (vx.OSQP(accuracy=1e-5), 1)], ids=str
)
def test_solvers_agree_with_newton(solver, block, separate):
    for seed in range(6):
        program = random_program(seed, block, separate)
        ours, own = solved(program)
        theirs = solver.prepare(program.operators).solve(program, 1e-13, np.zeros((3, block)))
        other = program.certify(theirs.d, theirs.lam, theirs.p)
        apart = ours.d - theirs.d
        assert np.sqrt(apart @ (program.operators.K @ apart)) <= own.error + other.error + 1e-12
        assert other.error <= 1e-4 * np.sqrt(ours.d @ (program.operators.K @ ours.d))


def test_features_and_who_accepts_them():
    operators = random_program(0).operators
    assert {BOUNDS, SQUARED_POSITIVE_PARTS} <= operators.features
    assert all(operators.features <= solver.accepts for solver in (vx.Newton(), vx.Clarabel(), vx.OSQP()))
    assert not operators.features <= vx.Direct.accepts


def test_a_spring_that_meets_a_wall_and_a_buffer():
    """K y = f: a wall at .3 stops the first unknown, a buffer of compliance .5 behind .2 yields to the second."""
    system = vx.System(
        np.diag([2.0, 4.0]), lambda t: [t, 4 * t], limits=vx.Limits(np.eye(2), [0.3, 0.2], compliance=[0.0, 0.5])
    )
    run = vx.march(system, np.linspace(0, 1, 6))
    t = run.times
    assert run.state[:, 0] == pytest.approx(np.minimum(t / 2, 0.3), abs=1e-14)
    over = np.maximum(4 * t - 0.8, 0.0) / (4 + 1 / 0.5)
    assert run.state[:, 1] == pytest.approx(np.where(t > 0.2, 0.2 + over, t), abs=1e-14)
    assert run.pressures == pytest.approx(np.column_stack([np.maximum(t - 0.6, 0.0), over / 0.5]), abs=1e-14)
    assert run.energy == pytest.approx(run.state[:, 0] ** 2 + 2 * run.state[:, 1] ** 2 + over**2, abs=1e-14)


def lowered(depth, obstacle):
    """A block (0, 2) x (0, 1/2) between rollers, lowered on an obstacle .01 below it; nothing varies along x."""

    def down(x, t):
        return np.tile([0.0, -depth(t)], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(down, on="top"),
        vx.PrescribedDisplacement(0.0, on=["left", "right"], direction="normal"),
        obstacle,
    )


TIMES = np.linspace(0.0, 3.0, 13)


def depth(t):
    """Down, up again beyond the gap, down."""
    return 0.05 * np.interp(t, [0, 1, 2, 3], [0, 1, 0, 0.6])


@pytest.mark.long
@few_families
@pytest.mark.parametrize("stiffness", [None, 400.0])
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel(), vx.OSQP()], ids=lambda s: s.name)
def test_contact_closes_and_opens_in_closed_form(family, stiffness, solver):
    """Uniaxial strain (depth - gap - yield) / H once the gap is closed; pressure = M strain = stiffness yield."""
    gap, H = 0.01, 0.5
    touch = vx.UnilateralContact("bottom", gap) if stiffness is None else vx.NormalCompliance(stiffness, "bottom", gap)
    mesh = vx.meshes.FAMILIES[family](4, box=((0, 2), (0, H)))
    history = vx.simulate(lowered(depth, touch), mesh, TIMES, solver=solver)
    give = 0.0 if stiffness is None else OEDOMETER / stiffness / H
    strain = np.maximum(depth(TIMES) - gap, 0.0) / H / (1 + give)
    # The certificate bounds the energy of the error; pressure and displacement follow with the stiffness of an edge.
    loose = 1e-9 if solver.name == "Newton" else 1e-4
    pressure = OEDOMETER * strain
    assert np.abs(history.contact.pressure - pressure[:, None]).max() < loose * pressure.max()
    y = mesh.points[:, 1]
    exact = -depth(TIMES)[:, None] + strain[:, None] * (H - y)
    assert np.abs(history.displacement[:, :, 1] - exact).max() < loose * 0.05
    assert np.abs(history.displacement[:, :, 0]).max() < loose * 0.05
    yielded = 0.0 if stiffness is None else 0.5 * pressure**2 / stiffness * 2.0
    assert history.energy == pytest.approx(0.5 * OEDOMETER * strain**2 * 2.0 * H + yielded, abs=loose * 1e-2)
    # The ledger's rest is 1/2 a(du, du) + p . D du, never negative.
    assert (np.diff(history.work - history.energy) >= -1e-12 * history.work.max()).all()


@few_families
@pytest.mark.parametrize("stiffness", [None, 400.0])
@pytest.mark.parametrize("start", ["settled", None])
def test_an_obstacle_that_overlaps_presses_the_body_back(family, stiffness, start):
    """Uniaxial strain (interference - yield) / H, from the start or with a gap that falls."""
    H, share = 0.5, 1.0 if start == "settled" else TIMES / TIMES[-1]
    gap = -0.01 if start == "settled" else lambda x, t: np.full(len(x), -0.01 * t / TIMES[-1])
    touch = vx.UnilateralContact("bottom", gap) if stiffness is None else vx.NormalCompliance(stiffness, "bottom", gap)
    mesh = vx.meshes.FAMILIES[family](2, box=((0, 2), (0, H)))
    history = vx.simulate(lowered(lambda t: 0.0, touch), mesh, TIMES, initial=start)
    give = 0.0 if stiffness is None else OEDOMETER / stiffness / H
    pressure = OEDOMETER * share * np.full(len(TIMES), 0.01 / H / (1 + give))
    assert np.abs(history.contact.pressure - pressure[:, None]).max() < 1e-12 * pressure.max()
    stored = pressure**2 / OEDOMETER * H * (1 + give)
    assert history.energy == pytest.approx(stored, rel=1e-11)
    # The rest is 1/2 a(du, du) + p . dz, summed, and vanishes with the step: here all of E / 12.
    if start is None:
        assert history.work[-1] - history.energy[-1] == pytest.approx(stored[-1] / (len(TIMES) - 1), rel=1e-9)


def test_a_body_inside_its_obstacle_does_not_start_at_rest():
    scene = lowered(lambda t: 0.0, vx.UnilateralContact("bottom", lambda x, t: -0.01 - 0.02 * x[:, 0]))
    for initial in (None, "equilibrium"):
        with pytest.raises(vx.SceneError, match=r"^initial: at t = 0 the body is 0\.05 inside .* node 2 .*'settled'"):
            vx.simulate(scene, vx.meshes.squares((2, 1), box=((0, 2), (0, 0.5))), TIMES, initial=initial)


@pytest.mark.long
@few_families
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()], ids=lambda s: s.name)
@pytest.mark.parametrize("cap", [None, 0.35])
def test_coulomb_friction_in_closed_form(family, solver, cap):
    """Pressed by a fixed depth and sheared to and fro: uniform shear, bound coefficient * pressure (or the cap)."""
    coefficient, V, H, times = 0.4, 0.04, 0.5, np.linspace(0.0, 5.0, 21)
    pressure, across = OEDOMETER * V / H, -LAM * V / H
    bound = min(coefficient * pressure, np.inf if cap is None else cap)
    U = 2.5 * bound * H / MU * np.interp(times, [0, 1, 3, 5], [0, 1, -1, 1])
    gamma, a = np.zeros(21), np.zeros(21)
    for n in range(1, 21):
        gamma[n] = np.clip((U[n] - a[n - 1]) / H, -bound / MU, bound / MU)
        a[n] = U[n] - gamma[n] * H

    def side(sign):
        return lambda x, t: np.tile([sign * across, sign * MU * np.interp(t, times, gamma)], (len(x), 1))

    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(lambda x, t: np.tile([np.interp(t, times, U), -V], (len(x), 1)), on="top"),
        vx.Traction(side(1.0), on="right"),
        vx.Traction(side(-1.0), on="left"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(coefficient, on="bottom", cap=cap),
    )
    mesh = vx.meshes.FAMILIES[family](4, box=((0, 2), (0, H)))
    history = vx.simulate(scene, mesh, times, solver=solver, initial="settled")
    loose = 1e-6 if solver.name == "Newton" else 1e-3
    contact = history.contact
    assert np.abs(contact.pressure - pressure).max() < loose * pressure
    assert np.abs(contact.bound - bound).max() < loose * bound
    assert np.abs(contact.traction[:, :, 0] + MU * gamma[:, None]).max() < loose * bound
    assert np.abs(contact.slip[:, :, 0] - a[:, None]).max() < loose * np.abs(U).max()
    lost = np.concatenate([[0], np.cumsum(np.abs(np.diff(a)))]) * bound * 2.0
    assert history.dissipated == pytest.approx(lost, abs=10 * loose * lost.max())


def wedge(coefficient):
    """One slider whose slip by u raises its pressure: p = 1 + .9 u, u = 3.5 - coefficient p while it slips."""
    norms = vx.Norms([[1.0, 0.0]], 0.0, law=vx.Law(lambda t, p, past, slip: coefficient * p, slips=False))
    stiffness = [[1.0, -0.9], [-0.9, 1.0]]
    return vx.System(stiffness, lambda t: [3.5 * t, t], norms, limits=vx.Limits([[0.0, 1.0]], 0.0))


@pytest.mark.long
def test_coulomb_friction_does_not_depend_on_the_mesh():
    """A pressed block pushed sideways: stored energy and work of friction settle."""

    def push(x, t):
        return np.tile([12.0 * t, 0.0], (len(x), 1))

    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(push, on="left"),
        vx.Traction((0.0, -6.0), on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.5, on="bottom"),
    )
    found = []
    for n in (16, 32, 64, 128):
        history = vx.simulate(scene, vx.meshes.squares(n), np.linspace(0, 1, 9), initial="settled")
        assert history.certificate.max() <= 1e-8
        found.append((history.energy[-1], history.dissipated[-1]))
    # Halving h: differences shrink, and the last is below half a per cent.
    for values in np.array(found).T:
        steps = np.abs(np.diff(values)) / values[-1]
        assert steps[-1] < 0.005
        assert (np.diff(steps) < 0).all()


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        (vx.UnilateralContact("bottom", np.nan), r"^UnilateralContact on bottom: gap: found NaN"),
        (vx.NormalCompliance(0.0, "bottom"), r"^NormalCompliance on bottom: found stiffness = 0 at .* must be > 0"),
        (vx.NormalCompliance(1.0, "botom"), r"^NormalCompliance: there is no boundary named 'botom'"),
        (vx.CoulombFriction(-0.1, "bottom"), r"found coefficient = -0\.1 at .* must be >= 0"),
        (
            vx.CoulombFriction(0.1, "top"),
            r"^CoulombFriction on top: no pressure is known at 2 of 3 places; it needs",
        ),
    ],
)
def test_mistakes(effect, message):
    scene = vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.Clamp(on="right"),
        *(
            []
            if "Compliance" in type(effect).__name__ or "Unilateral" in type(effect).__name__
            else [vx.UnilateralContact("bottom")]
        ),
        vx.Traction((0.0, -1.0), on="left"),
        effect,
    )
    with pytest.raises(vx.SceneError, match=message):
        vx.simulate(scene, vx.meshes.squares(2), [0.0, 1.0], initial="settled")


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (
            lambda: vx.Limits(np.eye(2), [1.0]),
            r"^Limits: e: found an array of shape \(1,\); wanted",
        ),
        (lambda: vx.Limits(np.eye(2), [1.0, np.nan]), r"^Limits: e: found NaN"),
        (lambda: vx.Limits(np.eye(2), 0.0, compliance=-1.0), r"^Limits: found the compliance -1 of limit 0"),
        (
            lambda: vx.System(np.eye(3), lambda t: np.zeros(3), limits=vx.Limits(np.eye(2), 0.0)),
            r"found limits over 2 unknowns, but K has 3",
        ),
        (lambda: vx.System(np.eye(2), np.zeros, limits=5), r"^System: found limits = 5; wanted Limits"),
    ],
)
def test_limits_that_are_none(limits, message):
    with pytest.raises(vx.SceneError, match=message):
        limits()


@pytest.mark.long
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()])
def test_limits_that_contradict_each_other_are_named(solver):
    """y_0 <= t - 1 and -y_0 <= -t / 2 contradict each other before t = 2, at t = 1 by 1/2; limit 1 has no part."""
    D = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    limits = vx.Limits(D, lambda t: [t - 1.0, 0.1, -0.5 * t])
    system = vx.System(np.diag([2.0, 3.0]), lambda t: [0.0, t], limits=limits)
    match = r"^step 0 at t = 1: .*at limit 0 and limit 2, which contradict each other by 0\.5\. Enlarge a gap"
    with pytest.raises(vx.SceneError, match=match):
        vx.march(system, [1.0, 3.0], solver=solver, initial="settled")
    assert vx.march(system, [2.0, 3.0], solver=solver, initial="settled").certified.max() <= solver.accuracy


@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()])
@pytest.mark.parametrize("amount", [1e-6, 1e-8, 3e-9, 1e-9, 3e-10, 1e-11, 1e-13, 1e-15])
@pytest.mark.parametrize(("D", "lam"), [(np.eye(2)[0], 0.0), (np.array([1.0, 0.5]), 0.2)], ids=["one unknown", "two"])
def test_limits_that_all_but_meet_are_met_or_named(D, lam, amount, solver):
    """D y <= 1 and D y >= 1 + amount, beside limits that meet: named, or answered within the amount."""
    K, load = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([5.0, 0.0])
    limits = vx.Limits(np.array([D, -D, [0.0, 1.0], [0.0, -1.0]]), [1.0, -1.0 - amount, lam, -lam])
    system = vx.System(K, lambda t: t * load, limits=limits)
    named = rf"at limit 0 and limit 1, which contradict each other by {amount:.1g}\."
    with pytest.raises(vx.SceneError, match=named) if amount > 1e-9 else suppress(vx.SceneError):
        found = vx.march(system, [0.0, 1.0], solver=solver, initial="settled")
        assert np.abs(found.state @ limits.D.T - limits.e).max() <= 2e-9


def test_bounds_are_met_exactly_beside_limits_that_give_way():
    """Where bounds and what gives way read one unknown, feasible increments are within the bounds to the last bit."""
    rng = np.random.default_rng(2)
    D = sp.csr_matrix(np.repeat(np.eye(6), 3, axis=0)[rng.permutation(18)] * rng.choice([-1.0, 0.5, 2.0], (18, 1)))
    compliance = np.where(np.arange(18) % 3 == 0, 0.1, 0.0)
    A = rng.normal(size=(6, 6))
    operators = Operators(A @ A.T + np.eye(6), sp.csr_matrix((0, 6)), D=D, compliance=compliance)
    for _ in range(20):
        program = StepProgram(operators, rng.normal(size=6), np.zeros(0), np.zeros(0), rng.random(18))
        d = program.feasible(rng.normal(size=6))
        assert (program.excess(d)[compliance == 0] <= 0).all()
        assert np.isfinite(program.certify(d, np.zeros((0, 1)), np.zeros(18)).gap)
