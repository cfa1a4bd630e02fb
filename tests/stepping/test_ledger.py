"""Energies and forces balance to rounding."""

from functools import cache

import numpy as np
import pytest
from scenes import cyclic, few_families, mostly_long, paper_load, small

import vemcvx as vx
from vemcvx.scene import pose_scene

pytestmark = pytest.mark.arithmetic

TIMES = np.linspace(0.0, 1.0, 17) ** 1.3


def scene(moving):
    """Return a scene with friction, a body force, and a right side that is clamped or moves."""

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


@cache
def run(family, moving, condense):
    return vx.simulate(scene(moving), small(family, 5), TIMES, solver=vx.Newton(), condense=condense)


@few_families
@mostly_long("condense", [True, False])
@mostly_long("moving", [False, True], 1)
def test_the_ledger_closes(family, moving, condense):
    history = run(family, moving, condense)
    A = pose_scene(history.scene, history.mesh).A
    u = history.displacement.reshape(len(TIMES), -1)
    energy, steps = (0.5 * np.einsum("ni,ni->n", v, (A @ v.T).T) for v in (u, np.diff(u, axis=0)))
    assert np.abs(history.energy - energy).max() < 1e-12 * energy.max()
    remainder = history.work - (history.energy - history.energy[0]) - history.dissipated
    size = np.abs(history.work).max() + history.energy.max()
    assert np.abs(remainder - np.append(0.0, np.cumsum(steps))).max() < 1e-12 * size
    assert steps.sum() > 1e-6 * size
    assert (np.diff(history.dissipated) >= 0).all()
    assert history.dissipated[-1] > 1e-3 * size


@few_families
@pytest.mark.parametrize("moving", [False, True])
def test_reactions_and_friction_balance_the_loads(family, moving):
    history = run(family, moving, True)
    posed, contact = pose_scene(history.scene, history.mesh), history.contact
    for row, t in enumerate(TIMES):
        load = posed.force(t).reshape(-1, 2)
        size = np.abs(load).sum() + np.abs(history.forces[row]).sum()
        assert np.abs(load.sum(axis=0) + history.forces[row].sum(axis=0)).max() <= 1e-11 * size
    supported = history.reaction("right") + history.force("bottom")
    assert np.abs(supported - history.forces.sum(axis=1)).max() < 1e-11 * np.abs(history.forces).sum(axis=(1, 2)).max()
    if not moving:
        force = contact.traction - contact.pressure[:, :, None] * contact.normals
        nodal = history.forces[:, contact.nodes]
        assert np.abs(force * contact.lengths[:, None] - nodal).max() < 1e-11 * np.abs(nodal).max()


def rising(x, t):
    """Return the gap to a floor that rises unevenly, sinks out of reach, and rises again."""
    return 0.03 * (1.02 + np.sin(9 * t + 1.5)) * (1 + 0.3 * x[:, 0])


def on_a_moving_floor(obstacle, *more):
    """Return the scene of a block over an obstacle. The top of the block moves."""
    return vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: [0.01 * t, -0.02 * t], on="top"),
        vx.Traction(lambda x, t: [2.0 * t, 0.0], on="left"),
        obstacle,
        *more,
    )


FLOORS = {
    "rigid": (vx.UnilateralContact(on="bottom", gap=rising),),
    "soft": (vx.NormalCompliance(3000.0, on="bottom", gap=rising),),
    "with friction": (vx.UnilateralContact(on="bottom", gap=rising), vx.TrescaFriction(1.0, on="bottom")),
    "with Coulomb's friction": (vx.UnilateralContact(on="bottom", gap=rising), vx.CoulombFriction(0.3, on="bottom")),
    "viscous": (vx.UnilateralContact(on="bottom", gap=rising), vx.Viscosity(shear=3.0, volume=1.0)),
}


