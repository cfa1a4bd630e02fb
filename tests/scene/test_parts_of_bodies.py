"""A part of a body, cut at planes of symmetry, has the contact fields of the whole body."""

import numpy as np
import pytest
from scenes import mostly_long, moved, rotation

import vemcvx as vx
from vemcvx.scene import pose_scene

STEEL = vx.Elasticity(100.0, 0.3)
FRICTIONS = {"Coulomb": vx.CoulombFriction, "Tresca": vx.TrescaFriction}


def mirrored(mesh, axis):
    """Return the union of a mesh in space and its mirror image."""
    image = mesh.points.copy()
    image[:, axis] *= -1
    beyond = np.flatnonzero(image[:, axis] != 0)
    number = np.arange(mesh.n_nodes)
    number[beyond] = mesh.n_nodes + np.arange(len(beyond))
    points = np.concatenate([mesh.points, image[beyond]])
    images = [[number[face][::-1] for face in cell] for cell in mesh.cells]
    return vx.PolyhedralMesh(points, [*mesh.cells, *images])


def check_fields(part, whole, loose):
    """Compare the contact fields of a part and the whole body. Return node numbers in the whole body."""
    one, two = part.contact, whole.contact
    apart = np.linalg.norm(one.points[:, None] - two.points, axis=2)
    there = apart.argmin(axis=1)
    assert apart.min(axis=1).max() < 1e-12
    assert (one.pressure[-1] > 0).any()
    for name in ("pressure", "traction", "slip", "bound", "wear"):
        mine, theirs = getattr(one, name), getattr(two, name)[:, there]
        scale = {"traction": two.pressure, "slip": whole.displacement, "wear": two.pressure}.get(name, theirs)
        assert np.abs(mine - theirs).max() <= loose * np.abs(scale).max(), name
    return there


FLAT = {
    "rigid": (vx.UnilateralContact(on="bottom", gap=lambda x, t: 0.02 * x[:, 0] ** 2),),
    "bilateral": (vx.BilateralContact(on="bottom"),),
    "Tresca": (vx.UnilateralContact(on="bottom"), vx.TrescaFriction(0.4, on="bottom")),
    "Coulomb": (vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.2, on="bottom")),
}


@pytest.mark.long
@pytest.mark.parametrize("contact", FLAT)
def test_half_of_a_block_has_the_contact_fields_of_the_whole(contact):
    effects = (
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(
            lambda x, t: np.column_stack([0.0 * x[:, 0], -0.03 * t * (1 - 0.3 * x[:, 0] ** 2)]), on="top"
        ),
        *FLAT[contact],
    )
    axis, times = vx.Symmetry(on="left"), np.linspace(0.0, 1.0, 5)
    part, whole = (vx.meshes.squares(4, box=((low, 1), (0, 1))) for low in (0, -1))
    half, whole = (
        vx.simulate(vx.Scene(*effects, *more), mesh, times, solver=vx.Newton())
        for mesh, more in ((part, [axis]), (whole, []))
    )
    # Coulomb's law is solved to 1e-8 in the energy norm.
    there, one, two = check_fields(half, whole, 1e-6 if contact == "Coulomb" else 1e-10), half.contact, whole.contact
    # On the line of symmetry, the half body has one contact edge, and the whole body has two.
    middle = np.abs(one.points[:, 0]) < 1e-14
    assert middle.sum() == 1
    assert one.lengths == pytest.approx(two.lengths[there] * np.where(middle, 0.5, 1.0), rel=1e-14)
    assert np.array_equal(one.sticking[1:, middle], np.ones((4, 1)))
    assert np.array_equal(one.closed, two.closed[:, there])
    load = half.force("bottom")[:, 1]
    assert one.pressure @ one.lengths == pytest.approx(load, abs=1e-10 * load.max())
    assert one.pressure[-1].argmax() == 0 or contact != "rigid"


def rings(sectors, turn, order):
    """Return two rings, one inside the other, that touch at r = 1.6."""
    radii = {"inner": np.geomspace(1.0, 1.6, 3), "outer": np.geomspace(1.6, 2.4, 3)}
    mesh = vx.meshes.bodies({name: vx.meshes.ring(radii[name], sectors, angles=(0.0, turn)) for name in order})
    mesh = mesh.with_boundary("bore", lambda x: np.hypot(*x.T) < 1.1)
    mesh = mesh.with_boundary("rim", lambda x: np.hypot(*x.T) > 2.2)
    return mesh if turn > 6 else mesh.with_boundary("cut", lambda x: np.abs(x).min(axis=1) < 1e-9)


