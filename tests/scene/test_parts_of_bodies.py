"""Planes of symmetry where contact ends: a part of a body shows what the whole shows, its peak pressure as well."""

from itertools import product

import numpy as np
import pytest
from scenes import mostly_long, moved, rotation

import hertz_contact as hertz
import vemcvx as vx
from vemcvx.scene import pose_scene

STEEL = vx.Elasticity(100.0, 0.3)
ROLLERS = {
    "symmetry": lambda on, normal: vx.Symmetry(on=on),
    "normal": lambda on, normal: vx.PrescribedDisplacement(0.0, on=on, direction="normal"),
    "vector": lambda on, normal: vx.PrescribedDisplacement(0.0, on=on, direction=normal),
}
FRICTIONS = {"Coulomb": vx.CoulombFriction, "Tresca": vx.TrescaFriction}


def mirrored(mesh, axis):
    """The mesh and its image across the plane where a coordinate is zero, in one."""
    image = mesh.points.copy()
    image[:, axis] *= -1
    beyond = np.flatnonzero(image[:, axis] != 0)
    number = np.arange(mesh.n_nodes)
    number[beyond] = mesh.n_nodes + np.arange(len(beyond))
    points = np.concatenate([mesh.points, image[beyond]])
    if points.shape[1] == 2:
        return vx.PolygonMesh(points, [*mesh.cells, *(number[cell][::-1] for cell in mesh.cells)])
    images = [[number[face][::-1] for face in cell] for cell in mesh.cells]
    return vx.PolyhedralMesh(points, [*mesh.cells, *images])


def agrees(part, whole, loose):
    """Fields of contact at the nodes of a part are those of the whole body, and bear what the floor does."""
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


def down(depth, on):
    return vx.PrescribedDisplacement(lambda x, t: t * depth * np.eye(x.shape[1])[-1] * np.ones((len(x), 1)), on=on)


FLAT = {
    "rigid": (vx.UnilateralContact(on="bottom", gap=lambda x, t: 0.02 * x[:, 0] ** 2),),
    "soft": (vx.NormalCompliance(2000.0, on="bottom", gap=lambda x, t: 0.02 * x[:, 0] ** 2),),
    "bilateral": (vx.BilateralContact(on="bottom"),),
    "Tresca": (vx.UnilateralContact(on="bottom"), vx.TrescaFriction(0.4, on="bottom")),
    "Tresca, bilateral": (vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.4, on="bottom")),
    "Coulomb": (vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.2, on="bottom")),
}


@pytest.mark.long
@pytest.mark.parametrize("contact", FLAT)
@pytest.mark.parametrize("holder", ["symmetry", "normal"])
def test_half_of_a_block_shows_what_the_whole_shows(contact, holder):
    effects = (
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(
            lambda x, t: np.column_stack([0.0 * x[:, 0], -0.03 * t * (1 - 0.3 * x[:, 0] ** 2)]), on="top"
        ),
        *FLAT[contact],
    )
    axis, times = ROLLERS[holder]("left", None), np.linspace(0.0, 1.0, 5)
    part, whole = (vx.meshes.squares(4, box=((low, 1), (0, 1))) for low in (0, -1))
    half, whole = (
        vx.simulate(vx.Scene(*effects, *more), mesh, times, solver=vx.Newton())
        for mesh, more in ((part, [axis]), (whole, []))
    )
    # Fixed points of Coulomb's law stop at 1e-8 of the energy norm.
    there, one, two = agrees(half, whole, 1e-6 if contact == "Coulomb" else 1e-10), half.contact, whole.contact
    # Nodes of the axis have half of their edges in the half.
    middle = np.abs(one.points[:, 0]) < 1e-14
    assert middle.sum() == 1
    assert one.lengths == pytest.approx(two.lengths[there] * np.where(middle, 0.5, 1.0), rel=1e-14)
    assert np.array_equal(one.sticking[1:, middle], np.ones((4, 1)))
    assert np.array_equal(one.closed, two.closed[:, there])
    load = half.force("bottom")[:, 1]
    assert one.pressure @ one.lengths == pytest.approx(load, abs=1e-10 * load.max())
    assert one.pressure[-1].argmax() == 0 or contact != "rigid"


def rings(sectors, turn, order):
    """Two rings that touch at r = 1.6, one inside the other."""
    radii = {"inner": np.geomspace(1.0, 1.6, 3), "outer": np.geomspace(1.6, 2.4, 3)}
    mesh = vx.meshes.bodies({name: vx.meshes.ring(radii[name], sectors, angles=(0.0, turn)) for name in order})
    mesh = mesh.with_boundary("bore", lambda x: np.hypot(*x.T) < 1.1)
    mesh = mesh.with_boundary("rim", lambda x: np.hypot(*x.T) > 2.2)
    return mesh if turn > 6 else mesh.with_boundary("cut", lambda x: np.abs(x).min(axis=1) < 1e-9)


