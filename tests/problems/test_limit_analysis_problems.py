"""The problems of limit loads and shakedown, compared with closed forms and with simulations."""

from __future__ import annotations

import numpy as np
import pytest

import gallery
import limit_load
import shakedown
import vemcvx as vx


@pytest.mark.parametrize("height", [0.4, 2.4, 2.6, 4.0])
def test_a_footing_slides_or_tips(height):
    found = vx.limit_load(*limit_load.footing(3, height))
    assert found.factor == pytest.approx(limit_load.footing_limit(height), rel=1e-8)
    assert found.upper == pytest.approx(limit_load.footing_limit(height), rel=1e-8)
    assert ("rotation" in found.mechanism) == (height > 2.5)


def test_a_block_slides_up_its_incline():
    """The motion of the mechanism is steeper than the incline by the friction angle."""
    found = vx.limit_load(*limit_load.incline(3))
    assert found.factor / limit_load.WEIGHT == pytest.approx(limit_load.incline_limit(), rel=1e-8)
    rise = found.motion[:, 1] / found.motion[:, 0]
    assert np.arctan(rise) == pytest.approx(np.arctan(limit_load.SLOPE) + np.arctan(limit_load.FRICTION), abs=1e-9)


@pytest.mark.parametrize("n", [2, pytest.param(5, marks=pytest.mark.long)])
def test_the_mechanism_of_a_plate_is_a_turn_and_steps_find_equilibrium_only_below_the_limit(n):
    mesh, times = limit_load.mesh(n), [0.0, 0.5, 1.0]
    found = limit_load.find_plate_limit(mesh)
    with gallery.quiet():
        # Close to the limit almost all nodes slip. On some processors rounding errors then exceed 1e-8.
        below = vx.simulate(limit_load.scene(0.999 * found.factor), mesh, times, solver=vx.Newton(accuracy=1e-6))
        with pytest.raises(vx.SceneError, match="friction resists with at most .* there is no equilibrium"):
            vx.simulate(limit_load.scene(1.001 * found.factor), mesh, times)
    assert below.certified.max() <= 1e-6
    contact = below.contact
    exact, centre = limit_load.turning(contact.points[:, :2], limit_load.BOUND * contact.friction_lengths)
    assert found.factor == pytest.approx(exact, rel=1e-8)
    assert found.upper == pytest.approx(exact, rel=1e-8)
    # The motion vanishes at the centre c, which minimises the load. If the load has an error e, c moves by O(sqrt(e)).
    assert found.motion[contact.nodes, 1] == pytest.approx(
        (contact.points[:, 0] - centre) / (limit_load.LENGTH / 2 - centre), abs=1e-4
    )


def test_melan_and_koiter_meet_at_the_closed_forms():
    for scene, mesh, times, exact in (
        (shakedown.scene(1.0), shakedown.mesh(3), shakedown.CYCLE, shakedown.shear_factor()),
        (shakedown.free_scene(), shakedown.mesh(3, "hanging"), shakedown.CYCLE, shakedown.free_factor()),
        (shakedown.circle_scene(), shakedown.space_mesh(2), np.arange(12) / 12, shakedown.circle_factor()),
    ):
        found = vx.shakedown(scene, mesh, times)
        assert found.factor == pytest.approx(exact, rel=1e-8)
        assert found.upper == pytest.approx(exact, rel=1e-8)


def test_in_100_cycles_slip_stops_below_the_factor_and_goes_on_above():
    mesh, times, factor = shakedown.mesh(3), shakedown.times(200), shakedown.shear_factor()
    below, above = (
        shakedown.measure_friction_work(vx.simulate(shakedown.scene(part * factor), mesh, times, store="last"))
        for part in (0.98, 1.02)
    )
    assert len(below) == 100
    # Only the first cycle slips. The work of later cycles is a rounding error.
    assert below[0] > 1e-4
    assert below[1:].max() < 1e-10 * below[0]
    assert above[50:] == pytest.approx(above[-1], rel=1e-6)
    assert above[-1] > 1e-4 * above[0]
