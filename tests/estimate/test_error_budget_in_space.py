"""The error budget in space: zero if stress is constant, else 1.2 to 2.5 times the true error."""

from __future__ import annotations

import full_slip_in_space as full_slip
import numpy as np
import pytest
from scenes import mostly_long

import block_in_space
import manufactured_full_slip as plane
import vemcvx as vx

pytestmark = pytest.mark.arithmetic

FAMILIES = tuple(vx.meshes.SPACE_FAMILIES)
LEAST, MOST = 1.2, 2.5
"""Bounds of the effectivity, (estimated error) / (true error)."""
STEEL = vx.Elasticity(10.0, 0.3)
GRADIENT = np.array([[0.02, 0.04, -0.03], [0.01, -0.05, 0.02], [0.03, 0.01, -0.12]])
SIDES = "left", "right", "front", "back"


def measure_effectivity(poisson, family, n):
    history = vx.simulate(
        full_slip.scene(poisson, pulled=poisson > 0.4),
        vx.meshes.SPACE_FAMILIES[family](n),
        np.linspace(0, 1, 3),
        store="last",
        # Near incompressibility, rounding leaves errors of 3e-8.
        solver=vx.Newton(accuracy=1e-6) if poisson > 0.4999 else None,
    )
    budget = vx.error_budget(history)
    assert budget.time[-1] <= 1e-8, "steps are exact for data proportional to time"
    return budget.largest["total"] / full_slip.energy_error(history, plane.lame(poisson))


@pytest.mark.long
@pytest.mark.parametrize(
    ("poisson", "family", "sizes"),
    [
        (0.3, "cubes", (3,)),
        (0.3, "tetrahedra", (3,)),
        # With 3 or 5 cubes along a side, the error of the pressure oscillates, and is ten times the pressure.
        (0.4999, "cubes", (3, 5)),
        (0.4999, "voronoi3", (4,)),
        *(
            pytest.param(nu, family, (2, 4, 6) if family == "kelvin" else (4, 8, 12), marks=pytest.mark.slow)
            for nu in (0.0, 0.3, 0.4999995)
            for family in FAMILIES
            # Linear tetrahedra lock near incompressibility.
            if family != "tetrahedra" or nu < 0.4
        ),
    ],
)
def test_effectivity_on_full_slip(poisson, family, sizes):
    found = [measure_effectivity(poisson, family, n) for n in sizes]
    assert min(found) >= LEAST
    assert max(found) <= MOST


@mostly_long("family", FAMILIES)
def test_constant_stress_leaves_no_residual(family):
    """The stress is constant under pressure, traction, friction, contact, springs and heat."""
    mesh = vx.meshes.SPACE_FAMILIES[family]((2, 1, 2))
    friction = vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.5, on="bottom")

    def shear(x, t):
        return t * np.column_stack([np.ones(len(x)), 0 * x[:, 0], 0 * x[:, 0]])

    sliding = vx.Scene(
        STEEL,
        vx.PrescribedDisplacement(shear, on="top"),
        vx.PrescribedDisplacement(0.0, on=SIDES, direction=(0, 1, 0)),
        vx.PrescribedDisplacement(0.0, on=SIDES, direction=(0, 0, 1)),
        *friction,
    )
    pressed = vx.Scene(
        STEEL,
        vx.Symmetry(on=["left", "front"]),
        vx.UnilateralContact(on="bottom"),
        vx.PrescribedDisplacement(lambda x, t: np.full(len(x), -0.1 * t), on="top", direction=(0, 0, 1)),
        vx.Traction(lambda x, t: t * np.tile([0.3, 0.0, 0.0], (len(x), 1)), on="right"),
        vx.ThermalStrain(1e-3, lambda x, t: np.full(len(x), t)),
    )
    sprung = vx.Scene(
        STEEL,
        vx.Symmetry(on=["left", "front"]),
        vx.ElasticFoundation(5.0, on="bottom"),
        vx.Pressure(lambda x, t: t, on="top"),
    )
    for scene in (sliding, pressed, sprung):
        budget = vx.error_budget(vx.simulate(scene, mesh, [0.0, 1.0]))
        assert budget.space.max() < 1e-10


