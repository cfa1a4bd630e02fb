"""Supports that drag nodes along against friction: it counts as a force, as work of the supports, and as loss."""

import numpy as np
import pytest
from scenes import any_family, few_families, mostly_long, small

import vemcvx as vx
from vemcvx.base.arrays import EPS, SAME
from vemcvx.scene import pose_scene

pytestmark = pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")

YOUNG = 50.0
TIMES = np.linspace(0.0, 1.0, 13)


def course(t):
    """Forward, a halt, back, a halt, forward."""
    return np.interp(t, [0, 0.25, 0.5, 0.75, 0.9, 1], [0, 0.2, 0.2, -0.1, -0.1, 0.2])


def drag(direction):
    """Move the left side along, as a whole or free to rise and sink."""
    if direction is None:
        return vx.PrescribedDisplacement(lambda x, t: [course(t), 0.0], on="left")
    return vx.PrescribedDisplacement(lambda x, t: -course(t), on="left", direction=direction)


def ledger_rest(history):
    """work - dE - loss - 1/2 a(du, du) - p . dz, which is zero."""
    posed = pose_scene(history.scene, history.mesh)
    du = np.diff(history.displacement, axis=0).reshape(history.steps, -1)
    rest = 0.5 * np.einsum("ni,ni->n", du, (posed.A @ du.T).T)
    rest += np.einsum("nj,nj->n", history.trajectory.pressures[1:], (posed.obstacles.rows @ du.T).T)
    left = history.work - (history.energy - history.energy[0]) - history.dissipated
    return left - np.append(0.0, np.cumsum(rest))


@pytest.mark.long
@few_families
@pytest.mark.parametrize("direction", [None, "normal"])
@pytest.mark.parametrize("touch", [vx.BilateralContact, vx.UnilateralContact])
def test_a_block_dragged_over_a_rough_floor(family, direction, touch):
    """The side bears all friction, its own end of the floor's included: g L while the whole block moves."""
    g, mesh = 1.0, small(family, 4)
    press = () if touch is vx.BilateralContact else (vx.Pressure(5.0, on="top"),)
    scene = vx.Scene(
        vx.Elasticity(YOUNG, 0.0), drag(direction), *press, touch(on="bottom"), vx.TrescaFriction(g, on="bottom")
    )
    history = vx.simulate(scene, mesh, TIMES, initial="settled", solver=vx.Newton())
    contact, moves = history.contact, np.sign(np.diff(course(TIMES).round(12), prepend=0.0))
    reaction = history.reaction("left")[:, 0]
    assert moves.tolist() == [0, 1, 1, 1, 0, 0, 0, -1, -1, -1, 0, 1, 1]
    # The block is as long as high: stretched by friction g of its floor it gives by less than 2 g / E.
    slides = [2, 3, 9, 12]
    assert reaction[slides] == pytest.approx(g * moves[slides], rel=1e-9)
    corner = np.flatnonzero(np.abs(contact.points).max(axis=1) < 1e-12)
    assert len(corner) == 1
    assert len(contact.nodes) == len(np.unique(mesh.boundaries["bottom"]))
    assert np.abs(contact.traction[:, corner[0], 0] + g * moves).max() < 1e-12
    assert np.abs(contact.slip[:, corner[0], 0] - course(TIMES)).max() < 1e-15
    assert np.array_equal(contact.sticking[1:, corner[0]], moves[1:] == 0)
    assert np.abs(contact.bound - g).max() < 1e-12
    # Work, loss and wear: of the corner, too.
    size = history.work.max()
    assert np.abs(ledger_rest(history)).max() < 1e-12 * size
    assert contact.wear @ contact.friction_lengths == pytest.approx(history.dissipated, rel=1e-12)
    way = np.abs(np.diff(course(TIMES))).sum()
    assert contact.wear[-1, corner[0]] == pytest.approx(g * way, rel=1e-12)
    assert history.trajectory.stuck[1:].tolist() == contact.stick_count[1:].tolist()


@any_family
def test_a_floor_that_is_dragged_as_a_whole(family):
    """Every tangent is prescribed: nothing is left to solve for, and all of friction is."""
    scene = vx.Scene(
        vx.Elasticity(YOUNG, 0.3),
        vx.PrescribedDisplacement(lambda x, t: [course(t), 0.0], on=["left", "bottom", "right"]),
        vx.TrescaFriction(2.0, on="bottom"),
    )
    history = vx.simulate(scene, small(family, 3), TIMES)
    steps = np.diff(course(TIMES))
    lost = np.append(0.0, np.cumsum(2.0 * np.abs(steps)))
    assert history.dissipated == pytest.approx(lost, abs=1e-12)
    assert history.work == pytest.approx(lost, abs=1e-10)
    moves = np.where(np.abs(steps) < 1e-12, 0.0, -2.0 * np.sign(steps))
    assert history.contact.traction[1:, :, 0] == pytest.approx(np.tile(moves, (len(history.contact.nodes), 1)).T)
    assert not any("TrescaFriction" in words for words in history.inactive)
    assert history.iterations.max() == 0


