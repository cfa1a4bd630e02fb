"""Errors name user-defined effects that are wrong. Doubtful scenes cause warnings."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.effects import Contribution, Friction
from vemcvx.effects.contact import obstacle

STEEL, HELD = vx.Elasticity(200.0, 0.3), vx.Clamp(on="right")


@dataclass(frozen=True)
class Mine(vx.Effect):
    """A rigid obstacle with friction. The dicts `friction` and `stop` replace fields."""

    friction: object = None
    stop: object = None

    def contribute(self, space):
        rows = space.part("bottom", "Mine", contact=True).node_normals
        (stop,) = obstacle(space, rows, "Mine", 0.0, np.zeros(len(rows.nodes))).obstacles
        rubs = replace(Friction.from_rows(rows, "Mine"), **(self.friction or {}))
        return Contribution(obstacles=(replace(stop, **(self.stop or {})),), frictions=(rubs,))

    def describe(self):
        return "Mine: on bottom"


def law(weights, slope=None):
    return {"law": vx.Law(weights, pressed=True, slips=False, slope=slope)}


OWN = {
    "a law": (law(lambda t, p, past, slip: (0.3 - past - slip) * p), "law of friction.*without slips=True"),
    "a slope": (law(lambda t, p, *_: 0.3 * p, lambda t, p, past: np.ones(len(past))), "slope.*slips=True"),
    "weights": ({"weights": lambda t: np.full(5, np.nan if t else 1.0)}, "weights at t = 0.5: found NaN"),
    "compliance": ({"compliance": np.full(5, np.nan)}, "compliance: found NaN"),
    "a gap": ({"gap": lambda t: np.full(5, np.inf if t else 0.0)}, "gap at t = 0.5: found NaN"),
    "other rows": ({"gap": lambda t: np.zeros(2)}, r"gap at t = 0: found .* \(2,\); wanted a number, or .* \(5,\)"),
}  # fmt: skip


@pytest.mark.parametrize(("given", "says"), OWN.values(), ids=OWN)
def test_an_impossible_effect_of_a_user_is_refused_by_name(given, says):
    mine = Mine(**{"stop" if given.keys() & {"gap", "compliance"} else "friction": given})
    scene = vx.Scene(STEEL, HELD, vx.Traction((0.0, -1.0), on="top"), mine)
    with pytest.raises(vx.SceneError, match=f"(?s)^Mine: .*{says}"):
        vx.simulate(scene, vx.meshes.squares(4), [0.0, 0.5, 1.0], initial="settled")


@pytest.mark.parametrize("mesh", [vx.meshes.triangles(2), vx.meshes.tetrahedra(1)], ids=["plane", "space"])
def test_simplices_near_incompressibility_cause_a_warning(mesh):
    with pytest.warns(vx.SceneWarning, match=r"^Elasticity: poisson = 0\.4999 on a mesh of .*, which lock near 1/2"):
        vx.simulate(vx.Scene(vx.Elasticity(200.0, 0.4999), vx.Clamp(on="bottom")), mesh, [0.0, 1.0])


def test_friction_without_contact_causes_a_warning():
    scene = vx.Scene(STEEL, HELD, vx.TrescaFriction(4.0, on="bottom"))
    with pytest.warns(vx.SceneWarning, match="^TrescaFriction on bottom: at 3 of 4 places nothing holds the body"):
        vx.simulate(scene, vx.meshes.squares(3), [0.0, 1.0])
