"""Textbook contact: the incline, Hertz, Cattaneo and Mindlin, shear lag, creep, Winkler's beam."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import few_families, mostly_long

import block_on_incline as incline
import cattaneo_mindlin
import hertz_contact as hertz
import kelvin_voigt_creep as creep
import plate_on_springs as winkler
import shear_lag
import vemcvx as vx


@pytest.mark.long
@few_families
@pytest.mark.filterwarnings("ignore:.*one-sided contact holds the body")
@pytest.mark.parametrize("polish", [False, True])
def test_a_block_pushed_uphill(polish, family):
    """On every mesh a block of weight G slips up a slope of angle a at the push F = (tan a + mu) / (1 - mu tan a) G."""
    # With Coulomb's law, each program for Clarabel has a tenth of the target gap. Polishing reaches this gap.
    solver = vx.Clarabel(polish=True) if polish else vx.Newton()
    mesh = incline.mesh(5, family)
    history = vx.simulate(incline.scene(), mesh, incline.times(5), solver=solver, initial="settled")
    ratio = history.reaction("pushed")[:, 0] / incline.WEIGHT
    slides = ~history.contact.sticking.any(axis=1)
    assert slides[-1]
    # The certificate bounds energies; reactions have fewer correct digits.
    assert ratio[slides] == pytest.approx(incline.critical_ratio(), rel=1e-5 if polish else 1e-6)
    assert (np.diff(ratio) > -1e-6).all()
    normal = -(history.force("bottom")[-1] + history.reaction("pushed")[-1])
    assert normal == pytest.approx([0.0, -incline.WEIGHT], abs=1e-4 * incline.WEIGHT)


@pytest.mark.long
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()], ids=lambda s: s.name)
def test_a_cylinder_presses_as_hertz_says(solver):
    """With 12 elements across the half-width, half-width and peak pressure agree with Hertz within two per cent."""
    history = vx.simulate(hertz.scene(), hertz.mesh(12), hertz.times(3), solver=solver)
    contact = history.contact
    P = 2 * history.force("bottom")[-1][1]
    a = np.sqrt(4 * P * hertz.RADIUS * (1 - hertz.POISSON**2) / (np.pi * hertz.YOUNG))
    found = hertz.fit_half_ellipse(contact.points[:, 0], contact.pressure[-1])
    assert found == pytest.approx((a, 2 * P / (np.pi * a)), rel=0.02)
    assert (contact.pressure >= -1e-6 * contact.pressure.max()).all()


@pytest.mark.long
@pytest.mark.parametrize("drag", [1e-4, pytest.param(4e-4, marks=pytest.mark.slow)])
def test_a_dragged_cylinder_sticks_as_cattaneo_and_mindlin_say(drag):
    """The stick half-width is within three per cent of the closed form."""
    history = vx.simulate(cattaneo_mindlin.scene(drag=drag), cattaneo_mindlin.mesh(30), cattaneo_mindlin.times(8))
    Q, P = np.abs(history.force("bottom")[-1])
    a, _ = hertz.fit_half_ellipse(history.contact.points[:, 0], history.contact.pressure[-1])
    stuck, _ = cattaneo_mindlin.stick_half_width(history)
    assert stuck / a == pytest.approx(np.sqrt(1 - Q / (cattaneo_mindlin.FRICTION * P)), rel=0.03)
    assert history.certificate.max() < 1e-8


@pytest.mark.long
def test_a_rod_pushed_released_and_pushed_follows_shear_lag():
    """The error of end displacements is O(height / slip length)."""
    history = vx.simulate(shear_lag.scene(), shear_lag.mesh(4), shear_lag.times(24))
    end = history.mesh.points[:, 0] == 0
    found = history.displacement[[8, 16, 24]][:, end, 0].mean(axis=1)
    expected = shear_lag.end_displacement()
    assert found == pytest.approx(expected, rel=shear_lag.HEIGHT * shear_lag.BOUND / shear_lag.FORCE)
    assert found[2] == pytest.approx(found[0], rel=1e-6)


@pytest.mark.long
def test_a_viscous_bar_creeps_as_kelvin_and_voigt_say():
    """Without friction the closed form is exact."""
    times = creep.times(20)
    free = vx.simulate(creep.scene(bound=0.0), creep.mesh(3), times)
    elastic = creep.PULL * (1 - creep.POISSON**2) / creep.YOUNG * 4.0
    end = free.mesh.points[:, 0] == 4.0
    assert free.displacement[:, end, 0].mean(axis=1) == pytest.approx(
        creep.creep_fraction(times) * elastic, rel=1e-9, abs=1e-15
    )


@pytest.mark.filterwarnings("ignore:.*one-sided contact holds the body")
@mostly_long("asperities", [False, True], 1)
def test_a_beam_on_winklers_foundation(asperities):
    """Deflections are within two per cent of the theory of slender beams. On asperities the ends lift off."""
    # Rounding errors are about 4e-8, because the springs are much softer than the plate.
    solver = vx.Newton(accuracy=1e-6)
    history = vx.simulate(winkler.scene(asperities), winkler.mesh(5), winkler.times(2), solver=solver)
    low = history.mesh.points[:, 1] == 0
    x, w = history.mesh.points[low, 0], -history.displacement[-1][low, 1]
    if not asperities:
        assert w[0] == pytest.approx(winkler.deflection(0.0), rel=0.02)
        assert np.abs(w - winkler.deflection(x)).max() < 0.02 * w.max()
        return
    pressure = history.contact.pressure[-1]
    assert (pressure >= -1e-6).all()
    along = -history.displacement[-1][history.contact.nodes, 1]
    assert pressure == pytest.approx(winkler.SPRINGS * np.maximum(along, 0), abs=1e-6)
    assert (along < 0).any()
    assert -history.force("bottom")[-1, 1] == pytest.approx(-winkler.FORCE / 2, rel=1e-4)
