"""One-sided terms in closed form: contact that opens and closes, springs, limits that contradict each other."""

from contextlib import suppress

import numpy as np
import pytest
from scenes import few_families, mostly_long, small

import vemcvx as vx

pytestmark = pytest.mark.arithmetic

YOUNG, POISSON = 10.0, 0.25
MU = YOUNG / (2 * (1 + POISSON))
LAM = 2 * MU * POISSON / (1 - 2 * POISSON)
OEDOMETER = LAM + 2 * MU


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

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(lambda x, t: [0.0, -depth(t)], on="top"),
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
    mesh = small(family, 4, box=((0, 2), (0, H)))
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
@mostly_long("start", ["settled", None])
def test_an_obstacle_that_overlaps_presses_the_body_back(family, stiffness, start):
    """Uniaxial strain (interference - yield) / H, from the start or with a gap that falls."""
    H, share = 0.5, 1.0 if start == "settled" else TIMES / TIMES[-1]
    gap = -0.01 if start == "settled" else lambda x, t: np.full(len(x), -0.01 * t / TIMES[-1])
    touch = vx.UnilateralContact("bottom", gap) if stiffness is None else vx.NormalCompliance(stiffness, "bottom", gap)
    mesh = small(family, 2, box=((0, 2), (0, H)))
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
@mostly_long("amount", [1e-6, 1e-8, 3e-9, 1e-9, 3e-10, 1e-11, 1e-13, 1e-15], 0, 3, 6)
@mostly_long("D, lam", [(np.eye(2)[0], 0.0), (np.array([1.0, 0.5]), 0.2)], "two", ids=["one unknown", "two"])
def test_limits_that_all_but_meet_are_met_or_named(D, lam, amount, solver):
    """D y <= 1 and D y >= 1 + amount, beside limits that meet: named, or answered within the amount."""
    K, load = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([5.0, 0.0])
    limits = vx.Limits(np.array([D, -D, [0.0, 1.0], [0.0, -1.0]]), [1.0, -1.0 - amount, lam, -lam])
    system = vx.System(K, lambda t: t * load, limits=limits)
    named = rf"at limit 0 and limit 1, which contradict each other by {amount:.1g}\."
    with pytest.raises(vx.SceneError, match=named) if amount > 1e-9 else suppress(vx.SceneError):
        found = vx.march(system, [0.0, 1.0], solver=solver, initial="settled")
        assert np.abs(found.state @ limits.D.T - limits.e).max() <= 2e-9


@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel(), vx.OSQP()], ids=lambda s: s.name)
@mostly_long("far", [1e8, 1e20, np.inf], 1, 2)
@mostly_long("compliance", [0.0, 0.1])
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