@pytest.mark.long
@pytest.mark.parametrize("order", [("inner", "outer"), ("outer", "inner")], ids=" in ".join)
@pytest.mark.parametrize("law", FRICTIONS)
@pytest.mark.parametrize("n", [4, 8])
def test_a_quarter_of_a_press_fit_shows_no_more_friction_than_the_ring(n, law, order):
    """It was .30 of the pressure at both ends, at every n, where the ring has none."""
    joint = "|".join(order)
    effects = (
        STEEL,
        vx.ElasticFoundation(5.0, 5.0, on=["bore", "rim"]),
        vx.UnilateralContact(on=joint, gap=lambda x, t: -0.004 * t),
        FRICTIONS[law](0.3 if law == "Coulomb" else 0.02, on=joint),
    )
    whole, quarter = (
        vx.simulate(
            vx.Scene(*effects, *more),
            rings(cells, turn, order),
            [0, 0.5, 1],
            solver=vx.Newton(1e-7),
        )
        for turn, cells, more in ((2 * np.pi, 4 * n, []), (np.pi / 2, n, [vx.Symmetry(on="cut")]))
    )
    # Gaps of pairs are rounded by 3e-8 of the energy norm, and forces on nodes are less by the root of their number.
    agrees(quarter, whole, 1e-6)
    p = quarter.contact.pressure[-1]
    assert np.ptp(p) <= 1e-6 * p.max()
    assert np.abs(quarter.contact.traction).max() <= 1e-6 * p.max()


def arched(x, t):
    return 1 + x[:, 1]


TOUCHES = {
    "rigid": vx.UnilateralContact("arc", arched),
    "soft": vx.NormalCompliance(1e3, "arc", arched),
    "bilateral": vx.BilateralContact("arc"),
}


@pytest.mark.long
@pytest.mark.parametrize("holder", ROLLERS)
@pytest.mark.parametrize(("contact", "law"), [*product(["rigid", "soft"], FRICTIONS), ("bilateral", "Tresca")])
def test_half_of_a_segment_pressed_on_a_floor_shows_what_the_whole_shows(contact, law, holder):
    """The last node had the normal of its facet alone, and with it a traction where there is none."""
    half = vx.meshes.ring([0.5, 0.75, 1.0], 5, angles=tuple(np.radians([-90, -40])))
    half = vx.PolygonMesh(np.where(np.abs(half.points) < 1e-15, 0.0, half.points), half.cells)

    def pressed(mesh, *more):
        mesh = mesh.with_boundary("arc", lambda x: np.hypot(*x.T) > 0.95)
        mesh = mesh.with_boundary("top", lambda x: np.hypot(*x.T) < 0.55)
        mesh = mesh.with_boundary("axis", lambda x: np.abs(x[:, 0]) < 1e-12) if more else mesh
        scene = vx.Scene(STEEL, down(-0.05, "top"), TOUCHES[contact], FRICTIONS[law](0.3, on="arc"), *more)
        return vx.simulate(scene, mesh, [0.0, 0.5, 1.0])

    part, whole = pressed(half, ROLLERS[holder]("axis", (1.0, 0.0))), pressed(mirrored(half, 0))
    agrees(part, whole, 1e-6 if law == "Coulomb" else 1e-9)
    last = np.abs(part.contact.points[:, 0]) < 1e-12
    assert np.abs(part.contact.traction[:, last]).max() <= 1e-9 * part.contact.pressure.max()


@pytest.mark.long
@pytest.mark.parametrize("law", FRICTIONS)
@pytest.mark.parametrize("parts", [2, 4])
def test_a_round_body_in_space_is_computed_in_part(parts, law):
    """A block of tetrahedra on a part of a paraboloid; on the axis of a quarter two planes of symmetry meet."""
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
        touch = vx.UnilateralContact("sole", lambda x, t: (x[:, 0] ** 2 + x[:, 1] ** 2) / 3)
        return vx.simulate(
            vx.Scene(STEEL, down(-0.2, "lid"), touch, FRICTIONS[law](0.3, on="sole"), *more), mesh, [0.0, 1.0]
        )

    # The fixed point of Coulomb's law, as above; Tresca's discs by Newton's method, to 1e-8 in energy.
    part = pressed(half if parts == 2 else quarter, vx.Symmetry(on=["x", "y"][: len(held)]))
    agrees(part, pressed(mirrored(half, 0)), 1e-6)


@pytest.mark.long
def test_hertz_line_contact_carries_its_whole_load():
    """The nodal pressures bear the measured load, and the one on the axis is Hertz' peak, to the mesh's 2 %."""
    history = vx.simulate(hertz.scene(), hertz.mesh(20), hertz.times(2))
    contact, load = history.contact, history.force("bottom")[-1, 1]
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


# Normals at the ends.


