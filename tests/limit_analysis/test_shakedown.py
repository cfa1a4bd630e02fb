"""Shakedown factors are compared with linear programs, smallest discs and simulations of many cycles."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import linprog

import vemcvx as vx

pytestmark = pytest.mark.filterwarnings("ignore:.*one-sided contact holds the body")
STEEL = vx.Elasticity(200.0, 0.3)
CYCLE = np.arange(4) / 4
GAP = 5e-9
"""Bound on (upper - factor) / factor."""


def stretch(factor, dim=2):
    """Return opposite sinusoidal tractions on the right and left side."""
    pull = np.array([3.0, 0.4, -0.8][:dim]) * factor
    return [
        vx.Traction(lambda x, t, sign=sign: np.tile(sign * pull * np.sin(2 * np.pi * t), (len(x), 1)), on=side)
        for side, sign in (("right", 1.0), ("left", -1.0))
    ]


def floor(bound=1.0):
    return vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound, on="bottom")


def held(factor=1.0, bound=1.0):
    """Return the scene of a body that a clamp holds at the top."""
    return vx.Scene(STEEL, vx.Clamp(on="top"), *stretch(factor), *floor(bound))


def pushed(factor=1.0, push=0.5, bound=1.0):
    """Return the scene of a body under cyclic tractions and a constant push. Only friction holds the body."""
    return vx.Scene(STEEL, vx.Traction((push, 0.0), on="bottom"), *stretch(factor), *floor(bound))


def plane_mesh():
    return vx.meshes.voronoi(4, box=((0.0, 2.0), (0.0, 1.0)))


def run(scene, mesh, cycles=40):
    """Simulate cycles. Return the work of friction in each cycle, and the history."""
    times = np.append(np.add.outer(np.arange(cycles), CYCLE).ravel(), float(cycles))
    history = vx.simulate(scene, mesh, times, initial="settled", store="last")
    return np.diff(history.trajectory.dissipated[:: len(CYCLE)]), history


def check_bounds(found):
    """Check Melan's conditions and Koiter's cycle. Return the total slip of the cycle."""
    friction = np.linalg.norm(found.residual + found.factor * found.elastic, axis=2)
    assert (friction <= found.bounds * (1 + 1e-12)).all()
    assert (found.elastic * found.slips).sum() == pytest.approx(1.0)
    assert 0.0 <= found.upper - found.factor + 1e-14 <= GAP * found.factor
    net = found.slips.sum(axis=0)
    assert net - net[0] == pytest.approx(0.0, abs=1e-12 * np.abs(found.slips).max())
    return net[0]


@pytest.mark.parametrize("scene", [held, pushed])
def test_elastic_forces_are_those_of_a_run_in_which_all_contact_sticks(scene):
    mesh = plane_mesh()
    found = vx.shakedown(scene(), mesh, CYCLE)
    history = vx.simulate(scene(bound=1e6), mesh, CYCLE, initial="settled")
    assert history.contact.sticking.all()
    rows = [np.flatnonzero(np.isclose(history.contact.points, x).all(axis=1))[0] for x in found.points]
    force = (history.contact.traction[:, :, 0] * history.contact.friction_lengths)[:, rows]
    change, E = force - force[0], found.elastic[:, :, 0]
    # All nodes of the floor have the same tangent.
    assert change * np.sign((change * E).sum()) == pytest.approx(E, abs=1e-9)
    assert np.abs(E).max() > 0.1


def test_with_supports_the_factor_is_the_smallest_ratio_of_bound_and_half_range():
    found = vx.shakedown(held(), plane_mesh(), CYCLE)
    assert found.factor == pytest.approx((2 * found.bounds / np.ptp(found.elastic[:, :, 0], axis=0)).min(), rel=1e-8)
    assert check_bounds(found) == pytest.approx(0.0, abs=1e-12)


def smallest_radius(points):
    """Return the radius of the smallest disc that contains all points."""
    centres = [(a + b) / 2 for a, b in combinations(points, 2)]
    for a, b, c in combinations(points, 3):
        rows = 2 * np.array([b - a, c - a])
        if abs(np.linalg.det(rows)) > 1e-12:
            centres.append(np.linalg.solve(rows, [b @ b - a @ a, c @ c - a @ a]))
    return min(np.linalg.norm(points - centre, axis=1).max() for centre in centres)


def test_in_space_the_factor_is_the_smallest_ratio_of_bound_and_radius():
    turns = vx.Traction(
        lambda x, t: np.outer(x[:, 0], [np.cos(2 * np.pi * t), 0.6 * np.sin(2 * np.pi * t), 0.0]), on="top"
    )
    scene = vx.Scene(STEEL, vx.Clamp(on="left"), turns, *floor())
    found = vx.shakedown(scene, vx.meshes.cubes(2), np.arange(7) / 7)
    radii = [smallest_radius(found.elastic[:, i]) for i in range(len(found.bounds))]
    assert found.factor == pytest.approx((found.bounds / radii).min(), rel=1e-8)
    assert check_bounds(found) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("push", [0.0, 0.5, 0.9])
def test_without_supports_the_factor_is_that_of_a_linear_program(push):
    """The unknowns of the linear program are the factor and constant forces that balance the push."""
    found = vx.shakedown(pushed(push=push), plane_mesh(), CYCLE)
    E, g = found.elastic[:, :, 0], found.bounds
    sides = [np.column_stack([sign * np.eye(len(g)), sign * e]) for e in E for sign in (1.0, -1.0)]
    best = linprog(
        np.append(0 * g, -1.0),
        A_ub=np.vstack(sides),
        b_ub=np.tile(g, len(sides)),
        A_eq=np.append(np.ones(len(g)), 0.0)[None],
        b_eq=[found.residual.sum()],
        bounds=[(None, None)] * (len(g) + 1),
    )
    assert abs(found.residual.sum()) == pytest.approx(2.0 * push, abs=1e-9)
    assert found.factor == pytest.approx(-best.fun, rel=1e-8)
    # Under a large push the body creeps in each cycle.
    assert (np.abs(check_bounds(found)) > 1e-3).all() == (push == 0.9)


@pytest.mark.parametrize("push", [0.5, 0.9])
def test_beside_the_factor_slip_stops_or_goes_on(push):
    mesh = plane_mesh()
    found = vx.shakedown(pushed(push=push), mesh, CYCLE)
    below, rests = run(pushed(0.98 * found.factor, push), mesh)
    above, slips = run(pushed(1.02 * found.factor, push), mesh)
    assert below[-5:].max() < 1e-12 * below[0]
    assert above[-1] == pytest.approx(above[-2], rel=1e-3)
    assert above[-1] > 1e-6 * above[0]
    assert max(rests.certified.max(), slips.certified.max()) < 1e-8


def test_only_changes_since_the_first_instant_are_multiplied():
    """The cycle may begin at any instant. A constant load does not change the factor."""
    mesh, load = plane_mesh(), vx.Traction((0.7, 0.1), on="right")
    factors = [vx.shakedown(held(), mesh, CYCLE + start).factor for start in (0.0, 0.25)]
    assert factors[0] == pytest.approx(factors[1], rel=1e-8)
    assert vx.shakedown(held().with_(load), mesh, CYCLE).factor == pytest.approx(factors[0], rel=1e-8)


def test_a_floor_that_moves_loads_friction_like_a_top_that_moves():
    """The shear .05 of a block with the shear modulus 100 changes friction by 5."""
    mesh, material = plane_mesh(), vx.Elasticity(200.0, 0.0)
    sides = vx.PrescribedDisplacement(0.0, on=["left", "right"], direction=(0.0, 1.0))
    ground = vx.TrescaFriction(1.0, on="bottom", ground=lambda x, t: (0.05 * t, 0.0))
    scene = vx.Scene(material, vx.Clamp(on="top"), sides, vx.BilateralContact(on="bottom"), ground)
    assert vx.shakedown(scene, mesh, [0.0, 1.0]).factor == pytest.approx(2.0 / 5.0, rel=1e-8)


def test_loads_that_supports_bear_do_not_load_friction():
    press = vx.Pressure(lambda x, t: t + 0 * x[:, 0], on="top")
    sides = vx.PrescribedDisplacement(0.0, on=["left", "right"], direction=(1.0, 0.0))
    with pytest.raises(vx.SceneError, match="loads do not change the friction forces"):
        vx.shakedown(vx.Scene(vx.Elasticity(200.0, 0.3), sides, press, *floor()), plane_mesh(), [0.0, 1.0])


def test_a_half_model_has_the_factor_of_the_whole():
    """Nodes on the plane of symmetry slip along this plane only."""
    whole, half = (vx.meshes.cubes((2, n, 1), box=((0, 2), (-1.0 * (n == 2), 1), (0, 1))) for n in (2, 1))
    pull = vx.Traction(lambda x, t: np.tile([t, 0.0, 0.0], (len(x), 1)), on="right")
    scene = vx.Scene(STEEL, vx.Clamp(on="left"), pull, *floor())
    sides = [
        vx.shakedown(scene, whole, [0.0, 1.0]),
        vx.shakedown(scene.with_(vx.Symmetry(on="front")), half, [0.0, 1.0]),
    ]
    assert sides[0].factor == pytest.approx(sides[1].factor, rel=1e-8)


def test_nodes_without_friction_do_not_limit_the_cycle():
    """Nodes with x < .4 have the bound zero, and slip freely."""

    def scene(factor):
        move = vx.PrescribedDisplacement(lambda x, t: [0.1 * factor * np.sin(2 * np.pi * t), 0.0] + 0 * x, on="top")
        return vx.Scene(vx.Elasticity(100.0, 0.3), move, *floor(lambda x, t: 1.0 * (x[:, 0] > 0.4)))

    mesh = vx.meshes.squares(3)
    found = vx.shakedown(scene(1.0), mesh, CYCLE)
    assert found.factor == pytest.approx(found.upper, rel=GAP)
    works = []
    for factor in (0.98, 1.02):
        history = vx.simulate(scene(factor * found.factor), mesh, np.arange(81) / 4)
        works.append(np.diff(history.dissipated[::4])[-1] / history.energy.max())
    assert works[0] < 1e-9 < 1e-6 < works[1]
