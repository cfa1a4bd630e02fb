"""Pictures say what they leave out: gaps, stresses beyond a bar, open contact, friction that is not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.plots import (
    along_contact,
    deformed_mesh,
    energy_ledger,
    friction_traction,
    hysteresis_loop,
    stick_slip_map,
    stressed_body,
)
from vemcvx.plots.body import NO_GAPS
from vemcvx.plots.pictures import draw_pictures

pytest.importorskip("matplotlib")
PASCAL = {"length": "m", "force per area": "Pa"}
BODY = vx.Elasticity(200.0, 0.3)


def pressed(gap=0.0, friction=()):
    """Two blocks, the upper one pressed on the lower, a gap between them that grows to the right."""
    blocks = {name: vx.meshes.squares(6, box=((0, 1), (y, y + 1))) for name, y in (("lower", 0.0), ("upper", 1.0))}
    down = vx.PrescribedDisplacement(lambda x, t: np.tile([0.0, -0.02 * t], (len(x), 1)), on="upper.top")
    touch = vx.UnilateralContact(on="lower|upper", gap=lambda x, t: gap * x[:, 0] ** 2)
    scene = vx.Scene(BODY, vx.Clamp(on="lower.bottom"), down, touch, *friction)
    return vx.simulate(scene, vx.meshes.bodies(blocks), [0.0, 0.5, 1.0])


@pytest.fixture(scope="module")
def opened():
    return pressed(gap=0.05)


@pytest.fixture(scope="module")
def held():
    """A sheared block whose friction, far below its bound, lets it slip nowhere."""
    pull = vx.Traction(lambda x, t: np.tile([0.1 * t, 0.0], (len(x), 1)), on="left")
    sides = vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound=1000.0, on="bottom")
    return vx.simulate(vx.Scene(BODY, vx.Clamp(on="right"), pull, *sides), vx.meshes.squares(6), [0.0, 0.5, 1.0])


def labels(figure):
    return [
        text.get_text() for legend in (*figure.legends, figure.axes[0].get_legend()) if legend for text in legend.texts
    ]


@pytest.mark.long
@pytest.mark.parametrize("draw", [deformed_mesh, stressed_body])
def test_gaps_that_are_not_drawn_are_told(opened, draw):
    """Magnified, one body is drawn in the other where contact is open; without a gap there is nothing to tell."""
    assert not opened.contact.closed[-1].all()
    assert NO_GAPS in draw(opened).axes[0].get_title()
    assert NO_GAPS not in draw(opened, 0).axes[0].get_title()
    assert NO_GAPS not in draw(pressed()).axes[0].get_title()


@pytest.mark.long
def test_a_bar_that_ends_below_the_largest_stress_is_pointed(held):
    """It ends where all cells but one in a hundred are; with limits beyond all it is flat."""

    def bar(**how):
        return stressed_body(held, stress="von_mises", **how).axes[0].collections[0].colorbar

    largest = held.von_mises(-1).max()
    assert bar().vmax < largest
    assert bar().extend == "max"
    assert bar(limits=(0.0, 2 * largest)).extend == "neither"
    assert bar(limits=(0.5 * largest, 2 * largest)).extend == "min"


def test_open_contact_has_a_name_in_the_map(opened, held):
    assert "open" in labels(stick_slip_map(opened))
    assert "open" not in labels(stick_slip_map(held))


@pytest.mark.long
def test_friction_that_is_not_there_has_no_picture(opened, held):
    assert "friction_traction" not in draw_pictures(opened, None)
    assert "there is no friction" in friction_traction(opened).axes[0].get_title()
    assert "friction_traction" in draw_pictures(held, None)


def test_friction_far_within_its_bound_is_seen(held):
    figure = friction_traction(held, units=PASCAL)
    (low, high), friction = figure.axes[0].get_ylim(), np.abs(held.contact.traction).max()
    assert -low == high == pytest.approx(1.2 * friction)
    assert "bound $\\pm g$ off the axis, 1e+03 Pa" in labels(figure)
    assert "bound $\\pm g$" in labels(friction_traction(held, limits=(-2000, 2000)))


@pytest.mark.long
def test_slip_that_is_rounding_is_drawn_as_none(held):
    """As between bodies, where the difference of two displacements has their rounding."""
    noise = 1e-16 * np.abs(held.displacement).max() * np.random.default_rng(0).normal(size=held.contact.slip.shape)
    noisy = replace(held, contact=replace(held.contact, slip=noise))
    assert "contact_slip" not in draw_pictures(noisy, None)
    assert all((line.get_ydata() == 0).all() for line in along_contact(noisy, "slip").axes[0].lines)


def test_energies_have_a_unit_where_stresses_have_one(opened):
    assert energy_ledger(opened, units=PASCAL).axes[0].get_ylabel() == "energy (Pa m³), per thickness"
    assert "reaction (Pa m²)" in hysteresis_loop(opened, units=PASCAL).axes[0].get_ylabel()


def test_arrows_at_a_corner_are_cut_and_have_a_legend():
    history = pressed()
    contact = history.contact
    assert "arrows cut at" not in stressed_body(history).axes[0].get_title()
    sharp = replace(
        history, contact=replace(contact, pressure=contact.pressure * np.where(contact.nodes % 7, 1, 100.0))
    )
    axes = stressed_body(sharp).axes[0]
    assert "arrows cut at" in axes.get_title()
    assert [line.get_label() for line in axes.lines if line.get_marker() == "$\\rightarrow$"] == ["contact force"]
