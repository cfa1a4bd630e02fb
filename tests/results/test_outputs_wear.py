"""Wear: friction work per length of contact nodes, over all steps, in every way a run can be made."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import cyclic, paper_load, paper_scene, small

import vemcvx as vx
from vemcvx.scene import pose_scene

TIMES = np.linspace(0.0, 1.0, 25)
# Sums over some 25 steps and 10 nodes of numbers of one sign, in two orders.
ROUNDED = 1e-13


def moved(x, t):
    return np.column_stack([0.05 * np.sin(5 * t) * (1 + x[:, 1]), 0.0 * x[:, 0]])


def to_and_fro(x, t):
    """A top that presses down and rubs."""
    return np.tile([0.03 * np.sin(6 * t), -0.02 * t], (len(x), 1))


SCENES = {
    "tresca": paper_scene(cyclic),
    "moving support": vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(moved, on="right"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=lambda x, t: 1.0 + x[:, 0] * t, on="bottom", quadrature="integral"),
    ),
    "coulomb": vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(to_and_fro, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
    ),
    "two normals": vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(to_and_fro, on="top"),
        vx.NormalCompliance(stiffness=500.0, on=["bottom", "left"]),
        vx.TrescaFriction(bound=0.5, on="bottom"),
        vx.TrescaFriction(bound=0.2, on="left"),
    ),
}


def assert_adds_up(history):
    worn = history.contact.wear @ history.contact.friction_lengths
    assert np.abs(worn - history.dissipated).max() <= ROUNDED * history.dissipated[-1]
    assert history.dissipated[-1] > 0


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_wear_adds_up_to_what_is_dissipated_and_is_the_sum_of_weights_times_slips(name):
    scene, mesh = SCENES[name], small("voronoi", 5)
    history = vx.simulate(scene, mesh, TIMES)
    assert_adds_up(history)
    # Again from the displacements: w_i |(I - nn') du_i|, which moving supports are part of.
    terms, contact = pose_scene(scene, mesh).terms, history.contact
    increments = np.diff(history.displacement.reshape(len(TIMES), -1), axis=0)
    work = history.trajectory.weights[1:] * np.abs(increments @ terms.rows.T.toarray())
    total = np.zeros_like(contact.wear)
    at = np.searchsorted(contact.nodes, terms.nodes)
    for term, node in enumerate(at):
        total[1:, node] += np.cumsum(work[:, term])
    assert contact.wear * contact.friction_lengths == pytest.approx(total, abs=1e-11 * total.max())
    assert (np.diff(contact.wear, axis=0) >= 0).all()
    two = name == "two normals"
    assert (len(np.unique(at)) < len(at)) == two
    part = vx.vem.Space(mesh).part(["bottom", "left"] if two else "bottom", "test")
    own = part.node_lengths[np.searchsorted(part.nodes, contact.nodes)]
    assert contact.friction_lengths == pytest.approx(own, rel=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_steps_that_are_not_stored_wear_too(name):
    scene, mesh = SCENES[name], small("squares", 4)
    whole, some = (vx.simulate(scene, mesh, TIMES, store=store) for store in ("all", 10))
    assert some.stored.tolist() == [0, 10, 20, 24]
    assert np.array_equal(some.contact.wear, whole.contact.wear[some.stored])
    assert_adds_up(some)


@pytest.mark.long
def test_dashpots_dissipate_and_do_not_wear():
    scene = vx.Scene(*SCENES["tresca"].effects, vx.Viscosity(shear=10.0, volume=5.0))
    mesh = small("squares", 4)
    history = vx.simulate(scene, mesh, TIMES)
    rates = np.diff(history.trajectory.state, axis=0)
    C = pose_scene(scene, mesh).system.damping.C
    lost = np.append(0.0, np.cumsum(np.einsum("ni,ni->n", rates, (C @ rates.T).T) / np.diff(TIMES)))
    rubbed = history.contact.wear @ history.contact.friction_lengths
    assert rubbed[-1] > 0.01 * lost[-1] > 0
    assert rubbed + lost == pytest.approx(history.dissipated, abs=1e-12 * history.dissipated[-1])


def test_a_slider_on_a_spring():
    """k y = F(t) - w while it moves: pulled to F = 5 it has slid (5 - 3) / 2, pushed to -5 it slides back by 2."""
    load = lambda t: [5 * np.interp(t, [0, 1, 2], [0, 1, -1])]  # noqa: E731
    run = vx.march(vx.System([[2.0]], load, vx.Norms([[1.0]], 3.0)), [0.0, 0.5, 1.0, 1.5, 2.0])
    assert run.worn[:, 0] == pytest.approx([0.0, 0.0, 3.0, 3.0, 9.0], abs=1e-14)
    assert run.stuck.tolist() == [1, 1, 0, 1, 0]


def test_nodes_without_friction_do_not_wear():
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(paper_load(cyclic), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=1.0, on="heel"),
    )
    mesh = small("squares", 8).with_boundary("heel", lambda x: (x[:, 1] == 0) & (x[:, 0] < 0.5))
    contact = vx.simulate(scene, mesh, TIMES).contact
    rubs = contact.points[:, 0] <= 0.5
    assert np.array_equal(contact.friction_lengths > 0, rubs)
    assert not contact.wear[:, ~rubs].any()
    assert contact.lengths.sum() == pytest.approx(1 - 1 / 16, rel=1e-14)
    assert contact.friction_lengths.sum() == pytest.approx(0.5, rel=1e-14)
    # Where one bound holds all the time, wear is the bound times the way.
    way = np.abs(np.diff(contact.slip[:, :, 0], axis=0)).sum(axis=0)
    assert contact.wear[-1, rubs] == pytest.approx(way[rubs], abs=1e-13 * way.max())
