"""Bounds and the data that they read: what lies between points of assembly, and between the points that bounds read."""

from __future__ import annotations

import numpy as np
import pytest

import vemcvx as vx

pytestmark = pytest.mark.arithmetic

STEEL = vx.Elasticity(young=200.0, poisson=0.3)
BAR = (vx.Elasticity(1.0, 0.0), vx.Symmetry(on=["top", "bottom"]))


def along(of):
    """A datum along x that grows in time."""
    return lambda x, t: t * np.column_stack([of(x), 0.0 * x[:, 0]])


def strip(x):
    return 1.0 * (abs(x[:, 0] - 0.4398) < 0.025)


def patch(x):
    return 1.0 * (abs(x[:, 1] - 0.375) < 0.04)


def run(*effects, n=4):
    return vx.simulate(vx.Scene(*effects), vx.meshes.squares(n), [0.0, 1.0])


# What assembles as zero.

STRIP = (*BAR, vx.Symmetry(on="right"), vx.BodyForce(along(strip)))
PRESSED = (vx.Elasticity(1.0, 0.3), vx.Clamp(on="right"))


@pytest.mark.parametrize(
    ("effects", "true"),
    [
        (STRIP, 0.0371),
        ((*STRIP, vx.BodyForce(lambda x, t: (1e-3 * t, 0.0))), 0.0371),
        ((*PRESSED, vx.Traction(along(patch), on="left")), 0.00723),
        ((*PRESSED, vx.Pressure(lambda x, t: t * patch(x), on="left")), 0.00723),
    ],
)
def test_loads_that_assemble_as_zero_are_in_the_bound(effects, true):
    history = run(*effects)
    assert vx.error_bound(history, -1).upper >= true


@pytest.mark.long
def test_loads_that_assemble_as_zero_are_in_the_bounds_of_runs_and_of_meshes():
    scene, mesh = vx.Scene(*PRESSED, vx.Traction(along(patch), on="left")), vx.meshes.squares(4)
    history = vx.simulate(scene, mesh, [0.0, 1.0], bound=True)
    assert history.inactive
    assert history.bound["upper"] >= 0.00723
    found = vx.adapt(scene, mesh, [0.0, 1.0], target=0.3, estimate="bound")
    assert found.history.mesh.n_cells > mesh.n_cells


RUBS = vx.TrescaFriction(lambda x, t: 60.0 * ((x[:, 0] > 0.28) & (x[:, 0] < 0.47)), on="bottom")


@pytest.mark.long
def test_friction_that_is_zero_at_nodes_holds_all_the_same():
    """A finer run, where nodes see it, moves by .02994; without it the body moves by .0345."""
    push = vx.Traction(lambda x, t: (8.0 * t, 0.0), on="left")
    history = run(STEEL, vx.Clamp(on="right"), push, vx.BilateralContact(on="bottom"), RUBS)
    assert history.inactive
    bound = vx.error_bound(history, -1, of=vx.Traction((1.0, 0.0), on="left"))
    assert bound.certain[0] <= 0.02994 <= bound.certain[1]
    assert vx.error_bound(history, -1).upper >= 0.03
    whole = vx.error_bound(history)
    assert whole.upper[-1] >= vx.error_bound(history, -1).upper
