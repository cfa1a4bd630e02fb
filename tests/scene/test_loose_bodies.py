"""Bodies that only contact holds are named; that contact holds them is no cause for a warning."""

import logging
import re

import numpy as np
import pytest
from scenes import mostly_long

import vemcvx as vx
from vemcvx.scene import pose_scene

JOINT = "lower|upper"
STEEL = vx.Elasticity(10.0, 0.3)
FOOT, BOND, RUB = vx.Clamp(on="lower.bottom"), vx.BilateralContact(on=JOINT), vx.TrescaFriction(0.1, on=JOINT)


def blocks():
    return vx.meshes.bodies({"lower": vx.meshes.squares(2), "upper": vx.meshes.hexagons(3, box=((0.2, 1.2), (1, 2)))})


@pytest.mark.parametrize(
    ("effects", "says"),
    [
        ((FOOT, BOND), r"the body floats: 1 .* friction: the translation \(1, 0\) of upper\. Add Clamp"),
        ((FOOT,), r"part 2 of 2 of the body floats: 3 rigid motions .* of upper\. "),
        ((BOND,), r"the body floats: 1 rigid motion .* of (lower|upper)\. "),
        ((vx.Clamp(on="upper.top"), BOND), r"the body floats: 1 .* friction: the translation \(1, 0\) of lower\. "),
    ],
)
def test_what_floats_is_named(effects, says):
    with pytest.raises(vx.SceneError, match=rf"^supports: {says}"):
        pose_scene(vx.Scene(STEEL, *effects), blocks())


@pytest.mark.parametrize("above", [vx.UnilateralContact(on="top"), vx.NormalCompliance(1.0, on="top")], ids=repr)
def test_what_slides_between_oblique_sides_floats(above):
    """Contact across the motion feels its rounding alone; relative to that it once was felt, and warned of."""
    straight = vx.meshes.squares(2)
    turn = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    names = {name: edges for name, edges in straight.boundaries.items() if name != "boundary"}
    mesh = vx.PolygonMesh(straight.points @ turn, straight.cells, boundaries=names)
    with pytest.raises(vx.SceneError, match=r"^supports: the body floats: 1 rigid motion .*n \(0\.96, 0\.3\)"):
        pose_scene(vx.Scene(STEEL, vx.Symmetry(on="bottom"), above), mesh)


def test_to_be_held_by_contact_is_the_normal_case_between_bodies(caplog):
    with caplog.at_level(logging.INFO, logger="vemcvx"):
        posed = pose_scene(vx.Scene(STEEL, FOOT, BOND, RUB), blocks())
    assert posed.system.kernel.names == ("the translation (1, 0) of upper",)
    (said,) = caplog.messages
    assert "contact holds the body against the translation (1, 0) of upper. " in said


def test_each_motion_is_of_one_body_where_that_can_be():
    ground = vx.BilateralContact(on="lower.bottom"), vx.TrescaFriction(0.1, on="lower.bottom")
    kernel = pose_scene(vx.Scene(STEEL, *ground, BOND, RUB), blocks()).system.kernel
    assert kernel.names == ("the translation (1, 0) of lower", "the translation (1, 0) of upper")
    ways = {kernel.name(np.array([sign, 0.0])) for sign in (1.0, -1.0)}
    assert ways == {kernel.names[0], "the translation (-1, 0) of lower"}


def test_rotations_are_named_by_their_axes():
    """Of long bodies at an angle these are none of the orthonormal motions: a rotation about (0.79, 0, 0.62), once."""
    straight = vx.meshes.cubes(1, box=((0, 4), (0, 1), (0, 1)))
    c, s = np.cos(0.5), np.sin(0.5)
    points = straight.points @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    names = {name: faces for name, faces in straight.boundaries.items() if name != "boundary"}
    ground = vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.1, on="bottom")
    with pytest.warns(vx.SceneWarning, match="nothing but friction"):
        posed = pose_scene(vx.Scene(STEEL, *ground), vx.PolyhedralMesh(points, straight.cells, boundaries=names))
    assert posed.system.kernel.names[-1] == f"a rotation about ({s:.2g}, 0, {c:.2g}) of the body"


@pytest.mark.long
def test_a_step_without_equilibrium_names_the_body():
    pull = vx.Traction(lambda x, t: [t, 0.0], on="upper.left")
    force = r"The load pushes it in this motion with a force of 1, and friction resists with at most 0\.08"
    with pytest.raises(vx.SceneError, match=rf"hold the body against the translation \(1, 0\) of upper\. {force}"):
        vx.simulate(vx.Scene(STEEL, FOOT, BOND, RUB, pull), blocks(), [0.0, 1.0])


def turning(way):
    """Forces that turn a unit square or cube about its middle, in space about the axis z."""

    def turned(x, t):
        r = x - 0.5
        return way * t * np.column_stack([-r[:, 1], r[:, 0], *(0 * r[:, 2:].T)])

    return turned


