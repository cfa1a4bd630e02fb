"""Scenes that were once refused or answered wrongly, compared with closed forms and exact answers."""

import numpy as np
import pytest
from own_law import Law
from scenes import mostly_long

import vemcvx as vx


@pytest.mark.long
@pytest.mark.parametrize("ratio", [1.0, 1e6])
def test_three_layers_of_any_stiffness_are_pressed_like_springs_in_series(ratio):
    """The layers lie between clamped sides. The interferences add up to 2e-3."""

    def layer(low):
        return vx.meshes.squares(3, box=((0, 3), (low, low + 1)))

    stiffness = {"lo": 1000.0, "mid": 1000.0 * ratio, "up": 1000.0}
    between = ["lo|mid", "mid|up"]
    scene = vx.Scene(
        *(vx.Elasticity(young, 0.0, on=name) for name, young in stiffness.items()),
        vx.Clamp(on=["lo.bottom", "up.top"]),
        vx.UnilateralContact(on=between, gap=-1e-3),
        vx.CoulombFriction(0.3, on=between),
    )
    mesh = vx.meshes.bodies({name: layer(k) for k, name in enumerate(stiffness)})
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    exact = 2e-3 / sum(1 / young for young in stiffness.values())
    assert np.abs(history.contact.pressure - exact).max() < 1e-7 * exact
    assert np.abs(history.contact.traction).max() < 1e-7 * exact
    # `certified` also contains rounding, which grows with the ratio of the stiffnesses.
    assert history.certificate.max() <= 1e-8


def solve_by_enumeration(seed, c):
    """Return K, g and the answer y of a step with the weights 0.4 + c |slip|."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, 6))
    K, g = A @ A.T + np.eye(6), 10 * rng.normal(size=6)
    for trits in range(3**6):
        sign = np.array([trits // 3**i % 3 - 1.0 for i in range(6)])
        slips, y = sign != 0, np.zeros(6)
        y[slips] = np.linalg.solve((K + c * np.eye(6))[np.ix_(slips, slips)], (g - 0.4 * sign)[slips])
        if (y * sign >= 0).all() and (np.abs((g - K @ y)[~slips]) <= 0.4).all():
            return K, g, y
    raise AssertionError("no sets satisfy the law")


@pytest.mark.parametrize("c", [1.0, 1e4])
@mostly_long("seed", range(4))
def test_friction_that_grows_with_slip_has_one_answer(seed, c):
    K, g, exact = solve_by_enumeration(seed, c)
    law = vx.Law(lambda t, p, past, slip: 0.4 + c * slip)
    run = vx.march(vx.System(K, lambda t: t * g, norms=vx.Norms(np.eye(6), 0.4, law=law)), [0.0, 1.0])
    error = run.state[-1] - exact
    assert np.sqrt(error @ K @ error) <= 1e-8 * np.sqrt(exact @ K @ exact)
    assert run.certified.max() <= 1e-8


@pytest.mark.filterwarnings("ignore:.*weights may fall faster with slip")
@pytest.mark.parametrize("springs", [0.005, 0.05])
def test_friction_that_weakens_fast_is_answered_accurately(springs):
    """Clarabel answers steps in which Newton's method stops at relative errors above 1e-8."""
    peak, softening = 2e-3, 0.1
    scene = vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.ElasticFoundation(springs, springs, on="top"),
        vx.Traction(lambda x, t: 6e-3 * t * np.column_stack([1 + x[:, 1], 0 * x[:, 0]]), on="left"),
        vx.BilateralContact(on="bottom"),
        Law(lambda t, p, past, slip: np.maximum(peak - softening * (past + slip), peak / 3), softening),
    )
    history = vx.simulate(scene, vx.meshes.squares(3), np.linspace(0, 1, 5))
    assert history.trajectory.certified.max() <= 1e-8
