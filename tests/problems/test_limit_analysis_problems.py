"""The problem of limit loads, against its closed forms and beside simulations."""

from __future__ import annotations

import numpy as np
import pytest

import gallery
import limit_load
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
        below = vx.simulate(limit_load.scene(0.999 * found.factor), mesh, times)
        with pytest.raises(vx.SceneError, match="friction resists with at most .* there is no equilibrium"):
            vx.simulate(limit_load.scene(1.001 * found.factor), mesh, times)
    assert below.certified.max() < 1e-8
    contact = below.contact
    exact, centre = limit_load.turning(contact.points[:, :2], limit_load.BOUND * contact.friction_lengths)
    assert found.factor == pytest.approx(exact, rel=1e-8)
    assert found.upper == pytest.approx(exact, rel=1e-8)
    # The motion vanishes at the centre. The minimum is flat: its place is known to the root of the accuracy.
    assert found.motion[contact.nodes, 1] == pytest.approx(
        (contact.points[:, 0] - centre) / (limit_load.LENGTH / 2 - centre), abs=1e-4
    )


def test_limits_of_meshes_approach_the_integral_over_the_plate():
    exact, _ = limit_load.plate_limit()
    away = [limit_load.find_plate_limit(limit_load.mesh(n)).factor / exact - 1.0 for n in (2, 4, 8)]
    assert np.diff(np.abs(away)).max() < 0
    assert abs(away[-1]) < 0.004
