"""A sheared block in space: closed forms of Tresca's and Coulomb's friction."""

import numpy as np
import pytest
from solids import SOLIDS, solid

import vemcvx as vx

MU, HEIGHT, BOUND, PRESS = 10.0, 0.8, 1.0, 0.1
BOX = ((0.0, 1.0), (0.0, 1.2), (0.0, HEIGHT))
PATH = np.array([(0, 0), (0.05, 0.02), (0.15, 0.05), (0.2, 0.2), (0.05, 0.25), (-0.15, 0.05), (0.0, -0.1)])
TIMES = np.arange(float(len(PATH)))
SIDES = ("left", 0, -1), ("right", 0, 1), ("front", 1, -1), ("back", 1, 1)


def closed_form():
    """Return the slips a and the stresses q = MU (U - a) / HEIGHT on the floor, for motions U of the top."""
    a, q = [np.zeros(2)], [np.zeros(2)]
    for U in PATH[1:]:
        trial = MU * (U - a[-1]) / HEIGHT
        q.append(trial * min(1.0, BOUND / np.linalg.norm(trial)))
        a.append(U - q[-1] * HEIGHT / MU)
    return np.array(a), np.array(q)


def sheared(q, *effects, press=0.0):
    """Return the scene of a block whose top moves along PATH. A pressed block has nu = 0 and does not bulge."""

    def side(axis, sign):
        return lambda x, t: [0.0, 0.0, sign * q[round(t), axis]]

    top = vx.PrescribedDisplacement(lambda x, t: [*PATH[round(t)], -press], on="top")
    sides = (vx.Traction(side(axis, sign), on=name) for name, axis, sign in SIDES)
    steel = vx.Elasticity(2 * MU, 0.0) if press else vx.Elasticity(2.6 * MU, 0.3)
    return vx.Scene(steel, top, *sides, *effects)


@pytest.mark.long
@pytest.mark.parametrize("is_pressed", [False, True])
@pytest.mark.parametrize("family", SOLIDS)
def test_a_sheared_block_follows_its_closed_form(family, is_pressed):
    a, q = closed_form()
    if is_pressed:
        friction = vx.CoulombFriction(BOUND * HEIGHT / (2 * MU * PRESS), on="bottom")
        scene = sheared(q, vx.UnilateralContact(on="bottom"), friction, press=PRESS)
    else:
        scene = sheared(q, vx.BilateralContact(on="bottom"), vx.TrescaFriction(BOUND, on="bottom"))
    initial, loose = ("settled", 1e-8) if is_pressed else (None, 1e-10)
    history = vx.simulate(scene, solid(family, 2, BOX), TIMES, initial=initial, solver=vx.Newton(1e-9))
    contact = history.contact
    assert np.abs(contact.slip[:, :, :2] - a[:, None]).max() < loose
    assert np.abs(contact.traction[:, :, :2] + q[:, None]).max() < 10 * loose
    assert np.abs(history.stress(-1)[:, [5, 4]] - q[-1]).max() < 10 * loose
    slips = ~contact.sticking
    assert slips[2:].any()
    moved = np.abs(np.diff(a, axis=0, prepend=0.0)).max(axis=1) > 1e-10
    np.testing.assert_array_equal(slips, np.broadcast_to(moved[:, None], slips.shape))
    size = np.linalg.norm(contact.traction, axis=2)
    assert contact.bound[slips] == pytest.approx(size[slips], abs=10 * loose)
    assert (size < contact.bound + 10 * loose).all()
    # Dissipation is force times slip. Accumulated slip is wear divided by the bound.
    work = np.append(0.0, np.cumsum(np.sum(q[1:] * np.diff(a, axis=0), axis=1)))
    assert contact.wear == pytest.approx(np.tile(work[:, None], contact.wear.shape[1]), abs=10 * loose)
    assert contact.accumulated_slip == pytest.approx(contact.wear / BOUND, abs=loose)
    # Uniform states have no discretisation error.
    if family == "cubes" and not is_pressed:
        assert vx.error_budget(history).space.max() < 1e-6 * np.sqrt(2 * history.energy.max())
