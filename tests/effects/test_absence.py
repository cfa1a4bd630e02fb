"""Effects that are absent, or that change nothing, cost nothing and leave every bit of an answer as it is."""

import logging

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import mostly_long
from test_conformance_effects import HELD, PULLED, RUBBING, STEEL, TOUCHING

import vemcvx as vx
from vemcvx.linear import superlu
from vemcvx.program.condensation import MOST_SHAPES, Condensation
from vemcvx.scene import pose_scene
from vemcvx.testing.effects import TIMES, mesh


def bits(thing):
    """Return an array, matrix or None as comparable bytes."""
    if thing is None:
        return None
    if sp.issparse(thing):
        whole = sp.csr_matrix(thing, copy=True)
        whole.sort_indices()
        return whole.shape, whole.indptr.tobytes(), whole.indices.tobytes(), whole.data.tobytes()
    return np.shape(thing), np.asarray(thing).tobytes()


def program(posed):
    """Return all data of a run's convex programs as comparable bytes."""
    system, seen = posed.system, Condensation(posed.system)
    norms, limits, damping = system.norms, system.limits, system.damping
    pressed = np.ones(0 if limits is None else limits.D.shape[0])
    return {
        "unknowns": (system.n, len(seen.retained)),
        "terms": (seen.operators.count, seen.operators.block, len(seen.operators.compliance), seen.operators.features),
        "K": bits(system.K),
        "S": bits(seen.operators.K),
        "order": bits(system.elimination_order()),
        "load": [bits(system.load(t)) for t in TIMES],
        "B": None if norms is None else bits(norms.B),
        "w": None if norms is None else [bits(norms.weights_under(t, pressed)) for t in TIMES],
        "D": None if limits is None else (bits(limits.D), bits(limits.compliance)),
        "e": None if limits is None else [bits(system.remaining_gap(t)) for t in TIMES],
        "C": None if damping is None else bits(damping.C),
        "motion": system.motion is None,
        "prestress": posed.prestress is None,
    }


def answers(scene, on=None):
    found = vx.simulate(scene, on or mesh(), TIMES)
    arrays = ("displacement", "forces", "energy", "work", "dissipated", "certificate", "iterations")
    return {name: bits(getattr(found, name)) for name in arrays}


def none(x, t):
    return np.zeros(len(x))


SUPPORTED = (STEEL, HELD, PULLED, TOUCHING, RUBBING)
TOUCHED = (*SUPPORTED, vx.UnilateralContact(on="left"))
VOID = {
    "Traction": (vx.Traction((0.0, 0.0), on="left"), SUPPORTED, "Traction on left: its force is zero"),
    "Pressure": (vx.Pressure(none, on="left"), SUPPORTED, "Pressure on left: its force is zero"),
    "BodyForce": (vx.BodyForce((0.0, 0.0)), SUPPORTED, "BodyForce: its force is zero"),
    "PointLoad": (vx.PointLoad((0.0, 0.0), at=(0.0, 1.0)), SUPPORTED, "its force is zero"),
    "ThermalStrain": (vx.ThermalStrain(expansion=1e-5, temperature=none), SUPPORTED, "its strain is zero"),
    "Prestress": (vx.Prestress((0.0, 0.0, 0.0)), SUPPORTED, "its stress is zero"),
    "ElasticFoundation": (vx.ElasticFoundation(0.0, 0.0, on="left"), SUPPORTED, "ElasticFoundation: its stiffness is"),
    "Viscosity": (vx.Viscosity(shear=0.0), SUPPORTED, "Viscosity: its viscosity is zero"),
    "Tresca": (vx.TrescaFriction(none, on="bottom"), SUPPORTED[:-1], "TrescaFriction on bottom: its bound is zero"),
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
    with_void, without = (pose_scene(vx.Scene(*some, *beside), mesh(), TIMES) for some in ((void,), ()))
    assert program(with_void) == program(without)
    assert [words for words in with_void.inactive if says in words]
    assert without.inactive == ()
    with caplog.at_level(logging.INFO, "vemcvx"):
        assert answers(vx.Scene(void, *beside)) == answers(vx.Scene(*beside))
    assert f"left out: {with_void.inactive[0]}" in caplog.text


def test_friction_that_begins_late_is_kept():
    late = vx.TrescaFriction(lambda x, t: max(t - 0.9, 0.0), on="bottom")
    posed = pose_scene(vx.Scene(STEEL, HELD, PULLED, TOUCHING, late), mesh(), TIMES)
    assert posed.inactive == ()
    assert posed.system.norms is not None


def test_without_lists_the_effects_of_the_scene():
    scene = vx.Scene(STEEL, HELD, PULLED)
    for absent, name in ((vx.TrescaFriction, "TrescaFriction"), ("Clamp", "'Clamp'")):
        with pytest.raises(vx.SceneError, match=f"^Scene.without: .* no {name} in this scene; it has Elasticity"):
            scene.without(absent)
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
"""Number of solves of a run that do not depend on its steps: one solve estimates rounding errors."""


@pytest.mark.long
def test_linear_scenes_cost_one_solve_a_field(counted):
    """Each of two loads is a scalar times a field, so more steps need only a few more solves, against rounding."""
    scene = vx.Scene(STEEL, HELD, PULLED, vx.BodyForce(lambda x, t: np.full((len(x), 2), np.sin(t))))
    for steps in (4, 32, 256):
        counted.update(factorised=0, solved=0)
        vx.simulate(scene, mesh("voronoi", 6), np.linspace(0, 1, steps + 1), store="last")
        assert counted["factorised"] == 1
        assert 1 <= counted["solved"] - BESIDE <= MOST_SHAPES


@mostly_long("steps", [8, 32])
def test_scenes_without_friction_cost_one_solve_a_step(steps, counted):
    """The load has a new shape in every step; its shape at the start needs one more solve."""
    scene = vx.Scene(STEEL, HELD, TOUCHING, vx.Traction(turning, on="left"))
    vx.simulate(scene, mesh("voronoi", 6), np.linspace(0, 1, steps + 1), initial="equilibrium", store="last")
    assert counted == {"factorised": 1, "solved": BESIDE + 1 + steps}
