"""User-defined functions cannot change their arguments, and the package copies their results immediately."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import monotone, paper_load, paper_scene, small

import vemcvx as vx

K = np.array([[4.0, -1.0], [-1.0, 3.0]])
TIMES = [0.0, 0.5, 1.0]


def reuse_buffer(function):
    """Return a function that writes all results into one array."""
    kept = []

    def write(*given):
        kept.append(np.zeros_like(function(*given)))
        kept[0][:] = function(*given)
        return kept[0]

    return write


def load(t):
    return np.array([5 * t, -2 * t])


def test_functions_of_a_system_may_return_one_buffer_for_all_instants():
    def system(wrap):
        norms = vx.Norms(np.eye(2), wrap(lambda t: np.array([t, 0.1 + t])))
        limits = vx.Limits(np.eye(2), wrap(lambda t: np.array([0.5 * t, 1.0])))
        return vx.System(K, wrap(load), norms, limits=limits, damping=vx.Damping(np.eye(2)))

    fresh, same = (vx.march(system(wrap), TIMES) for wrap in (lambda f: f, reuse_buffer))
    assert np.abs(fresh.state[-1]).max() > 0.1
    for name in ("state", "multipliers", "pressures", "energy", "work", "dissipated", "gap"):
        np.testing.assert_array_equal(getattr(same, name), getattr(fresh, name))


def test_functions_of_a_scene_may_return_one_buffer_for_all_instants():
    def scene(wrap):
        parts = (e for e in paper_scene() if not isinstance(e, (vx.Traction, vx.TrescaFriction)))
        bound = wrap(lambda x, t: 1.0 + t + 0 * x[:, 0])
        return vx.Scene(*parts, vx.Traction(wrap(paper_load(monotone)), "left"), vx.TrescaFriction(bound, "bottom"))

    fresh, same = (vx.simulate(scene(wrap), small("squares", 4), TIMES) for wrap in (lambda f: f, reuse_buffer))
    np.testing.assert_array_equal(same.displacement, fresh.displacement)
    np.testing.assert_array_equal(same.work, fresh.work)


def spoil(x, t=0.0):
    x -= 0.5
    return x


@pytest.mark.parametrize(
    "use",
    [
        lambda mesh: vx.simulate(
            vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp("right"), vx.BodyForce(spoil)), mesh, TIMES
        ),
        lambda mesh: vx.simulate(
            vx.Scene(vx.Elasticity(lambda x: spoil(x)[:, 0], 0.3), vx.Clamp("right")), mesh, TIMES
        ),
        lambda mesh: mesh.with_boundary("low", lambda x: spoil(x)[:, 1] < 0),
        lambda mesh: vx.march(vx.System(K, load, vx.Norms(np.eye(2), 0.0, law=vx.Law(spoil_law)), limits=FLOOR), TIMES),
    ],
    ids=["load", "modulus", "boundary", "law"],
)
def test_functions_cannot_change_their_arguments(use):
    mesh = small("squares", 4)
    before = mesh.points.copy()
    with pytest.raises(vx.VemcvxError, match="read-only"):
        use(mesh)
    np.testing.assert_array_equal(mesh.points, before)


FLOOR = vx.Limits(np.eye(2), 0.1)


def spoil_law(t, p, past, slip):
    p += 1.0
    return p