@pytest.mark.long
@pytest.mark.parametrize("order", [("inner", "outer"), ("outer", "inner")], ids=" in ".join)
@pytest.mark.parametrize("law", FRICTIONS)
def test_a_quarter_of_a_press_fit_has_no_more_friction_than_the_ring(law, order):
    """Without mirrored normals, friction at the cuts would be .30 times the pressure."""
    joint = "|".join(order)
    effects = (
        STEEL,
        vx.ElasticFoundation(5.0, 5.0, on=["bore", "rim"]),
        vx.UnilateralContact(on=joint, gap=lambda x, t: -0.004 * t),
        FRICTIONS[law](0.3 if law == "Coulomb" else 0.02, on=joint),
    )
    whole, quarter = (
        vx.simulate(vx.Scene(*effects, *more), rings(cells, turn, order), [0, 0.5, 1], solver=vx.Newton(1e-7))
        for turn, cells, more in ((2 * np.pi, 16, []), (np.pi / 2, 4, [vx.Symmetry(on="cut")]))
    )
    # Newton's accuracy is 1e-7 in the energy norm. Relative errors of nodal forces are larger.
    check_fields(quarter, whole, 1e-6)
    p = quarter.contact.pressure[-1]
    assert np.ptp(p) <= 1e-6 * p.max()
    assert np.abs(quarter.contact.traction).max() <= 1e-6 * p.max()


@pytest.mark.long
@pytest.mark.parametrize("law", FRICTIONS)
@pytest.mark.parametrize("parts", [2, 4])
def test_parts_of_a_round_body_in_space_have_the_contact_fields_of_the_whole(parts, law):
    """A block of tetrahedra rests on a paraboloid. A quarter of the block has two planes of symmetry."""
    block = vx.meshes.tetrahedra(3)
    x, y, z = block.points.T
    floor = (x**2 + y**2) / 3
    quarter = vx.PolyhedralMesh(np.column_stack([x, y, floor + z * (1 - floor)]), block.cells)
    half, held = mirrored(quarter, 1), [0] if parts == 2 else [0, 1]

    def pressed(mesh, *more):
        mesh = mesh.with_boundary("sole", lambda x: 3 * x[:, 2] < (x[:, :2] ** 2).sum(axis=1) + 0.2)
        mesh = mesh.with_boundary("lid", lambda x: x[:, 2] > 1 - 1e-9)
        for axis in held if more else ():
            mesh = mesh.with_boundary("xy"[axis], lambda x, axis=axis: np.abs(x[:, axis]) < 1e-12)
        down = vx.PrescribedDisplacement(lambda x, t: [0.0, 0.0, -0.2 * t], on="lid")
        touch = vx.UnilateralContact("sole", lambda x, t: (x[:, 0] ** 2 + x[:, 1] ** 2) / 3)
        return vx.simulate(vx.Scene(STEEL, down, touch, FRICTIONS[law](0.3, on="sole"), *more), mesh, [0.0, 1.0])

    # Steps are solved to 1e-8 in the energy norm.
    part = pressed(half if parts == 2 else quarter, vx.Symmetry(on=["x", "y"][: len(held)]))
    check_fields(part, pressed(mirrored(half, 0)), 1e-6)


# Normals at the ends of the contact boundary.


def slope(degrees):
    """Return a block whose bottom rises to the right by an angle."""
    block = vx.meshes.squares(2)
    x, y = block.points.T
    shift = np.column_stack([0 * x, np.tan(np.radians(degrees)) * x * (1 - y)])
    return moved(block, np.eye(2), shift)


def posed_on_the_bottom(mesh, *supports):
    scene = vx.Scene(STEEL, vx.UnilateralContact(on="bottom"), vx.ElasticFoundation(1.0, 1.0, on="top"), *supports)
    return pose_scene(scene, mesh)


def normal_at_the_end(mesh, *supports):
    """Return the contact normal of the bottom at the origin."""
    obstacles = posed_on_the_bottom(mesh, *supports).obstacles
    (here,) = np.flatnonzero(np.abs(mesh.points[obstacles.nodes]).max(axis=1) < 1e-12)
    return obstacles.normals[here]


@mostly_long("degrees", [0.0, 21.0, 21.5], 1)
def test_a_wedge_on_a_line_of_symmetry_has_the_normals_of_the_whole_body(degrees):
    """Two sides form a curve if their normals differ by less than 42.5 degrees."""
    normal = normal_at_the_end(slope(degrees), vx.Symmetry(on="left"))
    if 0 < degrees < 21.25:
        assert np.abs(normal - [0.0, -1.0]).max() < 1e-15
    else:
        assert np.array_equal(normal, normal_at_the_end(slope(degrees)))


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_straight_sides_across_a_line_of_symmetry_keep_their_normals_bit_for_bit(angle):
    mesh = moved(vx.meshes.squares(4), rotation(angle))
    assert np.array_equal(normal_at_the_end(mesh, vx.Symmetry(on=["left", "right"])), normal_at_the_end(mesh))


def test_a_symmetry_on_a_straight_side_and_a_curve_gives_the_straight_side_the_normals_of_the_whole_body():
    mesh = slope(10.0)
    lift = np.where(mesh.points[:, 1] > 1 - 1e-9, 0.1 * mesh.points[:, 0] ** 2, 0.0)
    bent = moved(mesh, np.eye(2), np.column_stack([0 * lift, lift]))
    assert normal_at_the_end(bent, vx.Symmetry(on=["left", "top"])) == pytest.approx([0.0, -1.0], abs=1e-15)
