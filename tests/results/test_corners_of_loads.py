"""What grows at corners by loads and signs: logarithms of shear, friction that holds, jumps, materials inside."""

import numpy as np
import pytest

import feng_han_huang
import vemcvx as vx
from vemcvx.results.wedges import CLAMPED, FREE, Sector, Wedge, slipping

GROWS = "grows without limit as the mesh is refined, like "
STUCK = "at a corner of contact that sticks and free side: "
HOLDS = STUCK + "grows as the mesh is refined, as long as friction holds, like "


def corner(degrees, one, other):
    return Wedge([Sector(np.deg2rad(degrees), 1.8, 3.0)], [], (one, other))


def stress_of(wedge, given):
    x = wedge.logarithm(np.array(given, dtype=float))
    return None if x is None else wedge.stress(1.0, x, np.array([0.1]))[0]


def growing(*force):
    return lambda x, t: np.tile(np.array(force) * t, (len(x), 1))


def told(history):
    return {one.key: one.unbounded for one in history.extremes}


def values(history):
    return {one.key: one.value for one in history.extremes}


def test_logarithms_of_shear_have_their_closed_forms():
    """Uniaxial: 4/pi of the mismatch at contact, x along it, and 2/pi of the jump along a free side."""
    contact = corner(90, slipping(0.0), FREE)
    np.testing.assert_allclose(stress_of(contact, [0, 1, 0, 0]), [0, -4 / np.pi, 0], atol=1e-6)
    np.testing.assert_allclose(stress_of(contact, [0, 0, 0, 1]), [0, -4 / np.pi, 0], atol=1e-6)
    # sigma_rt changes its sign from one ray to the other where shear stress is the same.
    assert stress_of(contact, [0, 1, 0, -1]) is None
    assert stress_of(contact, [0, 0, 1, 0]) is None
    side = corner(180, FREE, FREE)
    np.testing.assert_allclose(stress_of(side, [0, 1, 0, 0]), [2 / np.pi, 0, 0], atol=1e-6)
    # Shear of one direction along a side is sigma_rt with one sign; pressure that jumps only turns the material.
    assert stress_of(side, [0, 1, 0, 1]) is None
    assert stress_of(side, [1, 0, 0, 0]) is None
    # Between two tractions there is a bounded solution at a right angle, whatever they are.
    assert stress_of(corner(90, FREE, FREE), [0, 1, 0, 0]) is None


@pytest.mark.long
def test_given_friction_at_a_right_angle_is_told():
    """The increments of the largest principal stress where cells are halved go to log(2) 4/pi times the bound."""
    found = {
        n: vx.simulate(feng_han_huang.scene(), feng_han_huang.mesh(n), feng_han_huang.times(2)) for n in (8, 16, 32)
    }
    words = "at a corner of contact and free side: " + GROWS + "log r"
    for history in found.values():
        assert told(history)["von_mises"] == told(history)["largest_principal_stress"] == words
        assert told(history)["pressure"] == told(history)["friction"] == ""
    grown = np.diff([values(history)["largest_principal_stress"] for history in found.values()])
    limit = np.log(2) * 4 / np.pi * 4.0
    assert grown[0] < grown[1] < limit
    assert grown[1] > 0.7 * limit


@pytest.mark.parametrize(("force", "grows"), [((1.0, 0.0), True), ((0.0, -1.0), False)])
def test_shear_that_jumps_along_a_side_is_told(force, grows):
    """Shear on the middle half of the top; pressure there has no logarithm."""
    mesh = vx.meshes.squares(16).with_boundary(
        "middle", lambda x: (x[:, 1] > 1 - 1e-9) & (np.abs(x[:, 0] - 0.5) < 0.26)
    )
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Symmetry(on=("bottom", "left")), vx.Traction(force, on="middle"))
    found = told(vx.simulate(scene, mesh, [0.0, 1.0], initial="settled"))
    words = "where shear jumps along a free side: " + GROWS + "log r"
    stresses = "von_mises", "largest_principal_stress", "smallest_principal_stress"
    assert {found[key] for key in stresses} == {words if grows else ""}


