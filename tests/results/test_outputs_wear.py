"""Wear is the friction work per length at each contact node, summed over all steps."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import cyclic, mostly_long, paper_scene, small

import vemcvx as vx
from vemcvx.scene import pose_scene

TIMES = np.linspace(0.0, 1.0, 25)
STEEL = vx.Elasticity(200.0, 0.3)
ROUNDED = 1e-13
"""Relative rounding error of sums of 250 positive numbers."""


def pull_sideways(x, t):
    return np.column_stack([0.05 * np.sin(5 * t) * (1 + x[:, 1]), 0.0 * x[:, 0]])


def press_and_rub(x, t):
    return np.tile([0.03 * np.sin(6 * t), -0.02 * t], (len(x), 1))


SCENES = {
    "tresca": paper_scene(cyclic),
    "moving support": vx.Scene(
        STEEL,
        vx.PrescribedDisplacement(pull_sideways, on="right"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=lambda x, t: 1.0 + x[:, 0] * t, on="bottom", quadrature="integral"),
    ),
    "coulomb": vx.Scene(
        STEEL,
        vx.PrescribedDisplacement(press_and_rub, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
    ),
    "two normals": vx.Scene(
        STEEL,
        vx.PrescribedDisplacement(press_and_rub, on="top"),
        vx.NormalCompliance(stiffness=500.0, on=["bottom", "left"]),
        vx.TrescaFriction(bound=0.5, on="bottom"),
        vx.TrescaFriction(bound=0.2, on="left"),
    ),
}


def total_wear(history):
    return history.contact.wear @ history.contact.friction_lengths


@mostly_long("name", SCENES, "two normals")
def test_wear_is_the_sum_of_weights_times_slips_and_adds_up_to_the_dissipation(name):
    scene, mesh = SCENES[name], small("voronoi", 5)
    history = vx.simulate(scene, mesh, TIMES)
    assert total_wear(history) == pytest.approx(history.dissipated, abs=ROUNDED * history.dissipated[-1])
    assert history.dissipated[-1] > 0
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
    # Steps that are not stored count as well.
    some = vx.simulate(scene, mesh, TIMES, store=10)
    assert some.stored.tolist() == [0, 10, 20, 24]
    assert np.array_equal(some.contact.wear, contact.wear[some.stored])


@pytest.mark.long
def test_viscous_dissipation_is_no_wear():
    scene, mesh = vx.Scene(*SCENES["tresca"], vx.Viscosity(shear=10.0, volume=5.0)), small("squares", 4)
    history = vx.simulate(scene, mesh, TIMES)
    rates = np.diff(history.trajectory.state, axis=0)
    C = pose_scene(scene, mesh).system.damping.C
    viscous = np.append(0.0, np.cumsum(np.einsum("ni,ni->n", rates, (C @ rates.T).T) / np.diff(TIMES)))
    worn = total_wear(history)
    assert worn[-1] > 0.01 * viscous[-1] > 0
    assert worn + viscous == pytest.approx(history.dissipated, abs=1e-12 * history.dissipated[-1])


def test_a_slider_on_a_spring_has_its_closed_form():
    """The stiffness is 2 and the friction bound 3: 2 y = 5 - 3 under the load 5, and 2 y = -5 + 3 under the load -5."""
    load = lambda t: [5 * np.interp(t, [0, 1, 2], [0, 1, -1])]  # noqa: E731
    run = vx.march(vx.System([[2.0]], load, vx.Norms([[1.0]], 3.0)), [0.0, 0.5, 1.0, 1.5, 2.0])
    assert run.worn[:, 0] == pytest.approx([0.0, 0.0, 3.0, 3.0, 9.0], abs=1e-14)
    assert run.sticking[:, 0].tolist() == [True, True, False, True, False]
