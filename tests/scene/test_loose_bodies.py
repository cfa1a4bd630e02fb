"""Errors name floating bodies. Contact with another body counts as a support."""

import logging
import re

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.scene import pose_scene

JOINT = "lower|upper"
STEEL = vx.Elasticity(10.0, 0.3)
FOOT, BOND, RUB = vx.Clamp(on="lower.bottom"), vx.BilateralContact(on=JOINT), vx.TrescaFriction(0.1, on=JOINT)


def blocks():
    return vx.meshes.bodies({"lower": vx.meshes.squares(2), "upper": vx.meshes.hexagons(3, box=((0.2, 1.2), (1, 2)))})


def test_contact_that_holds_a_body_to_another_causes_no_warning(caplog):
    with caplog.at_level(logging.INFO, logger="vemcvx"):
        posed = pose_scene(vx.Scene(STEEL, FOOT, BOND, RUB), blocks())
    assert posed.system.kernel.names == ("the translation (1, 0) of upper",)
    (said,) = caplog.messages
    assert "contact holds the body against the translation (1, 0) of upper. " in said


def test_rotations_are_named_by_their_axes():
    """A body on an inclined plane may rotate about the normal of the plane."""
    straight = vx.meshes.cubes(1, box=((0, 4), (0, 1), (0, 1)))
    c, s = np.cos(0.5), np.sin(0.5)
    points = straight.points @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    names = {name: faces for name, faces in straight.boundaries.items() if name != "boundary"}
    ground = vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.1, on="bottom")
    with pytest.warns(vx.SceneWarning, match="nothing but friction"):
        posed = pose_scene(vx.Scene(STEEL, *ground), vx.PolyhedralMesh(points, straight.cells, boundaries=names))
    assert posed.system.kernel.names[-1] == f"a rotation about ({s:.2g}, 0, {c:.2g}) of the body"


@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
def test_a_refusal_names_the_direction_of_the_load():
    rubs = vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.1, on="bottom")
    scene = vx.Scene(STEEL, *rubs, vx.Traction(lambda x, t: np.tile((-0.5 * t, 0.0), (len(x), 1)), on="top"))
    motion = re.escape("against the translation (-1, 0) of the body. The load pushes it in")
    with pytest.raises(vx.SceneError, match=motion):
        vx.simulate(scene, vx.meshes.squares(3), [0.0, 1.0])


def test_a_skew_body_in_space_is_held_by_a_clamp():
    """The coordinate axes are no principal axes of inertia, so rotations about these axes are not orthogonal."""
    block = vx.meshes.cubes(2)
    skew = block.points + np.column_stack([0 * block.points[:, :2], block.points[:, 0]])
    names = {name: faces for name, faces in block.boundaries.items() if name != "boundary"}
    mesh = vx.PolyhedralMesh(skew, block.cells, boundaries=names)
    push = vx.BodyForce(lambda x, t: [t, 0.0, 0.0])
    held = vx.simulate(vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="top"), push), mesh, [0.0, 1.0])
    assert held.reaction("top")[-1, 0] == pytest.approx(-1.0, rel=1e-9)
    with pytest.raises(vx.SceneError, match="nothing holds the body, and its loads do not balance: at t = 1"):
        vx.simulate(vx.Scene(vx.Elasticity(200.0, 0.3), push), mesh, [0.0, 1.0])


def test_an_interface_without_contact_is_logged(caplog):
    """Contact of one body with an obstacle is no contact between two bodies."""
    parts = {"a": vx.meshes.squares(2, box=((0, 2), (0, 1))), "b": vx.meshes.squares(2, box=((0, 1), (1, 2)))}
    mesh = vx.meshes.bodies(parts)
    scene = vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp(on=["a.bottom", "b.top"]), vx.UnilateralContact(on="a.top"))
    vx.simulate(scene, mesh, [0.0, 1.0])
    (said,) = [words for words in caplog.messages if "no contact" in words]
    assert said.startswith("interface 'a|b': no contact acts on it, so that a and b may overlap.")
    caplog.clear()
    vx.simulate(scene.with_(vx.UnilateralContact(on="a|b")), mesh, [0.0, 1.0])
    assert not [words for words in caplog.messages if "no contact" in words]
