"""Friction with a given bound, on boundaries with one-sided contact."""

import warnings

import numpy as np
import pytest

import vemcvx as vx

TIMES = np.linspace(0.0, 1.0, 9)
BOUND = 2.0
STEEP = 1e6
"""Largest ratio of friction to pressure."""


def lifted(while_closed=None, lift=5.0):
    """Return the scene of a clamped block that is pressed, then lifted and dragged at the free end."""

    return vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: [40.0 * t, lift * t], on="left"),
        vx.Pressure(8.0, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.TrescaFriction(BOUND, on="bottom", while_closed=while_closed),
    )


def run(*args, **more):
    return vx.simulate(lifted(*args), vx.meshes.squares(6), TIMES, initial="settled", **more)


@pytest.mark.long
def test_friction_at_open_nodes_causes_one_warning():
    with pytest.warns(vx.SceneWarning, match=r"^TrescaFriction on bottom: \d+% of all friction work") as said:
        rubbed = run()
    assert len(said) == 1
    assert rubbed.contact.open_count[-1] > 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        meant = run(False)
        run(None, -5.0)
    assert np.array_equal(meant.displacement, rubbed.displacement)


@pytest.mark.long
def test_friction_while_closed_needs_pressure():
    """Open nodes have no friction. Closed nodes obey Tresca's law."""
    history = run(True)
    contact = history.contact
    # Under small pressures, friction is proportional to the pressure.
    bound = np.minimum(STEEP * np.maximum(contact.pressure, 0.0), BOUND)
    force = np.abs(contact.traction[..., 0])
    assert (force <= bound * (1 + 1e-9) + 1e-12).all()
    slips = ~contact.sticking & (bound > 0)
    assert force[slips] == pytest.approx(bound[slips], rel=1e-9)
    for some in (slips & (bound == BOUND), contact.pressure[-1] < 1e-9, contact.pressure[-1] > 1e-3):
        assert some.any()
    assert history.certificate_kind == "for the given friction"
    assert history.certificate.max() <= vx.Newton().accuracy
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vx.SceneWarning)
        assert history.dissipated[-1] < 0.9 * run().dissipated[-1]


def test_a_node_that_friction_would_open_slides_at_zero_pressure():
    """Friction w reduces the pressure to .45 - .9 w. Sticking needs w = 1, but the pressure is zero at w = 1/2."""

    def weights(t, p, past, slip):
        return np.minimum(STEEP * p, 2.0)

    def slope(t, p, past):
        return np.diag(np.where(STEEP * p < 2.0, STEEP, 0.0))

    norms = vx.Norms([[1.0, 0.0]], 0.0, law=vx.Law(weights, slope=slope, slips=False))
    system = vx.System([[1.0, -0.9], [-0.9, 1.0]], lambda t: [t, -0.45 * t], norms, limits=vx.Limits([[0.0, 1.0]], 0.0))
    trajectory = vx.march(system, [0.0, 1.0])
    assert trajectory.state[-1] == pytest.approx([0.5, 0.0], abs=1 / STEEP)
    assert trajectory.weights[-1] == pytest.approx([0.5], abs=1 / STEEP)
    assert 0 < trajectory.pressures[-1, 0] < 1 / STEEP
    assert trajectory.certificate.max() <= 1e-8
