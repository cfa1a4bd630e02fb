"""Error bounds if several effects share an edge: inclined supports, friction and obstacles.

The top of a block is clamped. Constant tractions on the other sides cause the displacement u = (1 - y) b, with a vector
b. Virtual elements are exact for this displacement, so the bound is zero to rounding.
"""

from __future__ import annotations

import numpy as np
import pytest
from scenes import mostly_long

import vemcvx as vx

pytestmark = pytest.mark.arithmetic

STEEL = vx.Elasticity(young=200.0, poisson=0.0)
SHEAR, YOUNG, GAP, PRESSURE, BOUND = 100.0, 200.0, 0.01, 1.0, 2.0


def bounded(*effects):
    return vx.error_bound(vx.simulate(vx.Scene(*effects), vx.meshes.squares(3), [0.0, 1.0]), step=-1)


def grows(*force):
    return lambda x, t: np.tile(t * np.array(force), (len(x), 1))


@mostly_long("angle", [20.0, 70.0, 40.0, 50.0])
def test_the_bound_of_an_inclined_support_with_friction_and_an_obstacle_is_zero(angle):
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    # The support prevents motions along (c, s). The bottom slides at right angles to (c, s), down to the obstacle.
    b = np.array([GAP * s / c, -GAP])
    lift = (YOUNG * b[1] - PRESSURE) - (SHEAR * b[0] + BOUND) * s / c
    found = bounded(
        STEEL,
        vx.Clamp(on="top"),
        vx.PrescribedDisplacement(0.0, on="bottom", direction=(c, s)),
        vx.Traction(grows(0.0, -SHEAR * b[0]), on="right"),
        vx.Traction(grows(0.0, SHEAR * b[0]), on="left"),
        vx.Traction(grows(0.0, lift), on="bottom"),
        vx.UnilateralContact(on="bottom", gap=GAP),
        vx.TrescaFriction(BOUND, on="bottom", while_closed=False),
    )
    J = 0.5 * (YOUNG * b[1] ** 2 + SHEAR * b[0] ** 2) - lift * b[1] + BOUND * abs(b[0])
    assert found.upper <= 1e-6
    assert found.potential == pytest.approx((J, J), rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("direction", [(0.5, 1.0), (1.0, 0.5)])
def test_a_bump_between_nodes_increases_the_bound_of_a_body_on_an_inclined_support(direction):
    def bound_over(height):
        def gap(x, t):
            return 1e-2 - height * (np.abs(x[:, 0] - 0.5) < 0.1)

        return bounded(
            STEEL,
            vx.Clamp(on="top"),
            vx.PrescribedDisplacement(0.0, on="bottom", direction=direction),
            vx.Traction(grows(0.0, -10.0 * direction[1]), on="right"),
            vx.UnilateralContact(on="bottom", gap=gap),
        )

    # The bump is between nodes, so the computed body penetrates the bump.
    bumped, flat = bound_over(9e-3), bound_over(0.0)
    assert bumped.potential[1] > flat.potential[1] + 1e-6
    assert bumped.upper > 1.1 * flat.upper


@pytest.mark.long
def test_splitting_friction_into_two_effects_keeps_the_error_bound():
    def belt(x, t):
        return 0.02 * t, 0.0

    def rubbed(*bounds):
        block = STEEL, vx.Clamp(on="top"), vx.BilateralContact(on="bottom")
        return bounded(*block, *(vx.TrescaFriction(g, on="bottom", ground=belt) for g in bounds))

    one, two = rubbed(1.5), rubbed(1.0, 0.5)
    assert two.upper == pytest.approx(one.upper)
    assert two.potential == pytest.approx(one.potential)
