"""Where the data of a run turn: the same instants on every mesh."""

import numpy as np
import pytest

import vemcvx as vx

WAY = 2.0 * np.pi


def turns(pull, n=2, times=(0.0, 1.0)):
    """The instants that are added."""
    load = vx.Traction(lambda x, t: np.broadcast_to(np.stack(pull(x, t), axis=-1), x.shape), on="top")
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="bottom"), load)
    return np.setdiff1d(vx.instants(scene, vx.meshes.squares(n), times), times)


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize(
    ("pull", "turning"),
    [
        pytest.param(lambda x, t: (np.sin(3.0 * t), 0.0), [np.pi / 6], id="to and fro"),
        pytest.param(lambda x, t: (np.sin(3.0 * t), t), [np.pi / 6], id="and onwards"),
        pytest.param(lambda x, t: (np.sin(WAY * t), 1.0 - np.cos(WAY * t)), [0.25, 0.5, 0.75], id="in a circle"),
        pytest.param(lambda x, t: (np.minimum(t, 0.3), max(0.0, min(t - 0.3, 0.3))), [0.3, 0.6], id="round corners"),
    ],
)
def test_turns_of_each_component_on_every_mesh(pull, turning, n):
    # The vertex of a parabola through samples h apart is off by f''' h^2 / (24 f''): 6e-6 of a run of 256.
    assert turns(pull, n) == pytest.approx(turning, abs=1e-5)


def test_a_wave_that_travels_turns_nowhere():
    assert not len(turns(lambda x, t: (np.sin(6.0 * x[:, 0] - 9.0 * t), 0.0 * x[:, 0]), 16))


def test_loads_on_two_sides_turn_each_at_its_own_instant():
    def load(turn, on):
        return vx.Pressure(lambda x, t: np.full(len(x), (t - turn) ** 2), on=on)

    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="bottom"), load(0.31, "left"), load(0.72, "right"))
    found = vx.instants(scene, vx.meshes.squares(4), [0.0, 1.0])
    assert found == pytest.approx([0.0, 0.31, 0.72, 1.0], abs=1e-9)
