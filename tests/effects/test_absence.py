"""Effects without influence leave every bit of an answer unchanged."""

import logging

import numpy as np
import pytest
from identical import same
from test_conformance_effects import HELD, PULLED, RUBBING, STEEL, TOUCHING

import vemcvx as vx
from vemcvx.scene import pose_scene
from vemcvx.testing.effects import TIMES, mesh


def zero(x, t):
    return np.zeros(len(x))


SUPPORTED = (STEEL, HELD, PULLED, TOUCHING, RUBBING)
TOUCHED = (*SUPPORTED, vx.UnilateralContact(on="left"))
VOID = {
    "Tresca": (vx.TrescaFriction(zero, on="bottom"), SUPPORTED[:-1], "TrescaFriction on bottom: its bound is zero"),
    "Coulomb": (vx.CoulombFriction(0.0, on="left"), TOUCHED, "CoulombFriction on left: its bound is zero"),
    "capped": (vx.CoulombFriction(0.3, on="left", cap=0.0), TOUCHED, "CoulombFriction on left: its bound is zero"),
}


@pytest.mark.long
@pytest.mark.parametrize(("void", "beside", "says"), VOID.values(), ids=VOID)
def test_void_effects_are_left_out_and_logged(void, beside, says, caplog):
    with caplog.at_level(logging.INFO, "vemcvx"):
        found = vx.simulate(vx.Scene(void, *beside), mesh(), TIMES)
    (inactive,) = [words for words in found.inactive if says in words]
    assert f"left out: {inactive}" in caplog.text
    wanted = vx.simulate(vx.Scene(*beside), mesh(), TIMES)
    assert inactive not in wanted.inactive
    for name in ("state", "multipliers", "pressures", "weights", "energy", "work", "dissipated", "gap", "iterations"):
        assert same(getattr(found.trajectory, name), getattr(wanted.trajectory, name)), name


def test_friction_that_begins_late_is_kept():
    late = vx.TrescaFriction(lambda x, t: max(t - 0.9, 0.0), on="bottom")
    posed = pose_scene(vx.Scene(STEEL, HELD, PULLED, TOUCHING, late), mesh(), TIMES)
    assert posed.inactive == ()
    assert posed.system.norms is not None


def test_effects_are_removed_by_class_and_by_value():
    scene = vx.Scene(STEEL, HELD, PULLED)
    assert scene.without(vx.Clamp, PULLED).effects == (STEEL,)
    assert scene.effects == (STEEL, HELD, PULLED)
