"""`vx.instants` finds extrema and kinks of data in time."""

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
def test_instants_are_where_data_turn_and_bend(pull, turning, n):
    """The vertex of a parabola through samples of f with the spacing h has an error of at most f''' h^2 / (6 f'')."""
    load = vx.Traction(lambda x, t: np.broadcast_to(np.stack(pull(x, t), axis=-1), x.shape), on="top")
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="bottom"), load)
    found = np.setdiff1d(vx.instants(scene, vx.meshes.squares(n), [0.0, 1.0]), [0.0, 1.0])
    assert found == pytest.approx(turning, abs=1e-5)
