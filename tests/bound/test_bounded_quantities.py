"""Bounds on linear quantities: the exact one is between them, by a theorem where nothing rubs, and nearly so where."""

from __future__ import annotations

import numpy as np
import pytest
from random_scenes import coarse_mesh, random_scene
from scenes import FAMILIES, few_families, mostly_slow, paper_scene, small
from test_error_bound import SCENES, STACKS, STEEL, slipped, stacked

import guaranteed_bounds
import l_shaped_bracket as bracket
import manufactured_full_slip as full_slip
import vemcvx as vx

pytestmark = pytest.mark.arithmetic

ALONG, UP = (1.0, 0.0), (0.0, 1.0)
ROUNDING = 1e-10


def check_inside(bound, exact, error=0.0):
    """The exact quantity, known up to an error, is where it is said to be."""
    slack = ROUNDING * (abs(exact) + abs(bound.value)) + error
    assert bound.low - slack <= exact <= bound.high + slack
    return bound.high - bound.low


# Manufactured full slip, whose displacement is known.


def waves(x, t):
    return np.column_stack([np.sin(3.0 * x[:, 0]), np.cos(2.0 * x[:, 1])])


def of_full_slip():
    """Quantities by name, each with its exact value."""
    lam = full_slip.lame(0.3)
    s, w = np.polynomial.legendre.leggauss(24)
    s, w, one = 0.5 + 0.5 * s, 0.5 * w, np.ones(24)
    x, y = (each.ravel() for each in np.meshgrid(s, s))
    u = full_slip.displacement(x, y, 1.0, lam)
    strain = full_slip.strain(x, y, 1.0, lam)
    area = np.outer(w, w).ravel()
    return {
        "top": (vx.Traction(ALONG, on="top"), w @ full_slip.displacement(s, one, 1.0, lam)[:, 0]),
        "right": (vx.Traction(UP, on="right"), w @ full_slip.displacement(one, s, 1.0, lam)[:, 1]),
        "body": (vx.BodyForce(waves), np.sum(area[:, None] * u * waves(np.column_stack([x, y]), 1.0))),
        "mean strain": (vx.Prestress((-1.0, 0.0, 0.0)), area @ strain[:, 0]),
        "both": (
            [vx.Traction(ALONG, on="top"), vx.Pressure(-1.0, on="right")],
            w @ (full_slip.displacement(s, one, 1.0, lam) + full_slip.displacement(one, s, 1.0, lam))[:, 0],
        ),
    }


@pytest.mark.long
@few_families
@mostly_slow("name", ("top", "right", "body", "mean strain", "both"), "top")
def test_quantities_of_full_slip_are_between_their_bounds(family, name):
    of, exact = of_full_slip()[name]
    widths = [check_inside(vx.error_bound(slipped(0.3, family, n), -1, of), exact) for n in (2, 4)]
    assert widths[1] < 0.6 * widths[0]


@pytest.mark.slow
@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49, 0.4999])
@pytest.mark.parametrize("family", FAMILIES)
def test_quantities_of_full_slip_are_between_their_bounds_on_all_meshes(family, poisson):
    s, w = np.polynomial.legendre.leggauss(24)
    exact = 0.5 * w @ full_slip.displacement(0.5 + 0.5 * s, 0.0 * s + 1.0, 1.0, full_slip.lame(poisson))[:, 0]
    for n in (4, 8, 16):
        bound = vx.error_bound(slipped(poisson, family, n), -1, vx.Traction(ALONG, on="top"))
        check_inside(bound, exact)
        assert not bound.guaranteed


# Without friction: a theorem, and intervals of all meshes meet.


def bonded(*effects):
    return vx.Scene(
        STEEL,
        vx.Clamp(on="left"),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: np.column_stack([t * x[:, 0], -t * np.cos(3.0 * x[:, 0])]), on="top"),
        vx.BodyForce(lambda x, t: t * waves(x, t)),
        *effects,
    )


