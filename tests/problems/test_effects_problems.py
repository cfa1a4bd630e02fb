"""Heated bodies and a bent wooden strip agree with closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import bimetallic_strip as strip
import thermal_expansion_blocked_by_friction as bar
import vemcvx as vx


@pytest.mark.long
def test_a_heated_bar_expands_from_its_ends_and_comes_half_way_back():
    """Rod theory has the error O(height / slip length), .31 % in the motion and .5 % in the work."""
    history = vx.simulate(bar.scene(), bar.mesh(4), bar.times(24))
    mesh = history.mesh
    end = history.displacement[:, mesh.points[:, 0] == bar.LENGTH, 0].mean(axis=1)
    assert end[[8, 16, 24]] == pytest.approx(bar.end_displacement(), rel=0.005)
    # The end of the bar is at the same place after both heatings.
    assert end[24] == pytest.approx(end[8], rel=1e-9)
    assert history.dissipated[8] == pytest.approx(bar.first_dissipation(), rel=0.01)
    locked = mesh.centroids[:, 0] < bar.LENGTH - bar.slip_length() - 2 * bar.HEIGHT
    blocked = bar.YOUNG * bar.EXPANSION * bar.RISE
    assert np.abs(history.stress(8)[locked] - [-blocked, 0.0, 0.0]).max() < 0.005 * blocked
    assert history.certificate.max() < 1e-8


def deflect(n, *grain):
    """Return the deflection of a strip with n squares across the height, and the largest reaction of its rollers."""
    history = vx.simulate(strip.scene(*grain), strip.mesh(n), strip.times(1))
    x, u = history.mesh.points[:, 0], history.displacement[-1, :, 1]
    return u[x == strip.LENGTH].mean() - u[x == 0].mean(), np.abs(history.reaction("left")[-1]).max()


@pytest.mark.long
def test_a_bimetallic_strip_has_timoshenkos_deflection():
    """The error is O(h^2), 2 % for 8 squares across the height and .6 % for 16 squares."""
    found = [deflect(n) for n in (8, 16)]
    coarse, fine = (1 - deflection / strip.deflection() for deflection, _ in found)
    assert 0 < fine < 0.007
    assert 3 < coarse / fine < 4.5
    # The stresses of the strip balance each other, so the rollers bear no force.
    assert max(reaction for _, reaction in found) < 1e-9 * strip.YOUNG[0]


@pytest.mark.long
def test_a_wooden_strip_bends_according_to_its_modulus_along_the_strip():
    """For the grain at 0, .5 and 1.5 rad, the error is .04, 3 and 1 %."""
    for grain, tolerance in {0.0: 0.001, 0.5: 0.04, 1.5: 0.02}.items():
        assert deflect(16, grain)[0] == pytest.approx(strip.deflection(grain), rel=tolerance)
    assert strip.deflection(1.5) < 0.9 * strip.deflection(0.5)
