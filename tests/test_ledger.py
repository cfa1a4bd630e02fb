"""The energy ledger of backward Euler and the balance of forces, to round-off, on every family."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import cyclic, paper_load, small

import vemcvx as vx
from vemcvx.scene.pose import pose

TIMES = np.linspace(0.0, 1.0, 17) ** 1.3


def scene(moving):
    """Friction, a body force, and a right side that is clamped or moves."""

    def motion(x, t):
        return np.column_stack([0.02 * np.sin(3 * t) * (1 + x[:, 1]), -0.01 * t * x[:, 1]])

    side = vx.PrescribedDisplacement(motion, on="right") if moving else vx.Clamp(on="right")
    return vx.Scene(
        vx.Elasticity(200.0, 0.3),
        side,
        vx.BodyForce(lambda x, t: np.column_stack([3.0 * t * x[:, 1], -2.0 * t**2 * x[:, 0]])),
        vx.Traction(paper_load(cyclic), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=lambda x, t: 3.0 + x[:, 0] * t, on="bottom", quadrature="integral"),
    )


@pytest.mark.parametrize("moving", [False, True])
def test_ledger_closes(family, moving):
    history = vx.simulate(scene(moving), small(family, 5), TIMES, solver=vx.Newton())
    A = pose(history.scene, history.mesh).A
    increments = np.diff(history.displacement, axis=0).reshape(len(TIMES) - 1, -1)
    numerical = 0.5 * np.einsum("ni,ni->n", increments, (A @ increments.T).T)
    remainder = history.work - (history.energy - history.energy[0]) - history.dissipated
    # Each entry is a sum of at most 17 differences of numbers of the size of the energies.
    size = np.abs(history.work).max() + history.energy.max()
    assert np.abs(remainder - np.append(0.0, np.cumsum(numerical))).max() < 1e-12 * size
    assert numerical.sum() > 1e-6 * size
    assert (np.diff(history.dissipated) >= 0).all()
    assert history.dissipated[-1] > 1e-3 * size


@pytest.mark.parametrize("moving", [False, True])
def test_stored_energy_is_that_of_the_displacement(family, moving):
    history = vx.simulate(scene(moving), small(family, 4), TIMES, solver=vx.Newton())
    A = pose(history.scene, history.mesh).A
    u = history.displacement.reshape(len(TIMES), -1)
    energy = 0.5 * np.einsum("ni,ni->n", u, (A @ u.T).T)
    assert np.abs(history.energy - energy).max() < 1e-12 * energy.max()


@pytest.mark.parametrize("moving", [False, True])
def test_reactions_and_friction_balance_the_loads(family, moving):
    history = vx.simulate(scene(moving), small(family, 5), TIMES, solver=vx.Newton())
    posed = pose(history.scene, history.mesh)
    for row, t in enumerate(TIMES):
        load = posed.force(t).reshape(-1, 2)
        size = np.abs(load).sum() + np.abs(history.forces[row]).sum()
        assert np.abs(load.sum(axis=0) + history.forces[row].sum(axis=0)).max() <= 1e-11 * size
    # Supports act on right and bottom only; their shared corner must not be counted twice.
    shared = np.intersect1d(*(np.unique(history.mesh.boundaries[name]) for name in ("right", "bottom")))
    supported = history.reaction("right") + history.reaction("bottom") - history.forces[:, shared].sum(axis=1)
    assert np.abs(supported - history.forces.sum(axis=1)).max() < 1e-11 * np.abs(history.forces).sum(axis=(1, 2)).max()


def test_contact_tractions_add_up_to_the_reaction(family):
    """Friction force and pressure per length, times length, are the reaction of the contact nodes."""
    history = vx.simulate(scene(False), small(family, 5), TIMES, solver=vx.Newton())
    contact, part = history.contact, vx.vem.Space(history.mesh).part("bottom", "test")
    lengths = part.node_lengths[np.searchsorted(part.nodes, contact.nodes)]
    force = contact.traction - contact.pressure[:, :, None] * contact.normals
    nodal = history.forces[:, contact.nodes]
    assert np.abs(force * lengths[:, None] - nodal).max() < 1e-11 * np.abs(nodal).max()