def two_blocks(n, family="cubes"):
    made = vx.meshes.SPACE_FAMILIES[family]
    boxes = {"lower": ((0, 1), (0, 1), (0, 0.5)), "upper": ((0, 1), (0, 1), (0.5, 1))}
    counts = dict(zip(boxes, (n, n) if isinstance(n, int) else n, strict=True))
    return vx.meshes.bodies({name: made(counts[name], box=box) for name, box in boxes.items()})


@pytest.mark.long
@pytest.mark.parametrize("contact", [vx.BilateralContact, vx.UnilateralContact])
def test_constant_stress_leaves_no_residual_at_an_interface(contact):
    """The faces of the bodies differ, and the supports hold the rim of the interface."""
    outside = [f"lower.{side}" for side in ("bottom", *SIDES)] + [f"upper.{side}" for side in ("top", *SIDES)]
    scene = vx.Scene(
        STEEL,
        vx.PrescribedDisplacement(lambda x, t: t * x @ GRADIENT.T, on=outside),
        contact(on="lower|upper"),
        vx.TrescaFriction(10.0, on="lower|upper"),
    )
    history = vx.simulate(scene, two_blocks((3, 4)), [0.0, 0.5, 1.0])
    assert vx.error_budget(history).space.max() < 1e-10


def pressed_aside(x, t):
    return t * np.column_stack([0.02 + 0 * x[:, 0], 0.005 + 0.01 * x[:, 0], -0.02 - 0.002 * x[:, 1]])


def scenes():
    steel = vx.Elasticity(200.0, 0.3)
    coulomb = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom")
    joint = vx.UnilateralContact(on="lower|upper"), vx.CoulombFriction(0.3, on="lower|upper")
    soft = vx.Elasticity(200.0, 0.3, on="lower"), vx.Elasticity(100.0, 0.3, on="upper")
    heat = vx.ThermalStrain(0.01, lambda x, t: t * x[:, 0] * x[:, 2])
    moved = vx.PrescribedDisplacement(pressed_aside, on="top")
    return {
        "block": (block_in_space.scene(), vx.meshes.cubes),
        "coulomb": (vx.Scene(steel, moved, *coulomb), vx.meshes.cubes),
        "heat": (vx.Scene(steel, vx.Clamp(on="bottom"), heat), vx.meshes.cubes),
        "two bodies": (
            vx.Scene(
                *soft,
                vx.Clamp(on="lower.bottom"),
                vx.PrescribedDisplacement(pressed_aside, on="upper.top"),
                *joint,
            ),
            two_blocks,
        ),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", scenes())
def test_effectivity_on_scenes(name):
    """The reference has cubes of side 1/20."""
    scene, mesh = scenes()[name]
    times = np.linspace(0.0, 1.0, 5)
    history, fine = (vx.simulate(scene, mesh(n), times, store="last") for n in (4, 20))
    true = vx.measures.energy_distance(history, fine).relative
    assert LEAST <= vx.error_budget(history).space[-1] / true <= MOST


@pytest.mark.slow
@pytest.mark.parametrize("name", ["block", "coulomb", "heat"])
def test_true_errors_of_adaptive_meshes_meet_the_target(name):
    """The reference has 24 x 24 x 24 cubes."""
    (scene, _), target = scenes()[name], 0.2
    found = vx.adapt(scene, vx.meshes.tetrahedra(3), [0.0, 0.5, 1.0], target)
    assert found.met
    fine = vx.simulate(scene, vx.meshes.cubes(24), np.linspace(0.0, 1.0, 9), store="last")
    assert vx.measures.energy_distance(found.history, fine).relative <= target


@pytest.mark.long
def test_the_mesh_error_of_friction_work_is_one_to_five_times_the_truth():
    scene, _ = scenes()["coulomb"]
    found = vx.quantities(vx.simulate(scene, vx.meshes.cubes(2), [0.0, 0.5, 1.0]))
    truth = vx.simulate(scene, vx.meshes.cubes(8), [0.0, 0.5, 1.0]).dissipated_second_order[-1]
    assert 1.0 <= found["dissipated"].mesh / abs(found["dissipated"].value - truth) <= 5.0
