"""Curves of contact that end on planes of symmetry: there a part of a body shows what the whole shows."""

from __future__ import annotations

import numpy as np
import pytest

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


def polar(radii, angles):
    """Quadrilaterals between circles and rays; whole turns close."""
    closed = np.isclose(angles[-1] - angles[0], 2 * np.pi)
    angles = angles[:-1] if closed else angles
    k, m = len(angles), len(angles) - (not closed)
    points = (radii[:, None, None] * np.column_stack([np.cos(angles), np.sin(angles)])).reshape(-1, 2)
    points[np.abs(points) < 1e-15] = 0.0
    j = np.arange(m)
    ring = np.column_stack([j, j + k, (j + 1) % k + k, (j + 1) % k])
    return vx.PolygonMesh(points, [list(cell + k * r) for r in range(len(radii) - 1) for cell in ring])


def agrees(part, whole, loose):
    """Fields of contact at the nodes of a part are those of the whole body."""
    one, two = part.contact, whole.contact
    apart = np.linalg.norm(one.points[:, None] - two.points, axis=2)
    there = apart.argmin(axis=1)
    assert apart.min(axis=1).max() < 1e-12
    assert (one.pressure[-1] > 0).any()
    for name in ("pressure", "traction", "slip", "bound"):
        mine, theirs = getattr(one, name), getattr(two, name)[:, there]
        scale = {"traction": two.pressure, "slip": whole.displacement}.get(name, theirs)
        assert np.abs(mine - theirs).max() <= loose * np.abs(scale).max(), name


def rings(angles, order):
    """Two rings that touch at r = 1.6, one inside the other."""
    radii = {"inner": np.geomspace(1.0, 1.6, 3), "outer": np.geomspace(1.6, 2.4, 3)}
    mesh = vx.meshes.bodies({name: polar(radii[name], angles) for name in order})
    mesh = mesh.with_boundary("bore", lambda x: np.hypot(*x.T) < 1.1)
    mesh = mesh.with_boundary("rim", lambda x: np.hypot(*x.T) > 2.2)
    return mesh if angles[-1] > 6 else mesh.with_boundary("cut", lambda x: np.abs(x).min(axis=1) < 1e-9)


@pytest.mark.long
@pytest.mark.parametrize("order", [("inner", "outer"), ("outer", "inner")], ids=" in ".join)
@pytest.mark.parametrize("law", FRICTIONS)
@pytest.mark.parametrize("n", [4, 8])
def test_a_quarter_of_a_press_fit_shows_no_more_friction_than_the_ring(n, law, order):
    """It was .30 of the pressure at both ends, at every n, where the ring has none."""
    joint = "|".join(order)

    def fitted(turn, cells, *more):
        scene = vx.Scene(
            STEEL,
            vx.ElasticFoundation(5.0, 5.0, on=["bore", "rim"]),
            vx.UnilateralContact(on=joint, gap=lambda x, t: np.full(len(x), -0.004 * t)),
            FRICTIONS[law](0.3 if law == "Coulomb" else 0.02, on=joint),
            *more,
        )
        mesh = rings(np.linspace(0, turn, cells + 1), order)
        return vx.simulate(scene, mesh, [0.0, 0.5, 1.0], solver=vx.Newton(1e-7))

    whole, quarter = fitted(2 * np.pi, 4 * n), fitted(np.pi / 2, n, vx.Symmetry(on="cut"))
    # Gaps of pairs are rounded by 3e-8 of the energy norm, and forces on nodes are less by the root of their number.
    agrees(quarter, whole, 1e-6)
    p = quarter.contact.pressure[-1]
    assert np.ptp(p) <= 1e-6 * p.max()
    assert np.abs(quarter.contact.traction).max() <= 1e-6 * p.max()


