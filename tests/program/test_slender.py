"""A strip a hundred thousand times as long as high: the factors keep few digits, what is refined is consistent."""

from __future__ import annotations

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.base.arrays import EPS
from vemcvx.estimate.budget import error_budget
from vemcvx.scene import pose_scene

pytestmark = pytest.mark.arithmetic

HEIGHT = 1e-5
TIMES = (0.0, 0.5, 1.0)
MESH = vx.meshes.squares((6, 2), box=((0.0, 1.0), (0.0, HEIGHT)))


def pull(x, t):
    return t * np.column_stack([np.ones(len(x)), np.full(len(x), -0.01 * HEIGHT)])


def strip(friction):
    return vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=friction * HEIGHT, on="bottom"),
    )


def square(K, y):
    """y'Ky in extended precision."""
    return float(y.astype(np.longdouble) @ (K.toarray().astype(np.longdouble) @ y.astype(np.longdouble)))


@pytest.mark.parametrize("friction", [0.5, 5.0])
def test_what_is_told_of_a_state_is_of_that_state(friction):
    newton = vx.Newton(accuracy=1e-5)
    runs = [vx.simulate(strip(friction), MESH, TIMES, condense=condense, solver=newton) for condense in (True, False)]
    posed = pose_scene(strip(friction), MESH)
    columns, K = posed.supports.columns, posed.system.K
    for history in runs:
        y = history.displacement.reshape(len(TIMES), -1)[:, columns]
        energy = [0.5 * square(K, state) for state in y]
        # Terms y_i K_ij y_j are a million times their sum, and each is rounded.
        rounding = 8 * EPS * max(float(np.abs(state) @ (abs(K) @ np.abs(state))) for state in y)
        assert history.energy == pytest.approx(energy, rel=1e-12, abs=rounding)
        slips = np.abs(np.diff(history.contact.slip[:, :, 0], axis=0))
        lengths = posed.system.norms.weights(1.0) / (friction * HEIGHT)
        assert np.diff(history.dissipated) == pytest.approx(friction * HEIGHT * slips @ lengths, rel=1e-12)
        assert slips[history.contact.sticking[1:]].max(initial=0.0) <= 1e-12 * slips.max()
        # In each of two steps, forces r out of balance do the work r.du <= |r|_(K^-1) |du|_K <= 2 certificate |u|^2.
        steps = [0.5 * square(K, y[n + 1] - y[n]) for n in range(len(TIMES) - 1)]
        left = history.work - history.energy - history.dissipated
        assert left[1:] == pytest.approx(np.cumsum(steps), abs=8 * history.certificate.max() * history.energy.max())
        assert 0 < history.certificate.max() < 1e-5
    one, other = runs
    allowed = (one.certificate + other.certificate).cumsum()
    assert (np.abs(one.energy - other.energy) <= 3 * allowed * one.energy.max()).all()
    assert one.contact.sticking.sum() == other.contact.sticking.sum()
    assert (one.contact.sticking[1:].any(), one.contact.sticking[1:].all()) == (friction == 5.0, False)


@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")
@pytest.mark.parametrize("condense", [True, False])
def test_a_column_that_nothing_clamps_is_answered_to_twelve_digits(condense):
    """Settled, then left alone: what the anchors do is taken away again."""
    scene = vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.0),
        vx.Symmetry(on=["left", "right"]),
        vx.Traction((0.0, -2.0), on="top"),
        vx.UnilateralContact(on="bottom"),
    )
    history = vx.simulate(
        scene, vx.meshes.squares(4), [0.0, 1.0], initial="settled", solver=vx.Newton(accuracy=1e-12), condense=condense
    )
    # A uniform stress of 2: energy 2^2 / 2E, in a column of area one.
    assert history.energy == pytest.approx([0.01, 0.01], rel=1e-12)
    assert history.certificate.max() < 1e-12
    assert error_budget(history).space.max() < 1e-12