def slope(degrees):
    """A block whose bottom rises to the right by an angle, with the names of squares."""
    block = vx.meshes.squares(2)
    x, y = block.points.T
    shift = np.column_stack([0 * x, np.tan(np.radians(degrees)) * x * (1 - y)])
    return moved(block, np.eye(2), shift)


def posed_on_the_bottom(mesh, *supports):
    scene = vx.Scene(STEEL, vx.UnilateralContact(on="bottom"), vx.ElasticFoundation(1.0, 1.0, on="top"), *supports)
    return pose_scene(scene, mesh)


def normal_at_the_end(mesh, *supports):
    """That of contact on the bottom, at the node of all that is at the origin."""
    obstacles = posed_on_the_bottom(mesh, *supports).obstacles
    (here,) = np.flatnonzero(np.abs(mesh.points[obstacles.nodes]).max(axis=1) < 1e-12)
    return obstacles.normals[here]


@pytest.mark.parametrize("holder", ROLLERS)
@mostly_long("degrees", [0.0, 15.0, 21.0, 21.5, 30.0], 3)
def test_a_wedge_on_a_line_of_symmetry_keeps_its_tip(degrees, holder):
    """Its two sides turn by twice its angle: by less than 42.5 degrees they are a curve, as in the whole body."""
    normal = normal_at_the_end(slope(degrees), ROLLERS[holder]("left", (-1.0, 0.0)))
    if 0 < degrees < 21.25:
        assert np.abs(normal - [0.0, -1.0]).max() < 1e-15
    else:
        assert np.array_equal(normal, normal_at_the_end(slope(degrees)))


@mostly_long("degrees", [10.0, 20.0, 22.0, 30.0, 60.0], 2, 3)
def test_a_straight_side_on_an_oblique_roller_keeps_its_normal(degrees):
    """To the bit, where it makes a corner with its image; else the two are a curve."""
    lean = np.radians(degrees)
    mesh = moved(vx.meshes.squares(2), [[1.0, np.tan(lean)], [0.0, 1.0]])
    normal = normal_at_the_end(mesh, vx.Symmetry(on="left"))
    if degrees < 21.25:
        assert np.abs(normal - [-np.sin(lean), -np.cos(lean)]).max() <= 1e-15
    else:
        assert np.array_equal(normal, [0.0, -1.0])


@mostly_long("angle", [0.0, 0.3, 0.7, 2.0], 2)
def test_straight_sides_across_a_line_of_symmetry_keep_their_normals_to_the_bit(angle):
    mesh = moved(vx.meshes.squares(4), rotation(angle))
    assert np.array_equal(normal_at_the_end(mesh, vx.Symmetry(on=["left", "right"])), normal_at_the_end(mesh))


NO_MIRRORS = {
    "guided": vx.PrescribedDisplacement(0.0, on="bottom", direction=(1.0, 0.0)),
    "moving plane": vx.PrescribedDisplacement(lambda x, t: 0.1 * t, on="left", direction="normal"),
    "plane that has moved": vx.PrescribedDisplacement(0.1, on="left", direction="normal"),
    "clamp": vx.Clamp(on="left"),
}


@pytest.mark.parametrize("support", NO_MIRRORS)
def test_what_is_held_otherwise_mirrors_nothing(support):
    """A block that is guided along an inclined side rubs on it; a plane that moves takes the image with it."""
    posed = posed_on_the_bottom(slope(10.0), NO_MIRRORS[support])
    plain = vx.UnilateralContact(on="bottom").contribute(posed.space).obstacles[0]
    kept = np.isin(plain.nodes, posed.obstacles.nodes)
    assert kept.sum() >= 2
    assert np.array_equal(posed.obstacles.normals, plain.normals[kept])


def test_a_partner_that_is_held_altogether_lies_on_every_plane():
    """The end of one ring is clamped, that of the other on a plane of symmetry: the normals are along the axes."""
    mesh = rings(4, np.pi / 2, ("inner", "outer"))
    mesh = mesh.with_boundary("of inner", lambda x: (np.abs(x).min(axis=1) < 1e-9) & (np.hypot(*x.T) < 1.6))
    mesh = mesh.with_boundary("of outer", lambda x: (np.abs(x).min(axis=1) < 1e-9) & (np.hypot(*x.T) > 1.6))
    for clamped, slides in (("of inner", "of outer"), ("of outer", "of inner")):
        touch = vx.UnilateralContact(on="inner|outer")
        obstacles = pose_scene(vx.Scene(STEEL, touch, vx.Clamp(on=clamped), vx.Symmetry(on=slides)), mesh).obstacles
        at = np.abs(mesh.points[obstacles.nodes]).min(axis=1) < 1e-12
        assert at.sum() == 2
        assert np.abs(obstacles.normals[at]).max(axis=1) == pytest.approx(1.0, abs=1e-15)
