"""Data with waves as long as an edge or a cell, and narrower strips: no less in the estimate than in truth."""

from __future__ import annotations

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.estimate.budget import error_budget

STEEL = vx.Elasticity(young=200.0, poisson=0.3)
TIMES = [0.0, 0.5, 1.0]
MOST = 4.0


def wave(x, edges, phase=0.0):
    """A whole wave on each of so many edges of a unit length."""
    return np.sin(2 * np.pi * edges * x + phase)


def pull(x, t):
    return t * np.column_stack([8 * (1.25 - x[:, 1]), np.full(len(x), -0.01)])


def moved(n, direction):
    def motion(x, t):
        return 0.02 * t * wave(x[:, 0], n)

    support = vx.PrescribedDisplacement(motion, on="top", direction=direction)
    return vx.Scene(STEEL, vx.Clamp(on="bottom"), support)


def driven(n, phase, waves=1):
    def force(x, t):
        return 4 * t * np.column_stack([wave(x[:, 0], waves * n, phase), wave(x[:, 0], waves * n, phase + np.pi / 2)])

    return vx.Scene(STEEL, vx.Clamp(on="bottom"), vx.Traction(force, on="top"))


def pressed(n):
    pressure = vx.Pressure(lambda x, t: 8 * t * (1 + wave(x[:, 0], n, np.pi / 4)), on="top")
    return vx.Scene(STEEL, vx.Clamp(on="bottom"), pressure)


def weighed(density):
    def force(x, t):
        return t * np.column_stack([np.zeros(len(x)), density(x)])

    return vx.Scene(STEEL, vx.Clamp(on="bottom"), vx.BodyForce(force))


def rubbing(n, phase, base=1.0):
    """A bound between 0 and twice its mean, of which nodes read the same value everywhere."""
    friction = vx.TrescaFriction(lambda x, t: base * (1 + wave(x[:, 0], n, phase)), on="bottom")
    return vx.Scene(
        STEEL, vx.Clamp(on="right"), vx.BilateralContact(on="bottom"), friction, vx.Traction(pull, on="left")
    )


def scenes(n):
    return {
        "a normal motion": moved(n, "normal"),
        "a tangential motion": moved(n, "tangent"),
        "two waves of motion": moved(2 * n, "normal"),
        "tractions": driven(n, 0.0),
        "tractions, at another phase": driven(n, np.pi / 2),
        "two waves of traction": driven(n, np.pi / 2, 2),
        "pressure": pressed(n),
        "weight": weighed(lambda x: wave(x[:, 0], n)),
        "a strip of weight": weighed(lambda x: 20.0 * (np.abs(x[:, 0] - 0.5 - 0.5 / n) < 0.1 / n)),
        "a bound": rubbing(n, 0.0),
        "a bound read at its crests": rubbing(n, np.pi / 2),
        "a bound read at its troughs": rubbing(n, -np.pi / 2),
        "a large bound read at its troughs": rubbing(n, -np.pi / 2, 4.0),
    }


def ratio(scene, n, fine):
    """Estimated over true error, both absolute but where nothing moves on the coarse mesh: then all is missing."""
    history, truth = (vx.simulate(scene, vx.meshes.squares(k), TIMES, store="last") for k in (n, fine))
    budget = error_budget(history, -1)
    if budget.scale == 0.0:
        return budget.largest["total"]
    return budget.largest["total"] * budget.scale / vx.measures.energy_distance(truth, history).absolute


@pytest.mark.long
@pytest.mark.parametrize("name", scenes(4))
def test_waves_as_long_as_an_edge_are_in_the_estimate(name):
    """Four whole waves on four edges; estimates were .23 to 1.07 times the truth, but for a bound at phase 0."""
    assert 1.0 <= ratio(scenes(4)[name], 4, 64) <= MOST


@pytest.mark.slow
@pytest.mark.parametrize("n", [8, 16])
@pytest.mark.parametrize("name", scenes(4))
def test_waves_are_in_the_estimate_however_short(name, n):
    """The mean of a bound or load that nodes misread does not vanish with the edge: with local weights .18 to .83."""
    assert 1.0 <= ratio(scenes(n)[name], n, 256) <= MOST


GRAINS = [(shear, angle) for shear in (40.0, 400.0) for angle in (0.0, 0.4, np.pi / 4, 1.2)]


@pytest.mark.long
@pytest.mark.parametrize(("shear", "angle"), GRAINS)
def test_estimates_of_turned_fibres_are_no_less_than_the_truth(shear, angle):
    """A hundred to one."""

    def shears(x, t):
        return t * np.column_stack([4 * x[:, 0] * (1 - x[:, 0]), x[:, 0]])

    fibres = vx.Orthotropic((1e4, 1e2), 0.3, shear, angle=angle)
    scene = vx.Scene(fibres, vx.Clamp(on="bottom"), vx.Traction(shears, on="top"))
    truth = vx.simulate(scene, vx.meshes.squares(96), TIMES, store="last")
    for n in (4, 8):
        history = vx.simulate(scene, vx.meshes.squares(n), TIMES, store="last")
        true = vx.measures.energy_distance(history, truth).relative
        assert 1.0 <= error_budget(history).largest["total"] / true <= MOST


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")
def test_what_a_body_that_only_friction_holds_lacks_is_estimated():
    """K does not feel its motion along the floor; of the waves' mean friction is left to bear that part."""
    friction = vx.TrescaFriction(lambda x, t: 8 * (1.5 + wave(x[:, 0], 4)), on="bottom")
    contact = vx.BilateralContact(on="bottom"), friction

    def force(x, t):
        return t * np.column_stack([2 + wave(x[:, 1], 4, np.pi / 4), wave(x[:, 1], 4, np.pi / 4)])

    scene = vx.Scene(STEEL, *contact, vx.Traction(force, on="left"))
    assert 1.0 <= ratio(scene, 4, 64) <= MOST
