"""Bounds on linear quantities enclose exact values."""

from __future__ import annotations

import numpy as np
import pytest
from random_scenes import coarse_mesh, random_scene
from scenes import few_families, mostly_slow, small
from test_error_bound import SCENES, STACKS, STEEL, slipped, stacked

import guaranteed_bounds
import l_shaped_bracket as bracket
import manufactured_full_slip as full_slip
import vemcvx as vx

pytestmark = pytest.mark.arithmetic

ALONG, UP = (1.0, 0.0), (0.0, 1.0)
ROUNDING = 1e-10


def check_inside(bound, exact, error=0.0):
    """Check that the bounds enclose `exact` up to `error`, and return the width of the interval."""
    slack = ROUNDING * (abs(exact) + abs(bound.value)) + error
    assert bound.low - slack <= exact <= bound.high + slack
    return bound.high - bound.low


# Full slip with a known displacement.


def waves(x, t):
    return np.column_stack([np.sin(3.0 * x[:, 0]), np.cos(2.0 * x[:, 1])])


def quantities_of_full_slip():
    """Return quantities with exact values, by name."""
    lam = full_slip.lame(0.3)
    s, w = np.polynomial.legendre.leggauss(24)
    s, w, one = 0.5 + 0.5 * s, 0.5 * w, np.ones(24)
    x, y = (each.ravel() for each in np.meshgrid(s, s))
    u = full_slip.displacement(x, y, 1.0, lam)
    strain = full_slip.strain(x, y, 1.0, lam)
    area = np.outer(w, w).ravel()
    return {
        "top": (vx.Traction(ALONG, on="top"), w @ full_slip.displacement(s, one, 1.0, lam)[:, 0]),
        "body": (vx.BodyForce(waves), np.sum(area[:, None] * u * waves(np.column_stack([x, y]), 1.0))),
        "mean strain": (vx.Prestress((-1.0, 0.0, 0.0)), area @ strain[:, 0]),
        "two sides": (
            [vx.Traction(ALONG, on="top"), vx.Pressure(-1.0, on="right")],
            w @ (full_slip.displacement(s, one, 1.0, lam) + full_slip.displacement(one, s, 1.0, lam))[:, 0],
        ),
    }


@pytest.mark.long
@few_families
@mostly_slow("name", ("top", "body", "mean strain", "two sides"), "top")
def test_bounds_enclose_quantities_of_full_slip(family, name):
    of, exact = quantities_of_full_slip()[name]
    widths = [check_inside(vx.error_bound(slipped(0.3, family, n), -1, of), exact) for n in (2, 4)]
    assert widths[1] < 0.6 * widths[0]


# Without friction, the intervals of all meshes contain the exact value, so the intervals intersect.


def bonded(*effects):
    return vx.Scene(
        STEEL,
        vx.Clamp(on="left"),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: t * np.column_stack([x[:, 0], -x[:, 0]]), on="top"),
        vx.BodyForce(lambda x, t: t * np.column_stack([3.0 * x[:, 0], 1.0 - x[:, 1]])),
        *effects,
    )


LINEAR = {
    "held at both ends": bonded(),
    "on a frictionless floor": bonded(vx.BilateralContact(on="bottom")),
    "warm": bonded(vx.ThermalStrain(1e-3, lambda x, t: np.full(len(x), 10.0 * t))),
    "moved": vx.Scene(
        STEEL,
        vx.PrescribedDisplacement(
            lambda x, t: np.column_stack([0.01 * t * x[:, 1], 0.02 * t - 0.0 * x[:, 1]]), on="left"
        ),
        vx.Clamp(on="right"),
    ),
}
QUANTITIES = {
    "mean of a side": vx.Traction(ALONG, on="top"),
    "mean of the body": vx.BodyForce(UP),
    "mean strain": vx.Prestress((0.0, -1.0, 0.0)),
    "force of a support": vx.PrescribedDisplacement(ALONG, on="right"),
}