LINEAR = {
    "held at both ends": bonded(),
    "on a frictionless floor": bonded(vx.BilateralContact(on="bottom")),
    "on springs": bonded(vx.ElasticFoundation(normal=80.0, tangential=20.0, on="bottom")),
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
def test_intervals_of_linear_scenes_are_theorems(name):
    coarse, middle, fine = (vx.simulate(LINEAR[name], vx.meshes.squares(n), [0.0, 1.0]) for n in (2, 4, 8))
    for of in list(QUANTITIES.values())[:: 3 if name == "moved" else 1]:
        bounds = [vx.error_bound(history, -1, of) for history in (coarse, middle, fine)]
        # Only of loads that are linear; what is left of waves is the smaller part.
        assert all(bound.guaranteed == (bound.reading == 0.0) == (name == "moved") for bound in bounds)
        assert all(bound.reading <= 0.3 * (bound.high - bound.low) for bound in bounds)
        assert max(bound.low for bound in bounds) <= min(bound.high for bound in bounds)
        widths = [bound.high - bound.low for bound in bounds]
        assert widths[2] < 0.6 * widths[1] < 0.5 * widths[0]
        assert abs(bounds[2].value - bounds[2].low) < abs(bounds[0].value - bounds[2].low)


@pytest.mark.long
def test_forces_of_supports_balance_loads():
    """What the load determines alone is known to rounding."""
    scene = vx.Scene(
        STEEL, vx.Clamp(on="left"), vx.Traction(lambda x, t: np.tile([2.0 * t, t], (len(x), 1)), on="right")
    )
    history = vx.simulate(scene, small("voronoi", 4), [0.0, 1.0])
    for way, force in ((ALONG, -2.0), (UP, -1.0)):
        bound = vx.error_bound(history, -1, vx.PrescribedDisplacement(way, on="left"))
        assert np.allclose([bound.low, bound.high], force, rtol=1e-9)
        assert np.isclose(bound.value, np.dot(history.reaction("left")[-1], way))


# With friction and contact, against intervals of much finer meshes.


def check_against_finer(scene, meshes, of, end=1.0):
    coarse, fine = (vx.error_bound(vx.simulate(scene, mesh, [0.0, end]), -1, of) for mesh in meshes)
    check_inside(coarse, 0.5 * (fine.low + fine.high), 0.5 * (fine.high - fine.low))
    assert coarse.guaranteed
    return coarse


@pytest.mark.long
@pytest.mark.parametrize("n", [2, pytest.param(8, marks=pytest.mark.slow)])
def test_quantities_of_the_bracket_are_between_their_bounds(n):
    """A corner where stress is infinite, and friction: the mean displacement of its foot, and its mean strain."""
    meshes = vx.meshes.l_shape(n), vx.meshes.l_shape(4 * n)
    quantities = vx.Traction(UP, on="right"), vx.BodyForce(ALONG), vx.Prestress((0.0, 0.0, -1.0))
    for of in quantities[: 1 if n == 2 else 3]:
        check_against_finer(bracket.scene(), meshes, of)


@pytest.mark.long
@mostly_slow("name", ("paper", "lifted", "compliant"), "lifted")
def test_quantities_with_contact_are_between_their_bounds(name):
    meshes = vx.meshes.squares(5), vx.meshes.squares(15)
    check_against_finer(SCENES[name], meshes, vx.Traction(UP, on="top"))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:supports")
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("family", ["squares", "triangles", "voronoi", "hanging"])
def test_quantities_are_between_their_bounds_in_all_scenes(name, family):
    if name == "contrast" and family == "voronoi":
        return  # Its cells do not follow the seam of the two materials.
    if name.startswith("held by"):
        return  # Nothing but friction or contact does, and no quantity has a bound.
    meshes = small(family, 8), vx.meshes.squares(48)
    for of in (vx.Traction(ALONG, on="left"), vx.Traction(UP, on="top"), vx.Prestress((-1.0, 0.0, 0.0))):
        check_against_finer(SCENES[name], meshes, of)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(24))
def test_quantities_are_between_their_bounds_in_random_scenes(seed):
    """Stiffness over six decades, all families of meshes, up to the instant at which loads turn."""
    scene, turn = random_scene(seed)
    for of in (vx.Traction((1.0, 0.5), on="left"), vx.BodyForce((0.3, 1.0))):
        check_against_finer(scene, (coarse_mesh(seed), vx.meshes.squares(24)), of, turn)


@pytest.mark.long
@mostly_slow("name", STACKS, "one-sided")
def test_quantities_of_two_bodies_are_between_their_bounds(name):
    quantities = vx.Traction(ALONG, on="lower.right"), vx.PrescribedDisplacement(UP, on="upper.top")
    for of in quantities[: 1 if name == "one-sided" else 2]:
        check_against_finer(STACKS[name], (stacked(3), stacked(9)), of)


@pytest.mark.long
def test_error_bars_close_around_the_closed_form():
    """The problem file: of mesh and steps, its exact solution between them."""
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
    # In proportion steps lose nothing, and the bound knows it.
    once = vx.simulate(guaranteed_bounds.scene(), guaranteed_bounds.mesh(4), guaranteed_bounds.times(1))
    assert vx.error_bound(once).upper[-1] == pytest.approx(vx.error_bound(history).upper[-1], rel=1e-3)


# What is no quantity.

NO_QUANTITY = "a linear quantity is given as the load"


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:supports")
def test_what_is_no_quantity_says_so():
    history = vx.simulate(paper_scene(), vx.meshes.squares(4), [0.0, 1.0])
    rubbed = vx.simulate(SCENES["held by friction"], vx.meshes.squares(4), [0.0, 1.0])
    for run, step, of, said in (
        (history, -1, "dissipated", NO_QUANTITY),
        (history, -1, [], NO_QUANTITY),
        (history, -1, vx.Clamp(on="right"), NO_QUANTITY),
        (history, -1, STEEL, NO_QUANTITY),
        (history, -1, vx.TrescaFriction(1.0, on="bottom"), NO_QUANTITY),
        (history, -1, vx.PointLoad(ALONG, at=(0.0, 1.0)), "PointLoad"),
        (history, -1, vx.PrescribedDisplacement(ALONG, on="left"), "no support of the scene"),
        (history, -1, vx.PrescribedDisplacement(1.0, on="bottom", direction="normal"), "that meets another support"),
        (history, None, vx.Traction(UP, on="top"), "is bounded in one step; give its number, too, such as step=-1"),
        (rubbed, -1, vx.Traction(ALONG, on="left"), "only friction or one-sided contact holds the body"),
    ):
        with pytest.raises(vx.SceneError, match=said):
            vx.error_bound(run, step, of)
