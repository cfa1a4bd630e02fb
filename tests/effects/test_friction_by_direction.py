"""Friction by direction in space: closed forms of a sheared block, and Coulomb's law against Tresca's."""

import numpy as np
import pytest
from scipy.optimize import brentq
from solids import SOLIDS, solid

import vemcvx as vx

MU, HEIGHT = 10.0, 0.8
BOX = ((0.0, 1.0), (0.0, 1.2), (0.0, HEIGHT))
BOUND, ACROSS, ANGLE = 1.0, 0.4, 0.5
AXES = np.array([[np.cos(ANGLE), np.sin(ANGLE)], [-np.sin(ANGLE), np.cos(ANGLE)]])
ALONG = (*(3.0 * AXES[0]), 5.0)
"""A vector in the direction of friction; its length and its component normal to the floor do not matter."""
PATH = np.array([(0, 0), (0.05, 0.02), (0.15, 0.05), (0.2, 0.2), (0.05, 0.25), (-0.15, 0.05), (0.0, -0.1)])
TIMES = np.arange(float(len(PATH)))
BLOCK = vx.meshes.cubes(2, BOX)
SIDES = ("left", 0, -1), ("right", 0, 1), ("front", 1, -1), ("back", 1, 1)


def nearest(trial, across):
    """Return the friction of a block with one shear stiffness: the point of the ellipse nearest to a trial force."""
    at, squares = AXES @ trial, np.array([BOUND, across]) ** 2
    if across == 0.0:
        return AXES.T @ [np.clip(at[0], -BOUND, BOUND), 0.0]
    if np.sum(at**2 / squares) <= 1.0:
        return trial
    root = brentq(lambda far: np.sum(squares * (at / (squares + far)) ** 2) - 1.0, 0.0, 1e3, xtol=1e-15, rtol=1e-14)
    return AXES.T @ (at * squares / (squares + root))


def closed_form(across, path=PATH):
    """Return the slips a and the forces q = mu (U - a) / H on the floor, for motions U of the top along the path."""
    a, q = [np.zeros(2)], [np.zeros(2)]
    for U in path[1:]:
        q.append(nearest(MU * (U - a[-1]) / HEIGHT, across))
        a.append(U - q[-1] * HEIGHT / MU)
    return np.array(a), np.array(q)


def sheared(q, *effects, press=0.0, path=PATH):
    """Return the scene of a block whose top moves along the path; if the top presses, nu = 0 prevents bulges."""

    def side(axis, sign):
        return lambda x, t: [0.0, 0.0, sign * q[round(t), axis]]

    top = vx.PrescribedDisplacement(lambda x, t: [*path[round(t)], -press], on="top")
    sides = (vx.Traction(side(axis, sign), on=name) for name, axis, sign in SIDES)
    steel = vx.Elasticity(2 * MU, 0.0) if press else vx.Elasticity(2.6 * MU, 0.3)
    return vx.Scene(steel, top, *sides, *effects)


PRESS = 0.1
BEARS = 2 * MU * PRESS / HEIGHT


def tresca(across=None, **settings):
    way = {} if across is None else {"direction": ALONG, "across": across}
    return vx.BilateralContact(on="bottom"), vx.TrescaFriction(BOUND, on="bottom", **way, **settings)


def coulomb(across=None, **settings):
    """Return Coulomb's friction, which has the bounds of `tresca` under the pressure `BEARS`."""
    way = {} if across is None else {"direction": ALONG, "across": lambda x, t: across / BEARS}
    return vx.UnilateralContact(on="bottom"), vx.CoulombFriction(BOUND / BEARS, on="bottom", **way, **settings)


LAWS = {
    "a disc": (tresca, None),
    "an ellipse": (tresca, ACROSS),
    "an ellipse whose long axis is across": (tresca, 2.5),
    "a line": (tresca, 0.0),
    "Coulomb's disc": (coulomb, None),
    "Coulomb's ellipse": (coulomb, ACROSS),
}


