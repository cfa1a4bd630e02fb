"""Supports drag nodes against friction: forces, work and dissipation."""

import numpy as np
import pytest
from scenes import any_family, few_families, small

import vemcvx as vx
from vemcvx.scene import pose_scene

pytestmark = pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")

YOUNG = 50.0
TIMES = np.linspace(0.0, 1.0, 13)


def course(t):
    """Return the displacement of the support at t."""
    return np.interp(t, [0, 0.25, 0.5, 0.75, 0.9, 1], [0, 0.2, 0.2, -0.1, -0.1, 0.2])


def drag(direction):
    """Return a support that moves the left side along x."""
    if direction is None:
        return vx.PrescribedDisplacement(lambda x, t: [course(t), 0.0], on="left")
    return vx.PrescribedDisplacement(lambda x, t: -course(t), on="left", direction=direction)


def ledger_rest(history):
    """Return the residual of the energy balance.

    The residual is work - energy - dissipation - sum (du'A du / 2 + p . dz), summed over steps. A is the stiffness. The
    increments of displacements and normal displacements are du and dz. The contact forces are p.
    """
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
def test_the_support_of_a_dragged_block_bears_its_friction(family, direction, touch):
    """While the block slides, the support on the left bears the friction g."""
    g, mesh = 1.0, small(family, 4)
    press = () if touch is vx.BilateralContact else (vx.Pressure(5.0, on="top"),)
    scene = vx.Scene(
        vx.Elasticity(YOUNG, 0.0), drag(direction), *press, touch(on="bottom"), vx.TrescaFriction(g, on="bottom")
    )
    history = vx.simulate(scene, mesh, TIMES, initial="settled", solver=vx.Newton())
    contact, moves = history.contact, np.sign(np.diff(course(TIMES).round(12), prepend=0.0))
    reaction = history.reaction("left")[:, 0]
    assert moves.tolist() == [0, 1, 1, 1, 0, 0, 0, -1, -1, -1, 0, 1, 1]
    # Friction stretches the square block by less than 2 g / E.
    slides = [2, 3, 9, 12]
    assert reaction[slides] == pytest.approx(g * moves[slides], rel=1e-9)
    corner = np.flatnonzero(np.abs(contact.points).max(axis=1) < 1e-12)
    assert len(corner) == 1
    assert len(contact.nodes) == len(np.unique(mesh.boundaries["bottom"]))
    assert np.abs(contact.traction[:, corner[0], 0] + g * moves).max() < 1e-12
    assert np.abs(contact.slip[:, corner[0], 0] - course(TIMES)).max() < 1e-15
    assert np.array_equal(contact.sticking[1:, corner[0]], moves[1:] == 0)
    assert np.abs(contact.bound - g).max() < 1e-12
    size = history.work.max()
    assert np.abs(ledger_rest(history)).max() < 1e-12 * size
    assert contact.wear @ contact.friction_lengths == pytest.approx(history.dissipated, rel=1e-12)
    way = np.abs(np.diff(course(TIMES))).sum()
    assert contact.wear[-1, corner[0]] == pytest.approx(g * way, rel=1e-12)


@any_family
def test_a_floor_with_prescribed_slips_needs_no_iteration(family):
    """All tangential displacements are prescribed, so friction is known before each step."""
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
    assert history.iterations.max() == 0


@pytest.mark.parametrize(("lift", "gap", "touches"), [(0.02, 0.0, False), (0.0, 0.0, True), (-0.02, 0.03, False)])
def test_a_node_lifted_by_a_support_is_open(lift, gap, touches):
    """The distance to the obstacle is known, although the contact pressure is not."""

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
