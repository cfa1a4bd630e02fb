"""Effects of one's own that give what is none, or read what they do not say: every refusal names them."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.effects import Contribution, Friction
from vemcvx.effects.contact import obstacle

BODY = vx.Elasticity(200.0, 0.3), vx.Clamp(on="right"), vx.Traction((0.0, -1.0), on="top")


@dataclass(frozen=True)
class Mine(vx.Effect):
    """A rigid obstacle with friction, some of it changed."""

    friction: object = None
    stop: object = None

    def contribute(self, space):
        rows = space.part("bottom", "Mine", contact=True).node_normals
        (stop,) = obstacle(space, rows, "Mine", 0.0, np.zeros(len(rows.nodes))).obstacles
        rubs = replace(Friction.of(rows, "Mine"), **(self.friction or {}))
        return Contribution(obstacles=(replace(stop, **(self.stop or {})),), frictions=(rubs,))

    def describe(self):
        return "Mine: on bottom"


def simulate(**changes):
    return vx.simulate(vx.Scene(*BODY, Mine(**changes)), vx.meshes.squares(2), [0, 1], initial="settled")


def softened(t, p, past, slip):
    return np.maximum(0.3 - past - slip, 0.1) * np.maximum(p, 0.0)


@pytest.mark.parametrize("law", [softened, lambda t, p, past, slip: 0.3 / (1.0 + past)])
def test_a_law_that_reads_slip_and_does_not_say_so_is_refused_by_name(law):
    with pytest.raises(vx.SceneError, match="^Mine: .*law of friction.*slips are told where slips=True says that"):
        simulate(friction={"law": vx.Law(law, pressed=True, slips=False)})


def test_a_slope_that_reads_slip_and_does_not_say_so_is_refused_by_name():
    law = vx.Law(lambda t, p, *_: 0.3 * p, pressed=True, slips=False, slope=lambda t, p, past: 0.3 * np.ones(len(past)))
    with pytest.raises(vx.SceneError, match="^Mine: slope: found an array of shape .*slips are told where slips=True"):
        simulate(friction={"law": law})


NOT_FINITE = {
    "compliance": {"stop": {"compliance": np.full(3, np.nan)}},
    "gap at t = 1": {"stop": {"gap": lambda t: np.full(3, np.inf if t else 0.0)}},
    "weights at t = 1": {"friction": {"weights": lambda t: np.full(3, np.nan if t else 1.0)}},
}


@pytest.mark.parametrize("name", NOT_FINITE)
def test_numbers_that_are_not_finite_are_refused_by_the_name_of_the_effect(name):
    with pytest.raises(vx.SceneError, match=f"^Mine: {name}: found NaN or infinite values"):
        simulate(**NOT_FINITE[name])


def test_numbers_of_other_rows_are_refused_by_the_name_of_the_effect():
    with pytest.raises(vx.SceneError, match=r"^Mine: gap at t = 0: found .* \(2,\); wanted one number, or \(3,\), one"):
        simulate(stop={"gap": lambda t: np.zeros(2)})
