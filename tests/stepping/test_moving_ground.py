"""Ground that moves under the body: friction acts on what is relative to it, and its work closes the balance."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from identical import same
from scenes import mostly_long, small

import vemcvx as vx

STEEL = vx.Elasticity(200.0, 0.3)
HELD = vx.Clamp(on="right")
TOUCHING = vx.BilateralContact(on="bottom")
TIMES = np.linspace(0, 1, 9)
ROUNDED = 1e-12
"""Programs of a hundred unknowns, of condition 1e3: some thousand roundings of 1e-16."""


def run(t):
    """How far the ground is at an instant: it does not begin at zero, turns, and slips over most of the contact."""
    return 0.02 + 0.03 * np.sin(4 * t)


def belt(x, t):
    return run(t), 0.0


def less(x, t):
    """Where a body is that moves against ground at rest instead."""
    return run(0.0) - run(t), 0.0


def tresca(ground, held, **settings):
    return vx.Scene(STEEL, held, TOUCHING, vx.TrescaFriction(1.0, on="bottom", ground=ground, **settings))


def coulomb(ground, held, **settings):
    press = vx.Traction(lambda x, t: (0.0, -8.0 * min(1.0, 5 * t)), on="top")
    rubs = vx.CoulombFriction(0.3, on="bottom", ground=ground, **settings)
    return vx.Scene(STEEL, held, press, vx.UnilateralContact(on="bottom"), rubs)


def viscous(ground, held):
    return tresca(ground, held).with_(vx.Viscosity(3.0, 2.0))


def closed(ground, held):
    rubs = vx.TrescaFriction(1.0, on="bottom", ground=ground, while_closed=True)
    return coulomb(ground, held).without(vx.CoulombFriction).with_(rubs)


KINDS = {
    "Tresca": tresca,
    "integral": lambda ground, held: tresca(ground, held, quadrature="integral"),
    "Coulomb": coulomb,
    "capped": lambda ground, held: coulomb(ground, held, cap=1.0),
    "while closed": closed,
    "viscous": viscous,
}


@cache
def moved_and_moving(kind, condense=True):
    """A body at rest on ground that moves, and moved against ground at rest: two histories."""
    mesh = small("voronoi", 5)
    moving = vx.simulate(KINDS[kind](belt, HELD), mesh, TIMES, condense=condense)
    other = KINDS[kind](None, vx.PrescribedDisplacement(less, on="right"))
    return moving, vx.simulate(other, mesh, TIMES, condense=condense)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_ground_that_moves_is_a_body_that_moves_the_other_way(kind):
    """The same strains, forces, slips and energies to round-off: there is one motion between the two."""
    moving, moved = moved_and_moving(kind)
    way = np.stack([run(TIMES) - run(0.0), 0 * TIMES], axis=1)[:, None]
    size = np.abs(way).max()
    assert np.abs(moving.displacement - (moved.displacement + way)).max() < ROUNDED * size
    assert np.abs(moving.contact.slip - moved.contact.slip).max() < ROUNDED * size
    assert np.array_equal(moving.contact.sticking, moved.contact.sticking)
    for name in ("traction", "pressure", "bound", "wear"):
        one, other = getattr(moving.contact, name), getattr(moved.contact, name)
        assert np.abs(one - other).max() < ROUNDED * np.abs(other).max(), name
    for name in ("energy", "dissipated", "work"):
        one, other = getattr(moving, name), getattr(moved, name)
        assert np.abs(one - other).max() < ROUNDED * np.abs(other).max(), name
    # There is something to compare: it sticks, slips to and fro, and what slips is worn.
    assert 0 < moving.contact.sticking[1:].sum() < moving.contact.sticking[1:].size
    assert moving.dissipated[-1] > 0.1 * moving.energy.max()


@pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact holds the body")
@mostly_long("way", [0.1, 100.0], 1)
@mostly_long("solver", [vx.Newton(), vx.Clarabel()], ids=lambda s: s.name)
def test_a_body_on_a_belt_is_carried_along(way, solver):
    """Nothing else holds it, so nothing strains it: it moves with the belt, however far that runs."""
    scene = vx.Scene(STEEL, TOUCHING, vx.TrescaFriction(1.0, on="bottom", ground=lambda x, t: (way * t, 0.0)))
    history = vx.simulate(scene, small("voronoi", 4), TIMES, solver=solver)
    assert history.contact.sticking.all()
    carried = np.stack([way * TIMES, 0 * TIMES], axis=1)[:, None]
    # What friction can cause is the scale of its accuracy: the square root of an energy, (bound * way)^(1/2) at most.
    assert np.abs(history.displacement - carried).max() < solver.accuracy * way
    assert history.dissipated[-1] < solver.accuracy * way
    assert history.energy.max() < solver.accuracy**2 * way


@pytest.mark.long
def test_the_ground_rubs_on_what_supports_hold():
    """A clamped side: all of the way is slip, friction is its bound, and the clamp bears it."""
    scene = vx.Scene(STEEL, vx.Clamp(on="bottom"), vx.TrescaFriction(1.0, on="bottom", ground=lambda x, t: (t, 0.0)))
    history = vx.simulate(scene, small("squares", 4), TIMES)
    assert not history.displacement.any()
    assert history.contact.slip[:, :, 0] == pytest.approx(np.repeat(-TIMES[:, None], 5, axis=1))
    assert history.contact.traction[1:, :, 0] == pytest.approx(1.0)
    assert history.dissipated == pytest.approx(TIMES)
    assert history.work == pytest.approx(TIMES)
    with_it = vx.PrescribedDisplacement(lambda x, t: (t, 0.0), on="bottom")
    carried = vx.simulate(scene.without(vx.Clamp).with_(with_it), small("squares", 4), TIMES)
    assert len(carried.contact.nodes) == 0
    assert carried.dissipated[-1] == 0.0


@pytest.mark.long
def test_only_changes_of_the_ground_count():
    """Ground that stands still is none, to the bit, and is said; where it begins counts for nothing."""
    mesh, pull = small("squares", 4), vx.Traction(lambda x, t: (5 * t, 0.0), on="left")
    plain = vx.simulate(tresca(None, HELD).with_(pull), mesh, TIMES)
    still = vx.simulate(tresca(lambda x, t: (3.0, 0.0), HELD).with_(pull), mesh, TIMES)
    assert still.inactive == ("TrescaFriction on bottom: ground does not move along the boundary",)
    assert same(still.trajectory.state, plain.trajectory.state)
    assert same(still.contact, plain.contact)
    up = vx.simulate(tresca(lambda x, t: (0.0, t), HELD).with_(pull), mesh, TIMES)
    assert same(up.trajectory.state, plain.trajectory.state)
    assert up.inactive == still.inactive
    table = vx.Tabulated([0.0, 1.0], [(0.5, 0.0), (0.6, 0.0)])
    one, other = (vx.simulate(tresca(g, HELD), mesh, TIMES) for g in (table, lambda x, t: (0.1 * t, 0.0)))
    assert np.abs(one.contact.slip - other.contact.slip).max() < 1e-15
    assert not one.contact.slip[0].any()


def test_an_abstract_slider_on_a_belt():
    """One spring: it follows the belt by w / k, and then slips; the belt has done the work w (U - w / k) + w^2 / 2k."""
    k, w = 4.0, 2.0
    norms = vx.Norms(np.array([[1.0]]), [w], ground=lambda t: [t])
    times = np.linspace(0, 2, 9)
    found = vx.march(vx.System(np.array([[k]]), lambda t: [0.0], norms), times)
    assert found.state[:, 0] == pytest.approx(np.minimum(times, w / k), abs=1e-15)
    assert found.dissipated[-1] == pytest.approx(w * (2.0 - w / k))
    assert found.work[-1] == pytest.approx(
        w * (2.0 - w / k) + np.sum(k * found.state[1:, 0] * np.diff(found.state[:, 0]))
    )
    with pytest.raises(
        vx.SceneError, match=r"^Norms: ground: found an array of shape \(2,\); wanted \(1,\) displacements, one per"
    ):
        vx.march(vx.System(np.array([[k]]), lambda t: [0.0], replace(norms, ground=lambda t: [t, t])), times)