@pytest.mark.long
def test_given_friction_that_jumps_along_contact_is_told():
    """A box dragged on its floor, the left half of which is rough; at its edge below there is another corner.

    Where cells are halved pressure grows by log(2) times what the logarithm has across the side.
    """
    found, wall = {}, (1.0, 0.0)
    for n in (8, 16):
        mesh = vx.meshes.squares(n).with_boundary("rough", lambda x: (x[:, 1] < 1e-9) & (x[:, 0] < 0.5 + 1e-9))
        drag = [vx.PrescribedDisplacement(lambda x, t: 0.02 * t + 0 * x[:, 0], on=("left", "right"), direction=wall)]
        rubs = vx.Symmetry(on="top"), vx.BilateralContact(on="bottom"), vx.TrescaFriction(1.0, on="rough")
        found[n] = vx.simulate(vx.Scene(vx.Elasticity(200.0, 0.3), *drag, *rubs), mesh, [0.0, 0.5, 1.0])
    words = "where shear jumps along contact: " + GROWS + "log r"
    for key in ("largest_principal_stress", "pressure"):
        assert told(found[16])[key] == words
    assert told(found[16])["smallest_principal_stress"] == "at a corner of contact and roller: " + GROWS + "log r"
    grown = values(found[16])["pressure"] - values(found[8])["pressure"]
    across = stress_of(corner(180, slipping(0.0), slipping(0.0)), [0, 0, 0, 1])[1]
    assert grown == pytest.approx(np.log(2) * abs(across), rel=0.1)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")
@pytest.mark.parametrize("contact", [vx.BilateralContact(on="bottom"), vx.UnilateralContact(on="bottom")])
def test_given_friction_that_holds_is_a_clamp(contact):
    """Stress and pressure grow by 2^.29, as long as friction is not at its bound; where it is, they do not."""
    found = {}
    for bound, n in ((1e4, 8), (1e4, 16), (0.05, 16)):
        scene = vx.Scene(
            vx.Elasticity(200.0, 0.3),
            contact,
            vx.TrescaFriction(bound, on="bottom"),
            vx.Symmetry(on="left"),
            vx.Traction(growing(0.1, -1.0), on="top"),
        )
        found[bound, n] = vx.simulate(scene, vx.meshes.squares(n), [0.0, 1.0])
    for key in ("von_mises", "smallest_principal_stress", "pressure", "friction"):
        assert told(found[1e4, 16])[key] == HOLDS + "r^-0.29"
    assert values(found[1e4, 16])["pressure"] / values(found[1e4, 8])["pressure"] == pytest.approx(2**0.29, rel=0.03)
    assert not any("r^" in sentence for sentence in told(found[0.05, 16]).values())


@pytest.mark.long
def test_bodies_that_given_friction_bonds_are_one():
    """Two materials, two bodies: as where they meet in one."""
    bodies = {"lower": ((0.0, 1.0), (0.0, 0.5)), "upper": ((0.0, 1.0), (0.5, 1.0))}
    mesh = vx.meshes.bodies({name: vx.meshes.squares(8, box=box) for name, box in bodies.items()})
    scene = vx.Scene(
        vx.Elasticity(20.0, 0.3, on="lower"),
        vx.Elasticity(200.0, 0.3, on="upper"),
        vx.Symmetry(on=("lower.bottom", "lower.right", "upper.right")),
        vx.BilateralContact(on="lower|upper"),
        vx.TrescaFriction(1e4, on="lower|upper"),
        vx.Traction(growing(0.0, -1.0), on="upper.top"),
    )
    found = told(vx.simulate(scene, mesh, [0.0, 1.0]))
    assert found["pressure"] == found["friction"] == found["smallest_principal_stress"] == HOLDS + "r^-0.20"