@pytest.mark.long
@pytest.mark.parametrize("holder", ROLLERS)
@pytest.mark.parametrize(
    ("contact", "law"),
    [("rigid", "Coulomb"), ("rigid", "Tresca"), ("soft", "Coulomb"), ("soft", "Tresca"), ("bilateral", "Tresca")],
)
def test_half_of_a_segment_pressed_on_a_floor_shows_what_the_whole_shows(contact, law, holder):
    """The last node had the normal of its facet alone, and with it a traction where there is none."""
    half = polar(np.array([0.5, 0.75, 1.0]), np.radians(-90 + np.linspace(0, 50, 6)))

    def pressed(mesh, *more):
        mesh = mesh.with_boundary("arc", lambda x: np.hypot(*x.T) > 0.95)
        mesh = mesh.with_boundary("top", lambda x: np.hypot(*x.T) < 0.55)
        mesh = mesh.with_boundary("axis", lambda x: np.abs(x[:, 0]) < 1e-12) if more else mesh

        def gap(x, t):
            return 1 + x[:, 1]

        touch = {
            "rigid": vx.UnilateralContact("arc", gap),
            "soft": vx.NormalCompliance(1e3, "arc", gap),
            "bilateral": vx.BilateralContact("arc"),
        }[contact]
        down = vx.PrescribedDisplacement(lambda x, t: np.tile([0.0, -0.05 * t], (len(x), 1)), on="top")
        scene = vx.Scene(STEEL, down, touch, FRICTIONS[law](0.3, on="arc"), *more)
        return vx.simulate(scene, mesh, [0.0, 0.5, 1.0])

    part, whole = pressed(half, ROLLERS[holder]("axis", (1.0, 0.0))), pressed(mirrored(half, 0))
    # Fixed points of Coulomb's law stop at 1e-8 of the energy norm.
    agrees(part, whole, 1e-6 if law == "Coulomb" else 1e-9)
    last = np.abs(part.contact.points[:, 0]) < 1e-12
    assert np.abs(part.contact.traction[:, last]).max() <= 1e-9 * part.contact.pressure.max()


def bowl(n):
    """A quarter of a block whose bottom is part of a paraboloid, in tetrahedra."""
    block = vx.meshes.tetrahedra(n)
    x, y, z = block.points.T
    floor = (x**2 + y**2) / 3
    return vx.PolyhedralMesh(np.column_stack([x, y, floor + z * (1 - floor)]), block.cells)


@pytest.mark.long
@pytest.mark.parametrize("law", FRICTIONS)
@pytest.mark.parametrize("parts", [2, 4])
def test_a_round_body_in_space_is_computed_in_part(parts, law):
    """On the axis of a quarter two planes of symmetry meet."""
    quarter = bowl(3)
    half, held = mirrored(quarter, 1), [0] if parts == 2 else [0, 1]

    def pressed(mesh, *more):
        mesh = mesh.with_boundary("sole", lambda x: 3 * x[:, 2] < (x[:, :2] ** 2).sum(axis=1) + 0.2)
        mesh = mesh.with_boundary("lid", lambda x: x[:, 2] > 1 - 1e-9)
        for axis in held if more else ():
            mesh = mesh.with_boundary("xy"[axis], lambda x, axis=axis: np.abs(x[:, axis]) < 1e-12)

        def gap(x, t):
            return (x[:, 0] ** 2 + x[:, 1] ** 2) / 3

        down = vx.PrescribedDisplacement(lambda x, t: np.tile([0.0, 0.0, -0.2 * t], (len(x), 1)), on="lid")
        scene = vx.Scene(STEEL, down, vx.UnilateralContact("sole", gap), FRICTIONS[law](0.3, on="sole"), *more)
        return vx.simulate(scene, mesh, [0.0, 1.0])

    # The fixed point of Coulomb's law, as above; Tresca's discs by Newton's method, to 1e-8 in energy.
    agrees(
        pressed(half if parts == 2 else quarter, vx.Symmetry(on=["x", "y"][: len(held)])),
        pressed(mirrored(half, 0)),
        1e-6,
    )


def slope(degrees):
    """A block whose bottom rises to the right by an angle, with the names of squares."""
    block = vx.meshes.squares(2)
    x, y = block.points.T
    points = np.column_stack([x, y + np.tan(np.radians(degrees)) * x * (1 - y)])
    sides = {name: edges for name, edges in block.boundaries.items() if name != "boundary"}
    return vx.PolygonMesh(points, block.cells, boundaries=sides)


def normal_at_the_end(mesh, *supports):
    """That of contact on the bottom, at the node of all that is at the origin."""
    scene = vx.Scene(STEEL, vx.UnilateralContact(on="bottom"), vx.ElasticFoundation(1.0, 1.0, on="top"), *supports)
    obstacles = pose_scene(scene, mesh).obstacles
    (here,) = np.flatnonzero(np.abs(mesh.points[obstacles.nodes]).max(axis=1) < 1e-12)
    return obstacles.normals[here]


