"""Bounds for data that vary between quadrature points, or between instants."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from bounds import circle_of, energy_distance
from scenes import mostly_long, mostly_slow

import vemcvx as vx

pytestmark = pytest.mark.arithmetic

STEEL = vx.Elasticity(young=200.0, poisson=0.3)
BAR = (vx.Elasticity(1.0, 0.0), vx.Symmetry(on=["top", "bottom"]))


def along(profile):
    """Return the vector field (t * profile(x), 0)."""
    return lambda x, t: t * np.column_stack([profile(x), 0.0 * x[:, 0]])


def strip(x):
    return 1.0 * (abs(x[:, 0] - 0.4398) < 0.025)


def patch(x):
    return 1.0 * (abs(x[:, 1] - 0.375) < 0.04)


def run(*effects, n=4):
    return vx.simulate(vx.Scene(*effects), vx.meshes.squares(n), [0.0, 1.0])


# Loads that vanish at the quadrature points of the assembly.

STRIP = (*BAR, vx.Symmetry(on="right"), vx.BodyForce(along(strip)))
PRESSED = (vx.Elasticity(1.0, 0.3), vx.Clamp(on="right"))


@mostly_long(
    "effects, true",
    [
        (STRIP, 0.0371),
        ((*PRESSED, vx.Traction(along(patch), on="left")), 0.00723),
        ((*PRESSED, vx.Pressure(lambda x, t: t * patch(x), on="left")), 0.00723),
    ],
    0,
    1,
)
def test_loads_that_assemble_as_zero_are_in_the_bound(effects, true):
    history = run(*effects)
    assert vx.error_bound(history, -1).upper >= true


RUBS = vx.TrescaFriction(lambda x, t: 60.0 * ((x[:, 0] > 0.28) & (x[:, 0] < 0.47)), on="bottom")


@pytest.mark.slow
def test_friction_that_is_zero_at_nodes_is_in_the_bound():
    """On a mesh with nodes in the friction zone, the left side moves by .02994."""
    push = vx.Traction(lambda x, t: (8.0 * t, 0.0), on="left")
    history = run(STEEL, vx.Clamp(on="right"), push, vx.BilateralContact(on="bottom"), RUBS)
    assert history.inactive
    bound = vx.error_bound(history, -1, of=vx.Traction((1.0, 0.0), on="left"))
    assert bound.low <= 0.02994 <= bound.high
    assert vx.error_bound(history).upper[-1] >= vx.error_bound(history, -1).upper >= 0.03


# Body forces along a bar with E = 1. Quadrature integrates only the linear body force exactly.


def jump(x):
    return 1.0 * (x[:, 0] < 0.6)


def peak(x):
    return np.exp(-((x[:, 0] - 0.5) ** 2) / 0.02)


def waves(k, x):
    return np.sin(k * x[:, 0])


LOADS = {
    "jump": jump,
    "strip": strip,
    "peak": peak,
    "waves": partial(waves, 20.0),
    "short waves": partial(waves, 60.0),
    "linear": lambda x: 1.0 - 3.0 * x[:, 0],
}


def bar_under(of):
    """Return the run of a bar, points on the bar, and exact axial forces. The body force is `of`."""
    s = np.linspace(0.0, 1.0, 100_001)
    force = np.append(0.0, np.cumsum(of(0.5 * (s[1:, None] + s[:-1, None])) * np.diff(s)))
    return run(*BAR, vx.Clamp(on="right"), vx.BodyForce(along(of))), s, force


@pytest.mark.long
@pytest.mark.parametrize("name", LOADS)
def test_bounds_allow_for_quadrature_errors_of_loads(name):
    """If the load is not linear, the force of the support has no bound."""
    history, s, force = bar_under(LOADS[name])
    exact, known, least = name == "linear", 1e-6, -0.5 * np.trapezoid(force**2, s)
    found = vx.error_bound(history, -1, of=vx.Traction((1.0, 0.0), on="left"))
    assert found.low - known <= np.trapezoid(force, s) <= found.high + known
    assert found.guaranteed == exact == (found.reading == 0.0)
    assert ("read at points" in repr(found)) != exact
    bound, held = vx.error_bound(history, -1), vx.PrescribedDisplacement((1.0, 0.0), on="right")
    assert bound.kind == ("bound" if exact else "bound for data as read at points")
    assert bound.potential[0] - known <= least <= bound.potential[1] + known
    if exact:
        assert np.allclose(vx.error_bound(history, -1, of=held).low, -force[-1])
    else:
        assert bound.potential == (-np.inf, np.inf)
        with pytest.raises(vx.SceneError, match="no bound of the force of a support if a load"):
            vx.error_bound(history, -1, of=held)


@pytest.mark.long
def test_quantities_that_assemble_as_zero_are_bounded():
    effects = (*BAR, vx.Clamp(on="right"), vx.BodyForce(along(lambda x: 1.0 + 0.0 * x[:, 0])))

    def narrow(x, t):
        return np.column_stack([(abs(x[:, 1] - 0.125) < 0.025) / 0.05, 0.0 * x[:, 0]])

    bound = vx.error_bound(run(*effects), -1, of=vx.Traction(narrow, on="left"))
    assert bound.low <= 0.5 <= bound.high
    assert not bound.guaranteed


# Changes between instants. A layer in uniform shear has no mesh error.

SIDES = vx.PrescribedDisplacement(0.0, on=["left", "right"], direction=(0.0, 1.0))
LAYER = (vx.Elasticity(2.0, 0.0), SIDES, vx.BilateralContact(on="bottom"))


def sheared(course):
    def stress(x, t):
        return np.tile([0.0, 0.0, course(t)], (len(x), 1))

    return *LAYER, vx.Clamp(on="top"), vx.Prestress(stress), vx.TrescaFriction(0.5, on="bottom")


def uniform(course):
    return lambda x, t: np.tile([course(t), 0.0], (len(x), 1))


def bump(t):
    return max(0.0, 1.0 - abs(t - 0.55) / 0.04)


def fast_ripples(t):
    return 0.4 * np.sin(2.0 * np.pi * t) + 0.35 * np.sin(512.0 * np.pi * t)


COURSES = {
    "ground": ((*LAYER, vx.Clamp(on="top"), vx.TrescaFriction(0.5, on="bottom", ground=uniform(bump))), 2),
    "support": ((*LAYER, vx.PrescribedDisplacement(uniform(bump), on="top"), vx.TrescaFriction(0.5, on="bottom")), 2),
    "prestress": (sheared(bump), 3),
    "fast ripples": (sheared(fast_ripples), 32),
}


@pytest.mark.long
@mostly_slow("name", COURSES, "ground", "support")
def test_changes_between_instants_are_in_the_bound_and_in_a_warning(name, caplog):
    effects, steps = COURSES[name]
    scene, mesh, times = vx.Scene(*effects), vx.meshes.squares(1), np.linspace(0.0, 1.0, steps + 1)
    # For piecewise linear data, steps that end at the bends of the data are exact.
    finer = np.union1d(times, np.linspace(0.0, 1.0, 101 if name in ("ground", "support") else 2001))
    history, fine = vx.simulate(scene, mesh, times), vx.simulate(scene, mesh, finer)
    caplog.clear()
    with caplog.at_level("WARNING", logger="vemcvx"):
        bound = vx.error_bound(history)
    assert "error_bound: data" in caplog.text
    assert "or are not linear in time" in caplog.text
    at = np.searchsorted(fine.times, times - 1e-12)
    circle = circle_of(fine)
    for n in range(1, steps + 1):
        apart = energy_distance(circle, history.displacement[n], fine.displacement[at[n]])
        # The term 1e-16 allows for rounding where nothing moves.
        assert apart <= bound.upper[n] * (1.0 + 1e-9) + 1e-16
    assert bound.kind == "bound for data as read at instants"