@few_families
@mostly_long("floor", FLOORS, "rigid", "soft", "with Coulomb's friction")
def test_the_ledger_closes_while_obstacles_move(family, floor):
    """The energy balance of :mod:`vemcvx.stepping.state` holds."""
    history = vx.simulate(on_a_moving_floor(*FLOORS[floor]), small(family, 4), TIMES, solver=vx.Newton())
    posed, p = pose_scene(history.scene, history.mesh, TIMES), history.trajectory.pressures
    increments = np.diff(history.displacement, axis=0).reshape(len(TIMES) - 1, -1)
    gaps = np.array([posed.obstacles.gap(t) for t in TIMES])
    closing = increments @ posed.obstacles.rows.T.toarray() - np.diff(gaps, axis=0)
    spring = 0.5 * np.einsum("nj,j->n", p**2, posed.obstacles.compliance)
    square = np.einsum("ni,ni->n", increments, (posed.A @ increments.T).T)
    rest = 0.5 * square + np.einsum("nj,nj->n", p[1:], closing)
    rest = np.append(0.0, np.cumsum(rest)) - spring
    remainder = history.work - (history.energy - history.energy[0]) - history.dissipated
    size = np.abs(history.work).max() + history.energy.max()
    # The certified error limits the work of residual forces.
    slack = history.certificate[1:] * history.trajectory.norm.max() @ np.sqrt(square)
    assert slack <= 1e-7 * size
    assert np.abs(remainder - rest).max() < 1e-12 * size + slack
    assert (np.diff(rest) >= -1e-14 * size).all()
    # The floor pushes, leaves and pushes again.
    pushed = (p > 0).any(axis=1)
    assert len(np.flatnonzero(np.diff(pushed))) >= 3
    assert np.abs(np.einsum("nj,nj->n", p[1:], np.diff(gaps, axis=0))).max() > 1e-2 * size


@few_families
@pytest.mark.parametrize("stiffness", [None, 500.0])
@mostly_long("damped", [False, True])
def test_a_rising_floor_does_the_work_of_its_pressure(family, stiffness, damped):
    """Only the floor moves. The strain is uniaxial."""
    H, L, way = 0.5, 2.0, 0.05
    mesh = small(family, 4, box=((0, L), (0, H)))

    def gap(x, t):
        return np.full(len(x), way * (1 - t))

    touch = vx.UnilateralContact("bottom", gap) if stiffness is None else vx.NormalCompliance(stiffness, "bottom", gap)
    young, poisson, tau = 10.0, 0.25, 0.1 * damped
    mu = young / (2 * (1 + poisson))
    modulus, lam = 3 * mu, mu  # for poisson = 0.25
    scene = vx.Scene(
        vx.Elasticity(young, poisson),
        vx.PrescribedDisplacement(lambda x, t: [0.0, -way], on="top"),
        vx.PrescribedDisplacement(0.0, on=["left", "right"], direction="normal"),
        touch,
        *([vx.Viscosity(shear=tau * mu, volume=tau * lam)] if damped else []),
    )
    start = np.tile([0.0, -way], (mesh.n_nodes, 1))
    times = np.linspace(0, 1, 9)
    history = vx.simulate(scene, mesh, times, initial=start, solver=vx.Newton())
    give, strain = 0.0 if stiffness is None else 1.0 / (stiffness * H), np.zeros(9)
    rate = tau * 8
    for n in range(1, 9):
        strain[n] = (way * times[n] / H + give * modulus * rate * strain[n - 1]) / (1 + give * modulus * (1 + rate))
    pressure = modulus * (strain + rate * np.diff(strain, prepend=0.0))
    work = np.append(0.0, np.cumsum(pressure[1:] * L * way / 8))
    assert history.work == pytest.approx(work, abs=1e-9 * work[-1])
    stored = 0.5 * modulus * strain**2 * L * H + 0.5 * give * pressure**2 * L * H
    assert history.energy == pytest.approx(stored, abs=1e-9 * work[-1])