@pytest.mark.parametrize("holder", ROLLERS)
@pytest.mark.parametrize("degrees", [0.0, 15.0, 21.0, 21.5, 30.0])
def test_a_wedge_on_a_line_of_symmetry_keeps_its_tip(degrees, holder):
    """Its two sides turn by twice its angle: by less than 42.5 degrees they are a curve, as in the whole body."""
    normal = normal_at_the_end(slope(degrees), ROLLERS[holder]("left", (-1.0, 0.0)))
    if 0 < degrees < 21.25:
        assert np.abs(normal - [0.0, -1.0]).max() < 1e-15
    else:
        assert np.array_equal(normal, normal_at_the_end(slope(degrees)))


@pytest.mark.parametrize("degrees", [10.0, 20.0, 22.0, 30.0, 60.0])
def test_a_straight_side_on_an_oblique_roller_keeps_its_normal(degrees):
    """To the bit, where it makes a corner with its image; else the two are a curve."""
    block = vx.meshes.squares(2)
    x, y = block.points.T
    sides = {name: edges for name, edges in block.boundaries.items() if name != "boundary"}
    lean = np.radians(degrees)
    mesh = vx.PolygonMesh(np.column_stack([x + np.tan(lean) * y, y]), block.cells, boundaries=sides)
    normal = normal_at_the_end(mesh, vx.Symmetry(on="left"))
    if degrees < 21.25:
        assert np.abs(normal - [-np.sin(lean), -np.cos(lean)]).max() <= 1e-15
    else:
        assert np.array_equal(normal, [0.0, -1.0])


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.7, 2.0])
def test_straight_sides_across_a_line_of_symmetry_keep_their_normals_to_the_bit(angle):
    square = vx.meshes.squares(4)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    sides = {name: edges for name, edges in square.boundaries.items() if name != "boundary"}
    mesh = vx.PolygonMesh(square.points @ turn.T, square.cells, boundaries=sides)
    assert np.array_equal(normal_at_the_end(mesh, vx.Symmetry(on=["left", "right"])), normal_at_the_end(mesh))


NO_MIRRORS = {
    "guided": vx.PrescribedDisplacement(0.0, on="bottom", direction=(1.0, 0.0)),
    "moving plane": vx.PrescribedDisplacement(lambda x, t: np.full(len(x), 0.1 * t), on="left", direction="normal"),
    "plane that has moved": vx.PrescribedDisplacement(0.1, on="left", direction="normal"),
    "clamp": vx.Clamp(on="left"),
}


@pytest.mark.parametrize("support", NO_MIRRORS)
def test_what_is_held_otherwise_mirrors_nothing(support):
    """A block that is guided along an inclined side rubs on it; a plane that moves takes the image with it."""
    mesh = slope(10.0)
    scene = vx.Scene(
        STEEL, vx.UnilateralContact(on="bottom"), vx.ElasticFoundation(1.0, 1.0, on="top"), NO_MIRRORS[support]
    )
    posed = pose_scene(scene, mesh)
    plain = vx.UnilateralContact(on="bottom").contribute(posed.space).obstacles[0]
    kept = np.isin(plain.nodes, posed.obstacles.nodes)
    assert kept.sum() >= 2
    assert np.array_equal(posed.obstacles.normals, plain.normals[kept])


def test_a_partner_that_is_held_altogether_lies_on_every_plane():
    """The end of one ring is clamped, that of the other on a plane of symmetry: the normals are along the axes."""
    mesh = rings(np.linspace(0, np.pi / 2, 5), ("inner", "outer"))
    mesh = mesh.with_boundary("of inner", lambda x: (np.abs(x).min(axis=1) < 1e-9) & (np.hypot(*x.T) < 1.6))
    mesh = mesh.with_boundary("of outer", lambda x: (np.abs(x).min(axis=1) < 1e-9) & (np.hypot(*x.T) > 1.6))
    for clamped, slides in (("of inner", "of outer"), ("of outer", "of inner")):
        touch = vx.UnilateralContact(on="inner|outer")
        obstacles = pose_scene(vx.Scene(STEEL, touch, vx.Clamp(on=clamped), vx.Symmetry(on=slides)), mesh).obstacles
        at = np.abs(mesh.points[obstacles.nodes]).min(axis=1) < 1e-12
        assert at.sum() == 2
        assert np.abs(obstacles.normals[at]).max(axis=1) == pytest.approx(1.0, abs=1e-15)