@pytest.mark.long
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_of_two_principal_stresses_the_one_with_the_sign_of_the_field_grows(sign):
    """Both principal stresses of the field at a clamp's corner have one sign: in compression, tension has a limit."""
    found = {}
    for n in (8, 16, 32):
        scene = vx.Scene(
            vx.Elasticity(10.0, 0.45), vx.Clamp(on="bottom"), vx.PrescribedDisplacement((0.0, 0.02 * sign), on="top")
        )
        found[n] = vx.simulate(scene, vx.meshes.squares(n, box=((0.0, 2.0), (0.0, 1.0))), [0.0, 1.0], initial="settled")
    keys = ("largest_principal_stress", "smallest_principal_stress")[:: int(sign)]
    grows, bounded = (np.abs([values(history)[key] for history in found.values()]) for key in keys)
    assert grows[2] / grows[1] == pytest.approx(2**0.38, rel=0.03)
    assert bounded[2] - bounded[1] < 0.75 * (bounded[1] - bounded[0])
    assert [bool(told(found[32])[key]) for key in keys] == [True, False]
    assert told(found[32])["von_mises"] == "at a corner of clamp and free side: " + GROWS + "r^-0.38"


@pytest.mark.long
def test_displacements_that_jump_are_told():
    def lid(x, t):
        return np.column_stack([0.01 * (x[:, 0] > 0.5), 0 * x[:, 0]])

    def ramp(x, t):
        return np.column_stack([0.01 * x[:, 0], 0 * x[:, 0]])

    found = {}
    for value in (lid, ramp):
        scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="bottom"), vx.PrescribedDisplacement(value, on="top"))
        found[value] = told(vx.simulate(scene, vx.meshes.squares(16), [0.0, 1.0], initial="settled"))
    words = "where displacements that are given jump: " + GROWS + "r^-1"
    assert found[lid]["von_mises"] == found[lid]["largest_principal_stress"] == words
    assert not any("jump" in sentence for sentence in found[ramp].values())


@pytest.mark.long
def test_materials_that_meet_inside_are_told():
    """Four quadrants, like those of a chessboard; an interface that is straight, or a curve, is none."""
    found, mesh = {}, vx.meshes.squares(16)
    x, y = mesh.centroids.T - 0.5
    for name, stiff in (("board", x * y > 0), ("straight", x > 0), ("corner", (x > 0) & (y > 0))):
        of = mesh.with_cell_data("young", np.where(stiff, 2000.0, 20.0))
        scene = vx.Scene(
            vx.Elasticity("young", 0.3), vx.Symmetry(on=("bottom", "left")), vx.Traction((0.0, -1.0), on="top")
        )
        found[name] = told(vx.simulate(scene, of, [0.0, 1.0], initial="settled"))["von_mises"]
    words = "where materials meet inside the body: "
    assert found["board"] == words + GROWS + "r^-0.87"
    assert words not in found["straight"]


def test_data_that_cannot_be_read_beside_their_points_say_nothing():
    """A run is kept whole; a clamp's corner is told without them."""
    mesh, asked = vx.meshes.squares(8), []

    def pull(x, t):
        asked.append(len(x))
        if len(x) not in asked[:1]:
            raise KeyError("these points are not in the table")
        return np.tile([0.0, -1.0], (len(x), 1))

    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="bottom"), vx.Traction(pull, on="top"))
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    assert told(history)["smallest_principal_stress"].startswith("at a corner of clamp and free side")


@pytest.mark.long
def test_sides_are_kept_in_files(tmp_path):
    history = vx.simulate(feng_han_huang.scene(), feng_han_huang.mesh(8), feng_han_huang.times(2))
    assert history.sides.traction.shape == (3, 32, 4)
    history.write(tmp_path)
    assert told(vx.read_history(tmp_path)) == told(history)


@pytest.mark.long
def test_a_clamp_beside_a_slipping_side_is_not_asked():
    """Friction that slips up to a node that is held may stick beside it on the continuum."""
    assert stress_of(corner(90, CLAMPED, slipping(0.0)), [0, 0, 0, 1]) is not None
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(0.01, on="bottom"),
        vx.Traction(growing(5.0, 0.0), on="right"),
    )
    history = vx.simulate(scene, vx.meshes.squares(8), [0.0, 1.0])
    assert not any("clamp and contact" in sentence for sentence in told(history).values())
