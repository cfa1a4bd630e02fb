"""Pictures name what they leave out: stresses beyond the colour bar, open contact, missing friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.plots import (
    deformed_mesh,
    friction_traction,
    stressed_body,
)
from vemcvx.plots.pictures import draw_pictures

pytest.importorskip("matplotlib")
BODY = vx.Elasticity(200.0, 0.3)


def press(gap=0.0):
    """Press a block on another block, with a gap that grows to the right."""
    blocks = {name: vx.meshes.squares(6, box=((0, 1), (y, y + 1))) for name, y in (("lower", 0.0), ("upper", 1.0))}
    down = vx.PrescribedDisplacement(lambda x, t: np.tile([0.0, -0.02 * t], (len(x), 1)), on="upper.top")
    touch = vx.UnilateralContact(on="lower|upper", gap=lambda x, t: gap * x[:, 0] ** 2)
    scene = vx.Scene(BODY, vx.Clamp(on="lower.bottom"), down, touch)
    return vx.simulate(scene, vx.meshes.bodies(blocks), [0.0, 0.5, 1.0])


@pytest.fixture(scope="module")
def closed():
    return press()


@pytest.fixture(scope="module")
def opened():
    return press(gap=0.05)


@pytest.fixture(scope="module")
def stuck():
    """A sheared block whose friction stays far below its bound."""
    pull = vx.Traction(lambda x, t: np.tile([0.1 * t, 0.0], (len(x), 1)), on="left")
    sides = vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound=1000.0, on="bottom")
    return vx.simulate(vx.Scene(BODY, vx.Clamp(on="right"), pull, *sides), vx.meshes.squares(6), [0.0, 0.5, 1.0])


def test_a_colour_bar_that_ends_below_the_largest_stress_is_pointed(stuck):
    """The colour bar ends at the 99 % quantile for stresses, and at the maximum for displacements."""
    stress = stressed_body(stuck, stress="von_mises").axes[0].collections[0].colorbar
    assert stress.vmax < stuck.von_mises(-1).max()
    assert stress.extend == "max"
    assert deformed_mesh(stuck).axes[0].collections[0].colorbar.extend == "neither"


def test_contact_without_friction_has_no_picture_of_friction(opened, stuck):
    assert "friction_traction" not in draw_pictures(opened, None)
    assert "there is no friction" in friction_traction(opened).axes[0].get_title()
    assert "friction_traction" in draw_pictures(stuck, None)


def test_the_title_states_the_force_at_which_arrows_are_cut(closed):
    contact = closed.contact
    assert "arrows cut at" not in stressed_body(closed).axes[0].get_title()
    peaked = contact.pressure * np.where(contact.nodes % 7, 1, 100.0)
    axes = stressed_body(replace(closed, contact=replace(contact, pressure=peaked))).axes[0]
    assert "arrows cut at" in axes.get_title()
    assert [line.get_label() for line in axes.lines if line.get_marker() == "$\\rightarrow$"] == ["contact force"]
