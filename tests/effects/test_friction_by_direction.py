"""Friction by direction in space: closed forms of a sheared block, Coulomb's law against Tresca's, what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from solids import SOLIDS, solid

import vemcvx as vx

MU, HEIGHT = 10.0, 0.8
BOX = ((0.0, 1.0), (0.0, 1.2), (0.0, HEIGHT))
BOUND, ACROSS, ANGLE = 1.0, 0.4, 0.5
AXES = np.array([[np.cos(ANGLE), np.sin(ANGLE)], [-np.sin(ANGLE), np.cos(ANGLE)]])
ALONG = (*(3.0 * AXES[0]), 5.0)
"""Of any length; its part across the floor does not count."""
PATH = np.array([(0, 0), (0.05, 0.02), (0.15, 0.05), (0.2, 0.2), (0.05, 0.25), (-0.15, 0.05), (0.0, -0.1)])
TIMES = np.arange(float(len(PATH)))
BLOCK = vx.meshes.cubes(2, BOX)
SIDES = ("left", 0, -1), ("right", 0, 1), ("front", 1, -1), ("back", 1, 1)


def nearest(trial, across):
    """The point of the ellipse that is nearest to a force: friction, where the block is as stiff in all directions."""
    at, squares = AXES @ trial, np.array([BOUND, across]) ** 2
    if across == 0.0:
        return AXES.T @ [np.clip(at[0], -BOUND, BOUND), 0.0]
    if np.sum(at**2 / squares) <= 1.0:
        return trial
    root = brentq(lambda far: np.sum(squares * (at / (squares + far)) ** 2) - 1.0, 0.0, 1e3, xtol=1e-15, rtol=1e-14)
    return AXES.T @ (at * squares / (squares + root))


def closed_form(across, path=PATH):
    """Slips a and forces q = mu (U - a) / H on the floor."""
    a, q = [np.zeros(2)], [np.zeros(2)]
    for U in path[1:]:
        q.append(nearest(MU * (U - a[-1]) / HEIGHT, across))
        a.append(U - q[-1] * HEIGHT / MU)
    return np.array(a), np.array(q)


def sheared(q, *effects, press=0.0, path=PATH):
    """A block whose top moves along the path, sheared uniformly, without cross contraction."""

    def side(axis, sign):
        return lambda x, t: [0.0, 0.0, sign * q[round(t), axis]]

    top = vx.PrescribedDisplacement(lambda x, t: [*path[round(t)], -press], on="top")
    sides = (vx.Traction(side(axis, sign), on=name) for name, axis, sign in SIDES)
    return vx.Scene(vx.Elasticity(2 * MU, 0.0), top, *sides, *effects)


def floor(across=ACROSS, **settings):
    rubs = vx.TrescaFriction(BOUND, on="bottom", direction=ALONG, across=across, **settings)
    return vx.BilateralContact(on="bottom"), rubs


@pytest.mark.long
@pytest.mark.parametrize("across", [ACROSS, 2.5, 0.0])
@pytest.mark.parametrize("family", SOLIDS)
def test_a_sheared_block_follows_its_closed_form(family, across):
    """Patch test: force on the ellipse, slip along its normal, at all nodes."""
    a, q = closed_form(across)
    history = vx.simulate(sheared(q, *floor(across)), solid(family, 2, BOX), TIMES, solver=vx.Newton(1e-9))
    contact = history.contact
    assert np.abs(contact.slip[:, :, :2] - a[:, None]).max() < 1e-10
    assert np.abs(contact.traction[:, :, :2] + q[:, None]).max() < 1e-9
    slips = ~contact.sticking
    assert slips[2:].any()
    moved = np.abs(np.diff(a, axis=0, prepend=0.0)).max(axis=1) > 1e-10
    np.testing.assert_array_equal(slips, np.broadcast_to(moved[:, None], slips.shape))
    if across == 0.0:
        # What slides across the line alone is not at the bound.
        slips &= (np.abs(np.diff(a @ AXES[0], prepend=0.0)) > 1e-10)[:, None]
    # |friction| is at its bound, which is that in its direction.
    size = np.linalg.norm(contact.traction, axis=2)
    assert contact.bound[slips] == pytest.approx(size[slips], abs=1e-9)
    assert (size < contact.bound + 1e-9).all()
    # What friction dissipates is force times slip; ways are counted in what they cost.
    work = np.append(0.0, np.cumsum(np.sum(q[1:] * np.diff(a, axis=0), axis=1)))
    assert contact.wear == pytest.approx(np.tile(work[:, None], contact.wear.shape[1]), abs=1e-9)
    assert contact.accumulated_slip == pytest.approx(contact.wear / BOUND, abs=1e-10)


@pytest.mark.long
@pytest.mark.parametrize("family", ["cubes", "voronoi3"])
def test_solvers_agree(family):
    _, q = closed_form(ACROSS)
    runs = [
        vx.simulate(sheared(0.7 * q, *floor()), solid(family, 2, BOX), TIMES, solver=solver)
        for solver in (vx.Newton(1e-9), vx.Clarabel(1e-6))
    ]
    assert runs[1].certificate.max() < 1e-6
    apart = np.abs(np.sqrt(2 * runs[0].energy) - np.sqrt(2 * runs[1].energy))
    assert (apart <= sum(np.cumsum(np.sqrt(2 * run.trajectory.gap)) for run in runs)).all()


@pytest.mark.long
def test_equal_bounds_are_a_disc():
    _, q = closed_form(ACROSS)
    mesh = vx.meshes.voronoi3(2, BOX)
    disc = vx.TrescaFriction(BOUND, on="bottom")
    runs = [vx.simulate(sheared(q, *rubs), mesh, TIMES) for rubs in (floor(BOUND), (floor()[0], disc))]
    assert np.abs(runs[0].displacement - runs[1].displacement).max() < 1e-10
    assert runs[0].contact.bound == pytest.approx(runs[1].contact.bound, rel=1e-12)


@pytest.mark.parametrize("law", ["tresca", pytest.param("coulomb", marks=pytest.mark.long)])
def test_a_ground_that_moves_back_is_a_top_that_moves_on(law):
    """Friction knows the motion of the body relative to the ground alone."""
    a, q = closed_form(ACROSS)
    still, press = 0.0 * PATH, 0.01

    def ground(x, t):
        return [*-PATH[round(t)], 0.0]

    def rubs(**moved):
        if law == "tresca":
            return floor(**moved)
        pressure = 2 * MU * press / HEIGHT
        rubs = vx.CoulombFriction(
            BOUND / pressure, on="bottom", direction=ALONG, across=lambda x, t: ACROSS / pressure, **moved
        )
        return vx.UnilateralContact(on="bottom"), rubs

    initial = {"initial": "settled"} if law == "coulomb" else {}
    pressed = press if law == "coulomb" else 0.0
    mesh = vx.meshes.prisms(2, BOX)
    scenes = sheared(q, *rubs(), press=pressed), sheared(q, *rubs(ground=ground), press=pressed, path=still)
    dragged, drawn = (vx.simulate(scene, mesh, TIMES, **initial) for scene in scenes)
    assert np.abs(drawn.contact.slip - dragged.contact.slip).max() < 1e-8
    assert np.abs(drawn.contact.slip[:, :, :2] - a[:, None]).max() < 1e-8
    assert np.abs(drawn.contact.traction - dragged.contact.traction).max() < 1e-7
    assert drawn.dissipated == pytest.approx(dragged.dissipated, abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("across", [0.15, 0.6, 0.0])
def test_coulomb_s_law_is_tresca_s_with_the_pressures_found(across):
    """Step by step, under pressure that is not uniform and on places that open."""
    times, mesh = np.linspace(0.0, 1.0, 5), vx.meshes.voronoi3(3)
    frame = (
        vx.Elasticity(2000.0, 0.3),
        vx.PrescribedDisplacement([0.0, 0.0, -0.002], on="top"),
        vx.Traction(lambda x, t: [3 * np.sin(3 * t), 2 * t, 4 * t], on=["right", "left"]),
        vx.UnilateralContact(on="bottom"),
    )
    way = {"on": "bottom", "direction": (1.0, 0.5, 0.0)}
    follows = vx.simulate(
        vx.Scene(*frame, vx.CoulombFriction(0.4, across=across, **way)), mesh, times, initial="settled"
    )
    assert follows.certificate_kind == "for the given friction"
    contact = follows.contact
    assert contact.slip_count[1:].max() > 3

    def bound(x, t, coefficient=0.4):
        nearest = np.linalg.norm(x[:, None] - contact.points, axis=2).argmin(axis=1)
        return coefficient * contact.pressure[round(4 * t), nearest]

    given = vx.TrescaFriction(bound, across=lambda x, t: bound(x, t, across), while_closed=False, **way)
    told = vx.simulate(vx.Scene(*frame, given), mesh, times, initial="settled")
    assert np.abs(told.displacement - follows.displacement).max() < 1e-6 * np.abs(told.displacement).max()


def test_axes_follow_a_surface():
    """What counts of a direction is what is along the surface at each place: around the sides of a block."""
    rubs = vx.TrescaFriction(2.0, on=["left", "front"], direction=lambda x: x * 0.0 + [1.0, 1.0, 2.0], across=1.0)
    touch = vx.UnilateralContact(on=["left", "front"], gap=1.0)
    terms = vx.scene.pose_scene(vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp(on="top"), touch, rubs), BLOCK).terms
    assert np.abs(np.einsum("mbd,md->mb", terms.tangents, terms.normals)).max() < 1e-15
    assert np.linalg.norm(terms.tangents, axis=2) == pytest.approx(np.tile([1.0, 0.5], (len(terms), 1)), rel=1e-14)
    left = terms.normals[:, 0] == -1.0
    assert terms.tangents[left, 0] == pytest.approx(np.tile([0.0, 1.0, 2.0] / np.sqrt(5.0), (left.sum(), 1)))
    assert (~left).any()


@pytest.mark.long
def test_scenes_turn():
    """A turned scene has the turned answer."""
    R, mesh = Rotation.from_euler("zyx", [0.4, -0.7, 1.1]).as_matrix(), vx.meshes.voronoi3(2, BOX)
    faces = mesh.face_offsets, mesh.face_vertices, mesh.cell_offsets, mesh.cell_faces, mesh.face_cells
    named = {name: part for name, part in mesh.boundaries.items() if name != "boundary"}
    turned = vx.PolyhedralMesh.unchecked(mesh.points @ R.T, *faces).with_boundaries(named)

    def answer(mesh, R):
        pull = R @ [0.6, 0.4, 0.0]
        scene = vx.Scene(
            vx.Elasticity(100.0, 0.3),
            vx.Clamp(on="left"),
            vx.Traction(lambda x, t: t * pull, on="top"),
            vx.BilateralContact(on="bottom"),
            vx.TrescaFriction(0.3, on="bottom", direction=R @ [1.0, 2.0, 0.5], across=0.1),
        )
        return vx.simulate(scene, mesh, [0.0, 0.5, 1.0], solver=vx.Newton(1e-10))

    plain, other = answer(mesh, np.eye(3)), answer(turned, R)
    assert (~plain.contact.sticking[-1]).any()
    assert np.abs(other.displacement - plain.displacement @ R.T).max() < 1e-8 * np.abs(plain.displacement).max()


@pytest.mark.long
def test_the_error_budget_knows_its_force():
    """Uniform states have no error of the mesh."""
    _, q = closed_form(ACROSS)
    history = vx.simulate(sheared(q, *floor()), BLOCK, TIMES, solver=vx.Newton(1e-10))
    assert vx.error_budget(history).space.max() < 1e-6 * np.sqrt(2 * history.energy.max())


PUSHED = vx.Elasticity(200.0, 0.3), vx.Clamp(on="top"), vx.UnilateralContact(on="bottom")
BELT = {"on": "bottom", "direction": (1.0, 0.0, 0.0)}


@pytest.mark.long
@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.6, 0.8, 0.0)])
@pytest.mark.parametrize("friction", [vx.TrescaFriction(0.02, on="bottom"), vx.CoulombFriction(0.5, on="bottom")])
def test_what_slides_across_a_line_of_friction_slips(friction, direction):
    """The plate above carries the block along; friction along the line alone holds nothing of it."""
    across = np.array([-direction[1], direction[0], 0.0])
    plate = vx.PrescribedDisplacement(lambda x, t: np.tile(0.01 * t * across, (len(x), 1)), on="top")
    line = replace(friction, direction=direction, across=0.0)
    contact = vx.UnilateralContact if isinstance(friction, vx.CoulombFriction) else vx.BilateralContact
    scene = vx.Scene(vx.Elasticity(10.0, 0.0), plate, contact(on="bottom"), line)
    history = vx.simulate(scene, vx.meshes.cubes(1), [0.0, 0.5, 1.0])
    np.testing.assert_allclose(history.contact.slip[-1], np.tile(0.01 * across, (4, 1)), atol=1e-12)
    assert not history.contact.sticking[1:].any()


def test_bounds_that_begin_at_zero_keep_their_ratio():
    """It is read at the first instant at which there is friction."""
    rubs = vx.TrescaFriction(lambda x, t: t * (1 + x[:, 0]), across=lambda x, t: 0.5 * t * (1 + x[:, 0]), **BELT)
    scene = vx.Scene(*PUSHED, rubs)
    terms = vx.scene.pose_scene(scene, vx.meshes.cubes(2), [0.0, 1.0, 2.0]).terms
    assert np.linalg.norm(terms.tangents[:, 1], axis=1) == pytest.approx(0.5, rel=1e-15)


def rubbed(begin):
    """A block dragged across its axes, under bounds that grow from zero; nothing is known before it begins."""

    def bound(x, t):
        return 0.004 * (t - begin) + 0.0 * x[:, 0]

    top = vx.PrescribedDisplacement(lambda x, t: (0.01 * np.sin(3 * (t - begin)), 0.02 * (t - begin), 0.0), on="top")
    known = vx.Tabulated([begin, begin + 1.0], [0.0, 0.0004])
    rubs = vx.TrescaFriction(bound, across=known, **BELT)
    return vx.Scene(vx.Elasticity(1.0, 0.3), top, vx.BilateralContact(on="bottom"), rubs)


@pytest.mark.long
def test_estimates_take_the_ellipse_of_the_run():
    """With an effect left out that is zero, in whose place the scene is posed anew, as without it."""
    mesh, times, nothing = vx.meshes.cubes(1), np.linspace(0.0, 1.0, 3), vx.BodyForce((0.0, 0.0, 0.0))
    runs = [vx.simulate(scene, mesh, times) for scene in (rubbed(0.0), rubbed(0.0).with_(nothing))]
    alone, beside = (vx.error_budget(run).time for run in runs)
    assert alone.max() > 0.01
    assert beside == pytest.approx(alone, rel=1e-9)


@pytest.mark.long
def test_instants_ask_for_nothing_before_the_run():
    times = 5.0 + np.linspace(0.0, 1.0, 3)
    assert np.all(np.isin(times, vx.instants(rubbed(5.0), vx.meshes.cubes(1), times)))