@pytest.mark.long
@mostly_slow("name", LINEAR, "moved")
def test_intervals_of_linear_scenes_intersect_and_shrink(name):
    coarse, middle, fine = (vx.simulate(LINEAR[name], vx.meshes.squares(n), [0.0, 1.0]) for n in (2, 4, 8))
    for of in list(QUANTITIES.values())[:: 3 if name == "moved" else 1]:
        bounds = [vx.error_bound(history, -1, of) for history in (coarse, middle, fine)]
        assert all(bound.guaranteed for bound in bounds)
        assert max(bound.low for bound in bounds) <= min(bound.high for bound in bounds)
        widths = [bound.high - bound.low for bound in bounds]
        assert widths[2] < 0.6 * widths[1] < 0.5 * widths[0]
        centre = 0.5 * (bounds[2].low + bounds[2].high)
        assert abs(bounds[2].value - centre) < abs(bounds[0].value - centre)


@pytest.mark.long
def test_forces_of_supports_balance_loads_to_rounding():
    scene = vx.Scene(
        STEEL, vx.Clamp(on="left"), vx.Traction(lambda x, t: np.tile([2.0 * t, t], (len(x), 1)), on="right")
    )
    history = vx.simulate(scene, small("voronoi", 4), [0.0, 1.0])
    for way, force in ((ALONG, -2.0), (UP, -1.0)):
        bound = vx.error_bound(history, -1, vx.PrescribedDisplacement(way, on="left"))
        assert np.allclose([bound.low, bound.high], force, rtol=1e-9)
        assert np.isclose(bound.value, np.dot(history.reaction("left")[-1], way))


# Scenes with friction and contact: bounds are compared with the intervals of much finer meshes.


def check_against_finer(scene, meshes, of, end=1.0):
    coarse, fine = (vx.error_bound(vx.simulate(scene, mesh, [0.0, end]), -1, of) for mesh in meshes)
    check_inside(coarse, 0.5 * (fine.low + fine.high), 0.5 * (fine.high - fine.low))
    assert coarse.guaranteed
    return coarse


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "family"), [(SCENES["lifted"], vx.meshes.squares), (bracket.scene(), vx.meshes.l_shape)]
)
def test_bounds_enclose_quantities_with_contact(scene, family):
    check_against_finer(scene, (family(4), family(16)), vx.Traction(UP, on="right"))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(24))
def test_bounds_enclose_quantities_in_random_scenes(seed):
    scene, turn = random_scene(seed)
    for of in (vx.Traction((1.0, 0.5), on="left"), vx.BodyForce((0.3, 1.0))):
        check_against_finer(scene, (coarse_mesh(seed), vx.meshes.squares(24)), of, turn)


@pytest.mark.long
@mostly_slow("name", STACKS, "one-sided")
def test_bounds_enclose_quantities_of_two_bodies(name):
    quantities = vx.Traction(ALONG, on="lower.right"), vx.PrescribedDisplacement(UP, on="upper.top")
    for of in quantities[: 1 if name == "one-sided" else 2]:
        check_against_finer(STACKS[name], (stacked(3), stacked(9)), of)


@pytest.mark.long
def test_intervals_of_the_problem_file_enclose_the_closed_form_and_shrink():
    history = vx.simulate(guaranteed_bounds.scene(), guaranteed_bounds.mesh(4), guaranteed_bounds.times(2))
    exact = guaranteed_bounds.exact()
    energies, means = guaranteed_bounds.intervals_over_meshes(history, (2, 4))
    for intervals, value in ((energies, exact[0]), (means, exact[1])):
        low, high = intervals.T
        assert (low <= value).all()
        assert (value <= high).all()
    assert np.ptp(energies[1]) < 0.7 * np.ptp(energies[0])
    assert np.ptp(means[1]) < 0.7 * np.ptp(means[0])
    bounds = guaranteed_bounds.bounds_over_steps(4, (5, 17))
    assert bounds[1] < 0.8 * bounds[0]
    # The load is proportional to time, so that the bound hardly depends on the number of steps.
    once = vx.simulate(guaranteed_bounds.scene(), guaranteed_bounds.mesh(4), guaranteed_bounds.times(1))
    assert vx.error_bound(once).upper[-1] == pytest.approx(vx.error_bound(history).upper[-1], rel=1e-3)


# Refusals.


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:supports")
def test_quantities_of_a_body_that_only_friction_holds_are_refused():
    history = vx.simulate(SCENES["held by friction"], vx.meshes.squares(4), [0.0, 1.0])
    with pytest.raises(vx.SceneError, match="only friction or one-sided contact holds the body"):
        vx.error_bound(history, -1, vx.Traction(ALONG, on="left"))
