"""Programs without unknowns or without terms: every solver takes them, and cvxpy is not even asked."""

from __future__ import annotations

import numpy as np
import pytest

import vemcvx as vx


@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel(), vx.OSQP(), vx.Direct()], ids=lambda s: s.name)
def test_a_scene_without_friction(solver):
    scene = vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp("left"), vx.Traction(lambda x, t: t * x, "right"))
    mesh, times = vx.meshes.squares(3), np.linspace(0, 1, 4)
    history = vx.simulate(scene, mesh, times, solver=solver)
    assert np.array_equal(history.displacement, vx.simulate(scene, mesh, times).displacement)
    assert history.certificate.max() < 1e-14