def pushing(*force):
    return lambda x, t: np.tile(t * np.array(force), (len(x), 1))


SQUARE, CUBE = vx.meshes.squares(3), vx.meshes.cubes(2)
ALONG = (vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.1, on="bottom"))
AROUND = (vx.TrescaFriction(0.1, on="boundary"),)


@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
@mostly_long(
    "mesh, held, load, motion",
    [
        (SQUARE, ALONG, pushing(0.5, 0.0), "the translation (1, 0)"),
        (SQUARE, ALONG, pushing(-0.5, 0.0), "the translation (-1, 0)"),
        (SQUARE, AROUND, turning(1.0), "an anticlockwise rotation"),
        (CUBE, ALONG, pushing(-0.5, 0.0, 0.0), "the translation (-1, 0, 0)"),
        (CUBE, ALONG, pushing(0.3, -0.3, 0.0), "the translation (0.71, -0.71, 0)"),
        (CUBE, ALONG, turning(-2.0), "a rotation about (0, 0, -1)"),
    ],
    *(1, 5),
)
def test_a_refusal_says_where_the_load_pushes(mesh, held, load, motion):
    """Loads to the left were said to push to the right."""
    scene = vx.Scene(STEEL, *held, vx.Traction(load, on="boundary" if held is AROUND else "top"))
    with pytest.raises(vx.SceneError, match=re.escape(f"against {motion} of the body. The load pushes it in")):
        vx.simulate(scene, mesh, [0.0, 1.0])


def test_a_body_with_a_crack_is_one_body():
    """Its two sides have names, it has none of them: that friction alone holds it is said as ever."""
    mesh = vx.meshes.squares(4)
    x, y = mesh.centroids.T
    cracked = mesh.cut("crack", {"above": (y > 0.5) & (x < 0.5), "below": (y < 0.5) & (x < 0.5)})
    ground = vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.1, on="bottom")
    with pytest.warns(vx.SceneWarning, match=r"holds the body against the translation \(1, 0\) of the body"):
        pose_scene(vx.Scene(STEEL, *ground), cracked)


def test_a_skew_body_in_space_is_held_by_a_clamp():
    """Its axes are none of inertia: rotations about them are not orthogonal, and were once taken to be."""
    block = vx.meshes.cubes(2)
    skew = block.points + np.column_stack([0 * block.points[:, :2], block.points[:, 0]])
    arrays = {name: getattr(block, name) for name in block.ARRAYS if name != "points"}
    names = {name: faces for name, faces in block.boundaries.items() if name != "boundary"}
    mesh = vx.PolyhedralMesh.unchecked(skew, *arrays.values()).with_boundaries(names)
    push = vx.BodyForce(lambda x, t: [t, 0.0, 0.0])
    held = vx.simulate(vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="top"), push), mesh, [0.0, 1.0])
    assert held.reaction("top")[-1, 0] == pytest.approx(-1.0, rel=1e-9)
    with pytest.raises(vx.SceneError, match="nothing holds the body, and its loads do not balance: at t = 1"):
        vx.simulate(vx.Scene(vx.Elasticity(200.0, 0.3), push), mesh, [0.0, 1.0])


@pytest.mark.long
def test_what_an_overlap_moves_away_without_a_force_is_refused_in_words():
    """The body has no energy, and no size to which an error could refer: found as a division by zero."""
    box = {"lower": (0.0, 0.5), "upper": (0.5, 1.0)}
    mesh = vx.meshes.bodies({name: vx.meshes.squares(2, box=((0, 1), high)) for name, high in box.items()})
    scene = vx.Scene(
        vx.Elasticity(10.0, 0.3),
        vx.Clamp(on="lower.bottom"),
        vx.Traction(lambda x, t: [0.002 * t, -0.01 * t], on="upper.top"),
        vx.UnilateralContact(on="lower|upper", gap=-0.003),
        vx.CoulombFriction(0.4, on="lower|upper"),
    )
    with pytest.raises(vx.NotCertified, match="step 0 at t = 0"):
        vx.simulate(scene, mesh, [0.0, 0.5, 1.0], initial="settled", solver=vx.Clarabel())


def test_an_interface_without_contact_is_named(caplog):
    """The side of a contact may keep its name outside the interface: an effect on that name joins nothing."""
    parts = {"a": vx.meshes.squares(2, box=((0, 2), (0, 1))), "b": vx.meshes.squares(2, box=((0, 1), (1, 2)))}
    mesh = vx.meshes.bodies(parts)
    scene = vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp(on=["a.bottom", "b.top"]), vx.UnilateralContact(on="a.top"))
    vx.simulate(scene, mesh, [0.0, 1.0])
    (said,) = [words for words in caplog.messages if "no contact" in words]
    assert said.startswith("interface 'a|b': no contact acts on it, so that a and b may overlap.")
    caplog.clear()
    vx.simulate(scene.with_(vx.UnilateralContact(on="a|b")), mesh, [0.0, 1.0])
    assert not [words for words in caplog.messages if "no contact" in words]