@pytest.mark.long
@few_families
@pytest.mark.parametrize("coefficient", [0.3, lambda x, t: 0.2 + 0.1 * x[:, 0]])
def test_coulomb_rubs_with_the_pressure_that_the_step_ends_with(family, coefficient):
    """A roller that moves its side along keeps it free to sink: the corner's pressure is known, and rubs."""
    scene = vx.Scene(
        vx.Elasticity(YOUNG, 0.2),
        drag("normal"),
        vx.Pressure(lambda x, t: 2.0 + x[:, 0], on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(coefficient, on="bottom"),
    )
    history = vx.simulate(scene, small(family, 4), TIMES, initial="settled", solver=vx.Newton())
    contact = history.contact
    value = coefficient(contact.points, 0.0) if callable(coefficient) else np.full(len(contact.nodes), coefficient)
    peak = contact.pressure.max()
    assert np.abs(contact.bound - value * contact.pressure).max() < 1e-6 * peak
    assert contact.pressure[-1] @ contact.lengths == pytest.approx(2.5, rel=1e-9)
    friction = (contact.bound * contact.friction_lengths)[[3, 12]].sum(axis=1)
    assert history.reaction("left")[[3, 12], 0] == pytest.approx(friction, rel=1e-6)
    assert contact.wear @ contact.friction_lengths == pytest.approx(history.dissipated, rel=1e-12)


@pytest.mark.long
@few_families
def test_what_supports_hold_still_is_no_contact(family):
    """A prescribed value that never changes is a clamp: it neither rubs nor shows."""
    mesh = small(family, 4)
    load = vx.Traction(lambda x, t: [3.0 * t, -1.0 * t], on="right")
    floor = vx.BilateralContact(on="bottom"), vx.TrescaFriction(0.5, on="bottom")
    sides = vx.Clamp(on="left"), vx.PrescribedDisplacement((0.0, 0.0), on="left")
    clamped, held = (
        vx.simulate(vx.Scene(vx.Elasticity(YOUNG, 0.3), side, load, *floor), mesh, TIMES) for side in sides
    )
    assert np.array_equal(clamped.contact.nodes, held.contact.nodes)
    assert not np.isin(mesh.boundaries["left"], held.contact.nodes).any()
    assert np.array_equal(clamped.reaction("left"), held.reaction("left"))
    left = np.isin(held.acting.ends[:, 0], mesh.boundaries["left"])
    assert not held.force(vx.TrescaFriction).any() or held.acting.held[left & held.acting.force.any(axis=(0, 2))].all()


@pytest.mark.parametrize(("lift", "gap", "touches"), [(0.02, 0.0, False), (0.0, 0.0, True), (-0.02, 0.03, False)])
def test_a_node_that_supports_lift_off_is_open(lift, gap, touches):
    """How far it is from the obstacle is known, though nothing can be told of what presses there."""

    scene = vx.Scene(
        vx.Elasticity(10.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: [0.01 * t, lift * t], on="left"),
        vx.PrescribedDisplacement(lambda x, t: [0.01 * t, -0.05 * t], on="right"),
        vx.UnilateralContact(on="bottom", gap=gap),
        vx.TrescaFriction(0.1, on="bottom", while_closed=False),
    )
    contact = vx.simulate(scene, vx.meshes.squares(3), [0.0, 1.0]).contact
    corner = int(np.flatnonzero(contact.points[:, 0] == 0.0)[0])
    assert contact.closed[-1, corner] == touches
    assert contact.closed[-1, np.flatnonzero(contact.points[:, 0] == 1.0)].all()
    assert contact.open_count[-1] == (~contact.closed[-1]).sum()


@pytest.mark.parametrize("mesh", [vx.meshes.squares(2), vx.meshes.cubes(1)], ids=["plane", "space"])
@mostly_long("angle", [1e-6, 0.005, 0.009, 0.02])
def test_a_side_lifted_off_a_floor_askew_does_not_rub(mesh, angle):
    """Nodes that are moved altogether slip along their own side, however near that is to the axes."""
    turn = np.eye(mesh.points.shape[1])
    turn[np.ix_([0, -1], [0, -1])] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    askew = type(mesh)(mesh.points @ turn.T, mesh.cells, boundaries={})
    for name, at, place in (("floor", -1, 0.0), ("side", 0, 1.0)):
        askew = askew.with_boundary(name, lambda x, at=at, place=place: abs((x @ turn)[:, at] - place) < SAME)
    lifted = vx.PrescribedDisplacement(lambda x, t: np.tile(0.02 * t * turn[:, -1], (len(x), 1)), on="side")
    law = vx.TrescaFriction(0.5, on="floor", while_closed=False)
    scene = vx.Scene(vx.Elasticity(10.0, 0.3), lifted, vx.UnilateralContact(on="floor"), law)
    history = vx.simulate(scene, askew, [0.0, 1.0])
    moved = np.isin(history.contact.nodes, np.flatnonzero(abs((askew.points @ turn)[:, 0] - 1.0) < SAME))
    # Turning points and displacements rounds each of them a few times.
    assert history.contact.wear[-1, moved].max(initial=0.0) <= 0.5 * 16 * EPS


@pytest.mark.parametrize(("gap", "direction", "depth"), [(0.1, None, 0.2), (0.1, (0, 1), 0.2), (0.3, None, 0.0)])
def test_a_support_that_takes_a_contact_node_through_its_obstacle_says_how_deep(caplog, gap, direction, depth):
    """The lower left corner sinks by .3, which is deepest at t = .5; the obstacle is as far below it as `gap`."""
    sinks = vx.Tabulated([0.0, 0.5, 1.0], -0.3 * np.outer([0, 1, 0.5], (0, 1) if direction is None else 1).squeeze())
    scene = vx.Scene(
        vx.Elasticity(YOUNG, 0.3),
        vx.Clamp(on="right"),
        vx.PrescribedDisplacement(sinks, on="left", direction=direction),
        vx.UnilateralContact(on="bottom", gap=gap),
    )
    vx.simulate(scene, small("squares", 3), np.linspace(0, 1, 5))
    said = "PrescribedDisplacement on left: it moves 1 contact node(s) through UnilateralContact on bottom, by up to "
    assert [words for words in caplog.messages if "through" in words] == [f"{said}{depth}"] * (depth > 0)
