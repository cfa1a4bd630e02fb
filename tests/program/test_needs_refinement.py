"""When factors are too coarse: by what they lose of strains, not by how well a solver holds a floating body."""

from __future__ import annotations

import numpy as np
import pytest
from installed import needs
from scipy.special import fdtri

import vemcvx as vx
from vemcvx.linear import SAMPLES
from vemcvx.program.condensation import TAIL, Condensation, needs_refinement
from vemcvx.scene import pose_scene

pytestmark = pytest.mark.arithmetic


def two_blocks(poisson, n=24):
    lower, upper = (vx.meshes.squares(n, box=((0, 1), y)) for y in ((0, 1), (1, 2)))
    scene = vx.Scene(
        vx.Elasticity(200.0, poisson),
        vx.Clamp(on="lower.bottom"),
        vx.Pressure(lambda x, t: np.ones(len(x)), on="upper.top"),
        vx.UnilateralContact(on="lower|upper"),
        vx.TrescaFriction(0.4, on="lower|upper"),
    )
    return pose_scene(scene, vx.meshes.bodies({"lower": lower, "upper": upper})).system


@pytest.mark.parametrize("linear", [vx.SuperLU(), pytest.param(vx.Pardiso(), marks=needs("pymklpardiso"))], ids=str)
def test_a_floating_body_needs_none_and_one_that_is_nearly_incompressible_does(linear):
    # One solve loses 2e-13 of an energy norm; the upper block, which anchors hold, is known to 3e-12 as a whole.
    assert not needs_refinement(Condensation(two_blocks(0.3), linear=linear), 1e-10)
    assert needs_refinement(Condensation(two_blocks(0.499999), linear=linear), 1e-8)


def test_the_tail_is_that_of_as_many_samples():
    assert pytest.approx(fdtri(1, SAMPLES, 1 - 1e-6), rel=1e-14) == TAIL
