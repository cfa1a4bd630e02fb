"""Where the data of a run turn and bend: the same instants on every mesh."""

import numpy as np
import pytest
from scenes import mostly_long

import vemcvx as vx


@mostly_long("n", [1, 3], 1)
@pytest.mark.parametrize(
    ("pull", "turning"),
    [
        pytest.param(lambda x, t: (np.sin(3.0 * t), 0.0), [np.pi / 6], id="to and fro"),
        pytest.param(lambda x, t: (np.sin(9.0 * t), -0.2), [np.pi / 18, np.pi / 6, 5 * np.pi / 18], id="again"),
        pytest.param(lambda x, t: (np.minimum(t, 0.3), max(0.0, min(t - 0.3, 0.3))), [0.3, 0.6], id="round corners"),
    ],
)
def test_turns_and_bends_on_every_mesh(pull, turning, n):
    """Vertices of parabolas through samples h apart are off by f''' h^2 / (24 f'')."""
    load = vx.Traction(lambda x, t: np.broadcast_to(np.stack(pull(x, t), axis=-1), x.shape), on="top")
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="bottom"), load)
    found = np.setdiff1d(vx.instants(scene, vx.meshes.squares(n), [0.0, 1.0]), [0.0, 1.0])
    assert found == pytest.approx(turning, abs=1e-5)