def answer(law, mesh, across, path=PATH, **settings):
    _, q = closed_form(BOUND if across is None else across)
    pressed = {"press": PRESS} if law is coulomb else {}
    scene = sheared(q, *law(across, **settings), path=path, **pressed)
    initial = "settled" if law is coulomb else None
    return vx.simulate(scene, mesh, TIMES, initial=initial, solver=vx.Newton(1e-9))


@pytest.mark.long
@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("family", SOLIDS)
def test_a_sheared_block_follows_its_closed_form(family, name):
    """Patch test: at all nodes, forces lie on the ellipse, and slips are normal to the ellipse."""
    law, across = LAWS[name]
    a, q = closed_form(BOUND if across is None else across)
    history = answer(law, solid(family, 2, BOX), across)
    contact, loose = history.contact, 1e-8 if law is coulomb else 1e-10
    assert np.abs(contact.slip[:, :, :2] - a[:, None]).max() < loose
    assert np.abs(contact.traction[:, :, :2] + q[:, None]).max() < 10 * loose
    assert np.abs(history.stress(-1)[:, [5, 4]] - q[-1]).max() < 10 * loose
    slips = ~contact.sticking
    assert slips[2:].any()
    moved = np.abs(np.diff(a, axis=0, prepend=0.0)).max(axis=1) > 1e-10
    np.testing.assert_array_equal(slips, np.broadcast_to(moved[:, None], slips.shape))
    if across == 0.0:
        # Nodes that slide only at right angles to the direction of friction have friction below the bound.
        slips &= (np.abs(np.diff(a @ AXES[0], prepend=0.0)) > 1e-10)[:, None]
    # Where nodes slip, |friction| equals the bound in the direction of friction.
    size = np.linalg.norm(contact.traction, axis=2)
    assert contact.bound[slips] == pytest.approx(size[slips], abs=10 * loose)
    assert (size < contact.bound + 10 * loose).all()
    # Dissipation is force times slip; accumulated slip is wear divided by the bound.
    work = np.append(0.0, np.cumsum(np.sum(q[1:] * np.diff(a, axis=0), axis=1)))
    assert contact.wear == pytest.approx(np.tile(work[:, None], contact.wear.shape[1]), abs=10 * loose)
    assert contact.accumulated_slip == pytest.approx(contact.wear / BOUND, abs=loose)
    # Uniform states have no discretisation error.
    if family == "cubes" and law is tresca:
        assert vx.error_budget(history).space.max() < 1e-6 * np.sqrt(2 * history.energy.max())


def test_directions_are_projected_onto_the_surface():
    """Two sides of a block use different tangential components of one direction."""
    rubs = vx.TrescaFriction(2.0, on=["left", "front"], direction=lambda x: x * 0.0 + [1.0, 1.0, 2.0], across=1.0)
    touch = vx.UnilateralContact(on=["left", "front"], gap=1.0)
    terms = vx.scene.pose_scene(vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp(on="top"), touch, rubs), BLOCK).terms
    assert np.abs(np.einsum("mbd,md->mb", terms.tangents, terms.normals)).max() < 1e-15
    assert np.linalg.norm(terms.tangents, axis=2) == pytest.approx(np.tile([1.0, 0.5], (len(terms), 1)), rel=1e-14)
    left = terms.normals[:, 0] == -1.0
    assert terms.tangents[left, 0] == pytest.approx(np.tile([0.0, 1.0, 2.0] / np.sqrt(5.0), (left.sum(), 1)))
    assert (~left).any()


PUSHED = vx.Elasticity(200.0, 0.3), vx.Clamp(on="top"), vx.UnilateralContact(on="bottom")
BELT = {"on": "bottom", "direction": (1.0, 0.0, 0.0)}


def test_bounds_that_begin_at_zero_keep_their_ratio():
    """The ratio is evaluated at the first instant with friction."""
    rubs = vx.TrescaFriction(lambda x, t: t * (1 + x[:, 0]), across=lambda x, t: 0.5 * t * (1 + x[:, 0]), **BELT)
    scene = vx.Scene(*PUSHED, rubs)
    terms = vx.scene.pose_scene(scene, vx.meshes.cubes(2), [0.0, 1.0, 2.0]).terms
    assert np.linalg.norm(terms.tangents[:, 1], axis=1) == pytest.approx(0.5, rel=1e-15)
