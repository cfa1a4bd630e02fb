"""Ground that moves under a body."""

from functools import cache

import numpy as np
import pytest
from scenes import mostly_long, small

import vemcvx as vx

STEEL = vx.Elasticity(200.0, 0.3)
HELD = vx.Clamp(on="right")
TOUCHING = vx.BilateralContact(on="bottom")
TIMES = np.linspace(0, 1, 9)
ROUNDED = 1e-12
"""Relative rounding error of a run with ninety unknowns and the condition number 100."""


def run(t):
    """Return the displacement of the ground, which reverses and does not begin at zero."""
    return 0.02 + 0.03 * np.sin(4 * t)


def belt(x, t):
    return run(t), 0.0


def less(x, t):
    """Return minus the displacement of the ground since t = 0."""
    return run(0.0) - run(t), 0.0


def tresca(ground, held):
    return vx.Scene(STEEL, held, TOUCHING, vx.TrescaFriction(1.0, on="bottom", ground=ground))


def coulomb(ground, held):
    press = vx.Traction(lambda x, t: (0.0, -8.0 * min(1.0, 5 * t)), on="top")
    rubs = vx.CoulombFriction(0.3, on="bottom", ground=ground)
    return vx.Scene(STEEL, held, press, vx.UnilateralContact(on="bottom"), rubs)


def viscous(ground, held):
    return tresca(ground, held).with_(vx.Viscosity(3.0, 2.0))


def closed(ground, held):
    rubs = vx.TrescaFriction(1.0, on="bottom", ground=ground, while_closed=True)
    return coulomb(ground, held).without(vx.CoulombFriction).with_(rubs)


KINDS = {
    "Tresca": tresca,
    "Coulomb": coulomb,
    "while closed": closed,
    "viscous": viscous,
}


@cache
def moved_and_moving(kind, condense=True):
    """Return two histories: a body on moving ground, and a moving body on ground at rest."""
    mesh = small("voronoi", 5)
    moving = vx.simulate(KINDS[kind](belt, HELD), mesh, TIMES, condense=condense)
    other = KINDS[kind](None, vx.PrescribedDisplacement(less, on="right"))
    return moving, vx.simulate(other, mesh, TIMES, condense=condense)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_moving_ground_equals_a_body_that_moves_the_other_way(kind):
    """Strains, forces, slips and energies agree to rounding."""
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
    # Some nodes stick and others slip.
    assert 0 < moving.contact.sticking[1:].sum() < moving.contact.sticking[1:].size
    assert moving.dissipated[-1] > 0.1 * moving.energy.max()


@pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact holds the body")
@mostly_long("way", [0.1, 100.0], 1)
@mostly_long("solver", [vx.Newton(), vx.Clarabel()], ids=lambda s: s.name)
def test_a_body_on_a_belt_is_carried_along(way, solver):
    """Only the belt holds the body. The body moves with the belt, without strains."""
    scene = vx.Scene(STEEL, TOUCHING, vx.TrescaFriction(1.0, on="bottom", ground=lambda x, t: (way * t, 0.0)))
    history = vx.simulate(scene, small("voronoi", 4), TIMES, solver=solver)
    assert history.contact.sticking.all()
    carried = np.stack([way * TIMES, 0 * TIMES], axis=1)[:, None]
    # The accuracy is relative to the root of the largest possible friction work, bound * way.
    assert np.abs(history.displacement - carried).max() < solver.accuracy * way
    assert history.dissipated[-1] < solver.accuracy * way
    assert history.energy.max() < solver.accuracy**2 * way


def test_a_slider_on_a_belt_sticks_and_then_slips():
    """A slider on a spring k with the friction bound w sticks until the ground has moved by w / k."""
    k, w = 4.0, 2.0
    norms = vx.Norms(np.array([[1.0]]), [w], ground=lambda t: [t])
    times = np.linspace(0, 2, 9)
    found = vx.march(vx.System(np.array([[k]]), lambda t: [0.0], norms), times)
    assert found.state[:, 0] == pytest.approx(np.minimum(times, w / k), abs=1e-15)
    assert found.dissipated[-1] == pytest.approx(w * (2.0 - w / k))
    assert found.work[-1] == pytest.approx(
        w * (2.0 - w / k) + np.sum(k * found.state[1:, 0] * np.diff(found.state[:, 0]))
    )
