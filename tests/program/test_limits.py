"""One-sided limits in closed form."""

from contextlib import suppress

import numpy as np
import pytest
from scenes import mostly_long, small

import vemcvx as vx

pytestmark = pytest.mark.arithmetic

YOUNG, POISSON = 10.0, 0.25
MU = YOUNG / (2 * (1 + POISSON))
OEDOMETER = 2 * MU * POISSON / (1 - 2 * POISSON) + 2 * MU
TIMES = np.linspace(0.0, 3.0, 13)
HEIGHT = 0.5


def test_a_wall_and_a_buffer_stop_two_springs():
    """A wall at 0.3 stops the first unknown. At 0.2, the second unknown meets a buffer of compliance 0.5."""
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


def lower_block(depth, gap, stiffness=None, n=4, **options):
    """Lower a block between rollers onto an obstacle."""
    touch = vx.UnilateralContact("bottom", gap) if stiffness is None else vx.NormalCompliance(stiffness, "bottom", gap)
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(lambda x, t: [0.0, -depth(t)], on="top"),
        vx.PrescribedDisplacement(0.0, on=["left", "right"], direction="normal"),
        touch,
    )
    return vx.simulate(scene, small("voronoi", n, box=((0, 2), (0, HEIGHT))), TIMES, **options)


@pytest.mark.parametrize("stiffness", [None, 400.0])
@mostly_long("solver", [vx.Newton(), vx.Clarabel(), vx.OSQP()], ids=lambda s: s.name)
def test_contact_closes_and_opens_in_closed_form(stiffness, solver):
    """Once the gap is closed, the strain is (depth - gap - compression of the obstacle) / HEIGHT."""
    gap = 0.01

    def depth(t):
        return 0.05 * np.interp(t, [0, 1, 2, 3], [0, 1, 0, 0.6])

    history = lower_block(depth, gap, stiffness, solver=solver)
    give = 0.0 if stiffness is None else OEDOMETER / stiffness / HEIGHT
    strain = np.maximum(depth(TIMES) - gap, 0.0) / HEIGHT / (1 + give)
    # Only the energy error is certified. Pressures and displacements may have larger errors.
    tolerance = 1e-9 if solver.name == "Newton" else 1e-4
    pressure = OEDOMETER * strain
    assert np.abs(history.contact.pressure - pressure[:, None]).max() < tolerance * pressure.max()
    exact = -depth(TIMES)[:, None] + strain[:, None] * (HEIGHT - history.mesh.points[:, 1])
    assert np.abs(history.displacement[:, :, 1] - exact).max() < tolerance * 0.05
    assert np.abs(history.displacement[:, :, 0]).max() < tolerance * 0.05
    stored = 0.0 if stiffness is None else 0.5 * pressure**2 / stiffness * 2.0
    assert history.energy == pytest.approx(0.5 * OEDOMETER * strain**2 * 2.0 * HEIGHT + stored, abs=tolerance * 1e-2)
    assert (np.diff(history.work - history.energy) >= -1e-12 * history.work.max()).all()


@pytest.mark.parametrize("stiffness", [None, 400.0])
@pytest.mark.parametrize("start", ["settled", None])
def test_an_overlapping_obstacle_presses_the_body_back(stiffness, start):
    """The strain is (overlap - compression of the obstacle) / HEIGHT."""
    share = 1.0 if start == "settled" else TIMES / TIMES[-1]
    gap = -0.01 if start == "settled" else lambda x, t: np.full(len(x), -0.01 * t / TIMES[-1])
    history = lower_block(lambda t: 0.0, gap, stiffness, n=2, initial=start)
    give = 0.0 if stiffness is None else OEDOMETER / stiffness / HEIGHT
    pressure = OEDOMETER * share * np.full(len(TIMES), 0.01 / HEIGHT / (1 + give))
    assert np.abs(history.contact.pressure - pressure[:, None]).max() < 1e-12 * pressure.max()
    stored = pressure**2 / OEDOMETER * HEIGHT * (1 + give)
    assert history.energy == pytest.approx(stored, rel=1e-11)
    if start is None:
        # Twelve equal steps of backward Euler lose a twelfth of the energy.
        assert history.work[-1] - history.energy[-1] == pytest.approx(stored[-1] / (len(TIMES) - 1), rel=1e-9)


@pytest.mark.parametrize("initial", [None, "equilibrium"])
def test_a_body_inside_its_obstacle_is_refused_unless_it_is_settled(initial):
    with pytest.raises(vx.SceneError, match=r"^initial: the state at t = 0 is not in equilibrium .*'settled'"):
        lower_block(lambda t: 0.0, lambda x, t: -0.01 - 0.02 * x[:, 0], initial=initial)


@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()])
@mostly_long("amount", [1e-6, 3e-9, 1e-9, 3e-10, 1e-13], 0, 2, 4)
@mostly_long("D, lam", [(np.eye(2)[0], 0.0), (np.array([1.0, 0.5]), 0.2)], "two", ids=["one unknown", "two"])
def test_contradicting_limits_are_named_or_met_within_the_contradiction(D, lam, amount, solver):
    """The limits D y <= 1 and D y >= 1 + amount contradict each other. Two further limits fix y_1 at `lam`."""
    K, load = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([5.0, 0.0])
    limits = vx.Limits(np.array([D, -D, [0.0, 1.0], [0.0, -1.0]]), [1.0, -1.0 - amount, lam, -lam])
    system = vx.System(K, lambda t: t * load, limits=limits)
    message = rf"at limit 0 and limit 1: they contradict each other by {amount:.1g}\. Enlarge a gap"
    with pytest.raises(vx.SceneError, match=message) if amount > 1e-9 else suppress(vx.SceneError):
        found = vx.march(system, [0.0, 1.0], solver=solver, initial="settled")
        assert np.abs(found.state @ limits.D.T - limits.e).max() <= 2e-9
