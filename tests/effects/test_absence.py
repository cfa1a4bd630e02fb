"""Effects that are absent, or that change nothing, cost nothing and leave every bit of an answer as it is."""

import logging

import numpy as np
import pytest
from identical import same
from scenes import mostly_long
from test_conformance_effects import HELD, PULLED, RUBBING, STEEL, TOUCHING

import vemcvx as vx
from vemcvx.linear import superlu
from vemcvx.program.condensation import MOST_SHAPES
from vemcvx.scene import pose_scene
from vemcvx.testing.effects import TIMES, mesh


def zero(x, t):
    return np.zeros(len(x))


SUPPORTED = (STEEL, HELD, PULLED, TOUCHING, RUBBING)
TOUCHED = (*SUPPORTED, vx.UnilateralContact(on="left"))
VOID = {
    "Traction": (vx.Traction((0.0, 0.0), on="left"), SUPPORTED, "Traction on left: its force is zero"),
    "Pressure": (vx.Pressure(zero, on="left"), SUPPORTED, "Pressure on left: its force is zero"),
    "BodyForce": (vx.BodyForce((0.0, 0.0)), SUPPORTED, "BodyForce: its force is zero"),
    "PointLoad": (vx.PointLoad((0.0, 0.0), at=(0.0, 1.0)), SUPPORTED, "its force is zero"),
    "ThermalStrain": (vx.ThermalStrain(expansion=1e-5, temperature=zero), SUPPORTED, "its strain is zero"),
    "Prestress": (vx.Prestress((0.0, 0.0, 0.0)), SUPPORTED, "its stress is zero"),
    "ElasticFoundation": (vx.ElasticFoundation(0.0, 0.0, on="left"), SUPPORTED, "ElasticFoundation: its stiffness is"),
    "Viscosity": (vx.Viscosity(shear=0.0), SUPPORTED, "Viscosity: its viscosity is zero"),
    "Tresca": (vx.TrescaFriction(zero, on="bottom"), SUPPORTED[:-1], "TrescaFriction on bottom: its bound is zero"),
    "Coulomb": (vx.CoulombFriction(0.0, on="left"), TOUCHED, "CoulombFriction on left: its bound is zero"),
    "capped": (vx.CoulombFriction(0.3, on="left", cap=0.0), TOUCHED, "CoulombFriction on left: its bound is zero"),
    "Unilateral": (
        vx.UnilateralContact(on="right"),
        SUPPORTED,
        "UnilateralContact on right: other effects hold all its nodes",
    ),
    "Compliance": (
        vx.NormalCompliance(3.0, on="right"),
        SUPPORTED,
        "Compliance on right: other effects hold all its nodes",
    ),
    "Tresca, held": (
        vx.TrescaFriction(3.0, on="right"),
        SUPPORTED,
        "TrescaFriction on right: other effects hold all its nodes",
    ),
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


@pytest.fixture
def counted(monkeypatch):
    """Count factorisations and back-substitutions."""
    counts = {"factorised": 0, "solved": 0}

    class Counting(superlu.SuperLUFactor):
        def __init__(self, *args):
            counts["factorised"] += 1
            super().__init__(*args)

        def solve(self, b):
            counts["solved"] += bool(b.any())
            return super().solve(b)

    monkeypatch.setattr(superlu, "SuperLUFactor", Counting)
    return counts


def turning(x, t):
    return np.column_stack([np.cos(9 * t * (1 + x[:, 1])), np.sin(7 * t * x[:, 1])])


BESIDE = 1
"""Number of solves of a run besides its steps: one solve estimates rounding errors."""


@pytest.mark.long
def test_linear_scenes_cost_few_solves_for_any_number_of_steps(counted):
    """Each of two loads is a function of time times a fixed field, so that a few solves serve any number of steps."""
    scene = vx.Scene(STEEL, HELD, PULLED, vx.BodyForce(lambda x, t: np.full((len(x), 2), np.sin(t))))
    for steps in (4, 32, 256):
        counted.update(factorised=0, solved=0)
        vx.simulate(scene, mesh("voronoi", 6), np.linspace(0, 1, steps + 1), store="last")
        assert counted["factorised"] == 1
        assert 1 <= counted["solved"] - BESIDE <= MOST_SHAPES


@mostly_long("steps", [8, 32])
def test_scenes_without_friction_cost_one_solve_per_step(steps, counted):
    """The load has a new shape in every step; its shape at the start needs one more solve."""
    scene = vx.Scene(STEEL, HELD, TOUCHING, vx.Traction(turning, on="left"))
    vx.simulate(scene, mesh("voronoi", 6), np.linspace(0, 1, steps + 1), initial="equilibrium", store="last")
    assert counted == {"factorised": 1, "solved": BESIDE + 1 + steps}
