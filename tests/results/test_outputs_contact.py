"""Who touches, sticks and slips: counts at stored steps, and of norm terms at all of them."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import cyclic, paper_scene, small

import vemcvx as vx

TIMES = np.linspace(0.0, 1.0, 13)


def rock(x, t):
    """Down on the left, up on the right, along, and longer: a rigid motion would leave no energy to compare with."""
    return np.column_stack([0.01 * t * (1 + x[:, 0]), 0.02 * t * (x[:, 0] - 0.4)])


def rocking(contact, friction=None):
    return vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(rock, on="top"),
        contact,
        friction or vx.CoulombFriction(0.2, on="bottom"),
    )


def lifting(solver=None, contact=None, friction=None):
    scene = rocking(contact or vx.UnilateralContact(on="bottom"), friction)
    return vx.simulate(scene, small("squares", 8), TIMES, solver=solver)


@pytest.mark.long
def test_counts_are_a_partition_and_agree_with_all_steps():
    history = vx.simulate(paper_scene(cyclic), small("voronoi", 6), TIMES)
    contact = history.contact
    assert contact.closed.all()
    assert not contact.open_count.any()
    assert (contact.closed_count == len(contact.nodes)).all()
    assert np.array_equal(contact.stick_count, contact.sticking.sum(axis=1))
    assert np.array_equal(contact.stick_count + contact.slip_count, contact.closed_count)
    assert contact.slip_count.max() > 0
    assert contact.slip_count[0] == 0
    # One norm term a node: the march counts the same, also where it stores nothing.
    some = vx.simulate(paper_scene(cyclic), small("voronoi", 6), TIMES, store=5)
    assert np.array_equal(some.trajectory.stuck, contact.stick_count)
    assert np.array_equal(some.contact.stick_count, contact.stick_count[some.stored])


@pytest.mark.parametrize("stiffness", [None, 300.0])
def test_open_is_where_nothing_presses(stiffness):
    law = vx.UnilateralContact(on="bottom") if stiffness is None else vx.NormalCompliance(stiffness, on="bottom")
    history = lifting(contact=law)
    contact, forces = history.contact, history.trajectory.pressures
    opened = contact.open_count
    assert opened[0] == 0  # at rest on the obstacle, without a force
    assert 0 < opened[-1] < len(contact.nodes)
    assert np.array_equal(contact.closed[1:], forces[1:] > 0)
    lift = history.displacement[-1, contact.nodes, 1]
    assert (lift[~contact.closed[-1]] > 0).all()
    assert (contact.stick_count + contact.slip_count + opened == len(contact.nodes)).all()
    words = f"{contact.stick_count[-1]} nodes stick, {contact.slip_count[-1]} slip, {opened[-1]} are open in the last"
    assert words in history.summary()


@pytest.mark.long
@pytest.mark.parametrize("friction", [vx.TrescaFriction(0.05, on="bottom"), None])
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
def test_conic_answers_open_where_ours_do(friction):
    """No force of theirs is zero to the bit."""
    ours = lifting(friction=friction)
    theirs = vx.simulate(ours.scene, ours.mesh, TIMES, solver=vx.Clarabel())
    assert (theirs.trajectory.pressures[-1] > 0).all()
    assert np.array_equal(ours.contact.closed, theirs.contact.closed)


def test_a_body_that_arrives_without_a_force_touches():
    """It is stretched along the obstacle, and does not contract: 0.1 + 0.2 meets the gap of 0.3 but for rounding."""

    def fall(x, t):
        return np.column_stack([t * x[:, 0], np.full(len(x), -(t + 0.2))])

    sides = vx.PrescribedDisplacement(fall, on=["left", "top", "right"])
    scene = vx.Scene(vx.Elasticity(200.0, 0.0), sides, vx.UnilateralContact(gap=0.3, on="bottom"))
    mesh = small("voronoi", 5)
    contact = vx.simulate(scene, mesh, [0.0, 0.05, 0.1], initial=fall(mesh.points, 0.0)).contact
    assert contact.closed_count.tolist() == [0, 0, len(contact.nodes)]
