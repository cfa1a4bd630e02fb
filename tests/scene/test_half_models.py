"""The axis of a half model belongs to contact: half of a body shows what the whole shows, its peak pressure as well."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.scene import pose_scene

TIMES = np.linspace(0.0, 1.0, 5)
CONTACTS = {
    "rigid": (vx.UnilateralContact(on="bottom", gap=lambda x, t: 0.02 * x[:, 0] ** 2),),
    "soft": (vx.NormalCompliance(2000.0, on="bottom", gap=lambda x, t: 0.02 * x[:, 0] ** 2),),
    "bilateral": (vx.BilateralContact(on="bottom"),),
    "Tresca": (vx.UnilateralContact(on="bottom"), vx.TrescaFriction(0.4, on="bottom")),
    "Tresca, bilateral": (vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.4, on="bottom")),
    "Coulomb": (vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.2, on="bottom")),
}


def pressed(x, t):
    return np.column_stack([0.0 * x[:, 0], -0.03 * t * (1 - 0.3 * x[:, 0] ** 2)])


def scene(*more):
    return vx.Scene(vx.Elasticity(200.0, 0.3), vx.PrescribedDisplacement(pressed, on="top"), *more)


@pytest.mark.long
@pytest.mark.parametrize("contact", CONTACTS)
@pytest.mark.parametrize(
    "axis", [vx.Symmetry(on="left"), vx.PrescribedDisplacement(0.0, on="left", direction="normal")]
)
def test_a_half_shows_what_the_whole_shows(contact, axis):
    half_mesh, mesh = (vx.meshes.squares(4, box=((low, 1), (0, 1))) for low in (0, -1))
    whole = vx.simulate(scene(*CONTACTS[contact]), mesh, TIMES, solver=vx.Newton())
    half = vx.simulate(scene(axis, *CONTACTS[contact]), half_mesh, TIMES, solver=vx.Newton())
    right = whole.contact.points[:, 0] > -1e-12
    one, two = half.contact, whole.contact
    assert np.abs(one.points - two.points[right]).max() < 1e-14
    assert (np.abs(one.points[:, 0]) < 1e-14).sum() == 1
    # Nodes of the axis have half of their edges in the half. Fixed points stop at 1e-8 of the energy norm.
    middle = np.abs(one.points[:, 0]) < 1e-14
    assert one.lengths == pytest.approx(two.lengths[right] * np.where(middle, 0.5, 1.0), rel=1e-14)
    loose = 1e-6 if contact == "Coulomb" else 1e-10
    for name in ("pressure", "traction", "slip", "bound", "wear"):
        mine, theirs = getattr(one, name), getattr(two, name)[:, right]
        assert np.abs(mine - theirs).max() <= loose * max(np.abs(theirs).max(), 1e-3), name
    assert np.array_equal(one.sticking[1:, middle], np.ones((4, 1)))
    assert np.array_equal(one.closed, two.closed[:, right])
    load = half.reaction("bottom")[:, 1]
    assert one.pressure @ one.lengths == pytest.approx(load, abs=1e-10 * load.max())
    assert one.pressure[-1].argmax() == 0 or contact != "rigid"


@pytest.mark.long
def test_hertz_line_contact_carries_its_whole_load():
    """The nodal pressures bear the measured load, and the one on the axis is Hertz' peak, to the mesh's 2 %."""
    path = Path(__file__).parents[2] / "problems" / "hertz_contact.py"
    spec = importlib.util.spec_from_file_location("hertz", path)
    hertz = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(hertz)
    history = vx.simulate(hertz.scene(), hertz.mesh(20), hertz.times(2))
    contact, load = history.contact, history.reaction("bottom")[-1, 1]
    # Both are functionals of the answer: an energy error e is at most e |v|_a in them, v linear from floor to top.
    A, y = pose_scene(history.scene, history.mesh).A, history.mesh.points[:, 1]
    v = np.column_stack([0 * y, 1 - y / y.max()]).ravel()
    error = (history.certificate + history.certificate_floor)[-1] * history.trajectory.norm.max()
    slack = 2 * error * np.sqrt(v @ (A @ v))
    assert slack < 1e-9 * load
    assert contact.pressure[-1] @ contact.lengths == pytest.approx(load, abs=slack)
    axis = np.argmin(contact.points[:, 0])
    assert contact.points[axis, 0] == 0.0
    a = np.sqrt(4 * 2 * load * hertz.RADIUS * (1 - hertz.POISSON**2) / (np.pi * hertz.YOUNG))
    assert contact.pressure[-1, axis] == pytest.approx(2 * 2 * load / (np.pi * a), rel=0.02)
    assert contact.pressure[-1].argmax() == axis
    missing = contact.pressure[-1, axis] * contact.lengths[axis] / load
    assert missing > 0.01, "without its axis a half model loses a good part of its load"
