"""The problems with bodies of revolution, compared with closed forms. Forces balance over the whole circumference."""

from __future__ import annotations

import numpy as np
import pytest

import gallery
import seal_ring as seal
import sleeve_pushed_off as sleeve
import sphere_on_half_space as sphere
import vemcvx as vx


@pytest.mark.parametrize("n", [16, pytest.param(32, marks=pytest.mark.long)])
@pytest.mark.parametrize("family", ["squares", pytest.param("voronoi", marks=pytest.mark.long)])
def test_a_sphere_has_the_contact_of_hertz(family, n):
    """Contact radius and peak pressure agree with Hertz within 1 %, and stresses on the axis within 1 % of the peak."""
    history = vx.simulate(sphere.scene(), sphere.mesh(n, family), sphere.times(1))
    P = sphere.force(history)[-1]
    (a, peak), found = sphere.hertz(P), sphere.measure_contact(history)
    assert found == pytest.approx([a, peak], rel=0.01)
    assert history.force(vx.Clamp)[-1, 1] == pytest.approx(P, rel=1e-9)
    assert "reaction of sole" not in history.resultants  # The axis is no support.
    if family == "squares":
        depth, stress = sphere.stresses_near_axis(history)
        axial, radial = sphere.stresses_on_axis(depth, P)
        assert stress == pytest.approx(np.column_stack([axial, radial, radial]), abs=0.01 * peak)


@pytest.mark.parametrize("poisson", [sleeve.POISSON, pytest.param((0.0, 0.0), marks=pytest.mark.long)])
def test_a_sleeve_is_pushed_off_by_the_force_of_its_joint(poisson):
    """Lame's pressure and the push-out force have errors below .2 %."""
    history = vx.simulate(sleeve.scene(poisson), sleeve.mesh(4), sleeve.times(13))
    contact, (pressure, force, length) = history.contact, sleeve.evaluate_closed_form(poisson)
    assert contact.pressure[1] @ contact.lengths == pytest.approx(pressure * contact.lengths.sum(), rel=2e-3)
    assert contact.lengths.sum() == pytest.approx(2 * np.pi * sleeve.RADII[1] * sleeve.LENGTH, rel=1e-12)
    assert sleeve.push_force(history)[-2:] == pytest.approx(force, rel=2e-3)
    z, wall = contact.points[:, 1], sleeve.RADII[2] - sleeve.RADII[0]
    inside = (z > wall) & (z < sleeve.LENGTH - wall)
    exact = pressure * np.exp((z - sleeve.LENGTH) / length)
    assert contact.pressure_recovered[-1][inside] == pytest.approx(exact[inside], rel=0.01)


@pytest.mark.parametrize("friction", [0.0, pytest.param(seal.FRICTION, marks=pytest.mark.long)])
def test_a_seal_ring_presses_harder_than_the_fluid(friction):
    """With friction, the excess of wall pressure over fluid pressure is at least 80 % of the closed form."""
    with gallery.quiet():
        history = vx.simulate(seal.scene(friction), seal.mesh(8), seal.times(4), initial="settled")
    q, area = seal.SEALED * history.times, np.pi * (seal.RADII[1] ** 2 - seal.RADII[0] ** 2)
    walls = sum(history.force(wall)[:, 1] for wall in ("left", "right", "top"))
    assert walls == pytest.approx(-q * area, abs=1e-10 * seal.SEALED * area)
    for wall, r in enumerate(seal.RADII):
        found = np.array([seal.wall_pressure(history, wall, step)[1] for step in range(len(q))])
        exact = seal.pressure(r, q)[:, None]
        assert friction or found == pytest.approx(np.broadcast_to(exact, found.shape), rel=1e-4)
        assert (found - q[:, None] > 0.8 * (exact - q[:, None])).all()
