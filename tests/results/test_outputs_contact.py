"""Numbers of sticking, slipping and open contact nodes."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import small

import vemcvx as vx

TIMES = np.linspace(0.0, 1.0, 13)
UNILATERAL = vx.UnilateralContact(on="bottom")


def lift(x, t):
    """Return displacements that press the left end of the top and lift the right end."""
    return np.column_stack([0.01 * t * (1 + x[:, 0]), 0.02 * t * (x[:, 0] - 0.4)])


def run_lifted(contact=UNILATERAL, friction=None, solver=None):
    moved = vx.PrescribedDisplacement(lift, on="top")
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), moved, contact, friction or vx.CoulombFriction(0.2, on="bottom"))
    return vx.simulate(scene, small("squares", 8), TIMES, solver=solver)


@pytest.mark.parametrize("contact", [UNILATERAL, vx.NormalCompliance(300.0, on="bottom")])
def test_contact_is_open_where_its_pressure_is_zero(contact):
    history = run_lifted(contact)
    contact, forces = history.contact, history.trajectory.pressures
    opened = contact.open_count
    assert opened[0] == 0  # at rest on the obstacle, without a force
    assert 0 < opened[-1] < len(contact.nodes)
    assert np.array_equal(contact.closed[1:], forces[1:] > 0)
    assert (history.displacement[-1, contact.nodes, 1][~contact.closed[-1]] > 0).all()
    assert (contact.stick_count + contact.slip_count + opened == len(contact.nodes)).all()
    assert f"{contact.slip_count[-1]} slip, {opened[-1]} are open" in history.summary()


@pytest.mark.long
@pytest.mark.parametrize("friction", [vx.TrescaFriction(0.05, on="bottom"), None])
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
def test_conic_solutions_are_open_at_the_same_nodes(friction):
    """Pressures of a conic solver are never exactly zero."""
    newton = run_lifted(friction=friction)
    conic = run_lifted(friction=friction, solver=vx.Clarabel())
    assert (conic.trajectory.pressures[-1] > 0).all()
    assert np.array_equal(newton.contact.closed, conic.contact.closed)


def test_a_body_that_touches_without_a_force_is_closed():
    """The motion 0.1 + 0.2 closes the gap 0.3 up to rounding."""

    def fall(x, t):
        return np.column_stack([t * x[:, 0], np.full(len(x), -(t + 0.2))])

    sides = vx.PrescribedDisplacement(fall, on=["left", "top", "right"])
    scene = vx.Scene(vx.Elasticity(200.0, 0.0), sides, vx.UnilateralContact(gap=0.3, on="bottom"))
    mesh = small("voronoi", 5)
    contact = vx.simulate(scene, mesh, [0.0, 0.05, 0.1], initial=fall(mesh.points, 0.0)).contact
    assert contact.open_count.tolist() == [len(contact.nodes), len(contact.nodes), 0]
