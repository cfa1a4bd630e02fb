"""Scenes and histories without an error bound are refused with the reason."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from test_error_bound import STEEL

import vemcvx as vx
from vemcvx.effects import Contribution, Effect, Friction

pytestmark = pytest.mark.arithmetic


@dataclass(frozen=True)
class Rubs(Effect):
    """Friction whose edges are unknown."""

    weight: float = 0.0

    def contribute(self, space):
        friction = Friction.from_rows(space.part("top", "Rubs", contact=True).node_normals, "Rubs")
        weights = self.weight * friction.lengths
        return Contribution(frictions=(replace(friction, weights=lambda t: weights, ends=None),))

    def describe(self):
        return "Rubs"


PRESSED = vx.Traction(lambda x, t: np.tile([0.0, -t], (len(x), 1)), on="right")
INSIDE = vx.Elasticity(young=lambda x: 1.0 + 199.0 * (abs(x[:, 0] - 0.5) < 0.3), poisson=0.3)


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        # This friction has the weight zero.
        ((STEEL, Rubs()), "no bound for Rubs, whose edges are not known"),
        (
            (STEEL, vx.BilateralContact(on="top"), Rubs(1.0)),
            "no estimate for Rubs, whose edges are not known\\. .* by ends=",
        ),
        # The smaller of both gaps has a kink between nodes.
        (
            (STEEL, *(vx.UnilateralContact("top", lambda x, t, k=k: 0.1 + abs(k - x[:, 0])) for k in (0, 1))),
            "if UnilateralContact on top and another obstacle of the same kind act on the same edge",
        ),
        # All nodes are held, so the computed strain is zero.
        ((INSIDE, vx.Clamp(on="boundary"), vx.BodyForce(lambda x, t: (0.0, -t))), "vary inside cells"),
    ],
)
def test_scenes_without_a_bound_are_refused(effects, message):
    scene = vx.Scene(vx.Clamp(on="bottom"), PRESSED, *effects)
    history = vx.simulate(scene, vx.meshes.squares(2), [0.0, 1.0])
    with pytest.raises(vx.SceneError, match=message):
        vx.error_bound(history, step=-1)


def waves(x, t):
    return np.column_stack([1e-3 * np.sin(np.pi * x[:, 0]), np.zeros(len(x))])


def test_histories_that_begin_at_a_projected_function_have_no_bound():
    """Without the refusal, the bound would be 9e-18 for an error of .002."""
    bar = vx.Scene(vx.Elasticity(200.0, 0.0), vx.Clamp(on="left"), vx.Symmetry(on=["top", "bottom"]))
    held = bar.with_(vx.BilateralContact(on="right"), vx.TrescaFriction(10.0, on="right"))
    history = vx.simulate(held, vx.meshes.squares(4), [0.0, 1.0], initial=vx.projected(waves))
    with pytest.raises(vx.SceneError, match=r"begins at vx\.projected\(u_0\).* is unknown"):
        vx.error_bound(history)
    assert vx.error_bound(history, step=1).kind == "bound"


def test_cells_that_are_not_star_shaped_about_their_centroids_have_no_bound():
    u_shape = vx.PolygonMesh([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], [list(range(8))])
    history = vx.simulate(vx.Scene(STEEL, vx.Clamp(on="boundary")), u_shape, [0.0, 1.0])
    with pytest.raises(vx.SceneError, match="cell 0 is not star-shaped about its centroid; cut it"):
        vx.error_bound(history, step=-1)
