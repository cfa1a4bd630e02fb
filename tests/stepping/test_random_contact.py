"""Random scenes of parts that meet: forces and moments balance, the ledger closes, and every law holds on its edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scenes import FAMILIES

import vemcvx as vx
from vemcvx.scene import pose_scene

TIMES = np.array([0.0, 0.15, 0.3, 0.5, 0.6, 0.8, 1.0])
SIZE = 200.0
ON = ("west", "middle", "east", "low left")
CUTS = {"west": (-1.0, 0.37), "middle": (0.37, 0.7), "east": (0.7, 2.0)}


def mesh_of(rng, seed):
    """A square of some family, its floor in three parts, and the lower part of its left side."""
    made = vx.meshes.FAMILIES[FAMILIES[seed % len(FAMILIES)]](int(rng.integers(3, 6)))
    for name, (low, high) in CUTS.items():
        made = made.with_boundary(
            name, lambda p, low=low, high=high: (p[:, 1] < 1e-9) & (p[:, 0] >= low) & (p[:, 0] < high)
        )
    return made.with_boundary("low left", lambda p: (p[:, 0] < 1e-9) & (p[:, 1] < 0.6))


@dataclass(frozen=True)
class Wave:
    """A function of place and time, level + slope x + swing sin(rate t + phase), times a share of time."""

    level: float
    slope: float
    swing: float
    rate: float
    phase: float

    def __call__(self, x, t):
        return self.level + self.slope * x.sum(axis=1) + self.swing * np.sin(self.rate * t + self.phase)


def wave(rng, size, positive=False):
    level, slope, swing = size * rng.normal(size=3) * [1, 0.5, 0.5]
    if positive:
        level, slope, swing = abs(level) + abs(swing), abs(slope), swing
    return Wave(level, slope, swing, rng.uniform(2, 9), rng.uniform(0, 6))


def part(rng, on, frictional):
    """Contact on a part, and friction that may go with it."""
    gap = wave(rng, 2e-3, positive=True)
    kind = rng.choice(["rigid", "soft", "bilateral", "free"], p=[0.5, 0.2, 0.2, 0.1])
    contact = {
        "rigid": (vx.UnilateralContact(on=on, gap=gap),),
        "soft": (vx.NormalCompliance(float(SIZE * rng.uniform(2, 20)), on=on, gap=gap),),
        "bilateral": (vx.BilateralContact(on=on),),
        "free": (),
    }[str(kind)]
    law = rng.choice(["none", "Tresca", "one way", "Coulomb"])
    bound = wave(rng, 2e-3 * SIZE, positive=True)
    if kind == "free" or law == "none":
        return contact
    if law == "Coulomb" and kind != "bilateral" and frictional:
        return *contact, vx.CoulombFriction(float(rng.uniform(0.02, 0.3)), on=on)
    back = wave(rng, 2e-3 * SIZE, positive=True) if law == "one way" else None
    quadrature = str(rng.choice(["nodes", "integral"]))
    return *contact, vx.TrescaFriction(bound, on=on, backward=back, quadrature=quadrature)


def random_scene(seed, frictional=False):
    rng = np.random.default_rng(seed)
    mesh = mesh_of(rng, seed)
    down, along = wave(rng, 0.01), wave(rng, 0.02)

    def top(x, t):
        return t * np.column_stack([along(x, t), -0.01 + down(x, t) - 0.005 * x[:, 0]])

    effects = [vx.Elasticity(SIZE, float(rng.uniform(-0.2, 0.4))), vx.PrescribedDisplacement(top, on="top")]
    wx, wy = wave(rng, 0.5), wave(rng, 0.5)

    def force(x, t):
        return t * np.column_stack([wx(x, t), wy(x, t)])

    effects += [vx.BodyForce(force)] if rng.random() < 0.5 else []
    side = rng.choice(["free", "roller", "slide", "dragged", "clamped"])
    pull = wave(rng, 0.01)
    effects += {
        "free": [vx.Traction(force, on="right")],
        "roller": [vx.PrescribedDisplacement(0.0, on="low right", direction="normal")],
        "slide": [vx.PrescribedDisplacement(lambda x, t: t * pull(x, t), on="low right", direction=(0.6, 0.8))],
        "dragged": [vx.PrescribedDisplacement(lambda x, t: t * pull(x, t), on="low right", direction=(1.0, 0.0))],
        "clamped": [vx.PrescribedDisplacement(lambda x, t: t * np.outer(pull(x, t), [1.0, 0.2]), on="low right")],
    }[str(side)]
    mesh = mesh.with_boundary("low right", lambda p: (p[:, 0] > 1 - 1e-9) & (p[:, 1] < 0.6))
    for on in ON:
        effects += part(rng, on, frictional)
    if rng.random() < 0.3:
        effects.append(vx.ElasticFoundation(normal=20.0, tangential=30.0, on="right"))
    viscous = not frictional and rng.random() < 0.25
    effects += [vx.Viscosity(shear=5.0, volume=2.0)] if viscous else []
    return vx.Scene(*effects), mesh, viscous


def balances(history, posed, viscous):
    """Nodal forces and loads, with springs, have neither a resultant nor a moment, instant by instant."""
    points, first = history.mesh.points, int(viscous)
    load = np.array([posed.force(t) for t in TIMES]).reshape(history.forces.shape)
    if posed.springs is not None:
        load -= (posed.springs @ history.displacement.reshape(len(TIMES), -1).T).T.reshape(load.shape)
    total = (history.forces + load)[first:]
    scale = np.abs(history.forces).sum(axis=(1, 2)).max() + np.abs(load).sum(axis=(1, 2)).max()
    assert np.abs(total.sum(axis=1)).max() < 1e-12 * scale
    assert np.abs(np.einsum("ia,sia->s", points @ [[0, 1], [-1, 0]], total)).max() < 1e-12 * scale


def slack_of(history):
    """What the certified error leaves open: the energy norm of the errors."""
    run = history.trajectory
    return np.sqrt(2 * run.gap) + 1e-13 * run.norm.max()


def closes(history, posed):
    """work - dE - loss = 1/2 a(du, du) + p . dz, less what soft limits store."""
    p, du = history.trajectory.pressures, np.diff(history.displacement.reshape(len(TIMES), -1), axis=0)
    obstacles, square = posed.obstacles, np.einsum("ni,ni->n", du, (posed.A @ du.T).T)
    rest, stored = 0.5 * square, 0.0
    if len(obstacles.nodes):
        gaps = np.array([obstacles.gap(t) for t in TIMES])
        rest = rest + np.einsum("nj,nj->n", p[1:], (obstacles.rows @ du.T).T - np.diff(gaps, axis=0))
        stored = 0.5 * np.einsum("nj,j->n", p**2, obstacles.compliance)
        stored -= stored[0]
    left = history.work - (history.energy - history.energy[0]) - history.dissipated
    open_ = 1e-12 * (np.abs(history.work).max() + history.energy.max()) + slack_of(history)[1:] @ np.sqrt(square)
    assert np.abs(left - np.append(0.0, np.cumsum(rest)) + stored).max() < open_


def contact_forces(history):
    """(S, n_nodes, 2) what contact and friction exert, by what they show."""
    contact, force = history.contact, np.zeros_like(history.forces)
    force[:, contact.nodes] = contact.traction * contact.friction_lengths[:, None]
    force[:, contact.nodes] -= (contact.pressure * contact.lengths)[:, :, None] * contact.normals
    return force


def shows_its_own(history, posed, viscous):
    """What is shown as traction and pressure is all that acts on nodes, but for supports along what they hold."""
    rest = (history.forces - contact_forces(history))[int(viscous) :]
    mesh = history.mesh
    corner = np.flatnonzero(np.abs(mesh.points).max(axis=1) < 1e-12)
    given = posed.supports.given
    nodes, along = (np.concatenate([getattr(one, name) for one in given]) for name in ("nodes", "directions"))
    # Of what holds a node the part of contact is in its pressure; the rest is along what else holds it.
    of_contact = np.concatenate([np.full(len(one.nodes), one.contact) for one in given])
    outer = ~of_contact & ~posed.supports.depends
    count = np.bincount(nodes[outer], minlength=mesh.n_nodes)
    free = count == 0
    free[corner] = False
    stiffest = np.sqrt(posed.A.diagonal().max())
    open_ = slack_of(history)[int(viscous) :].max() * stiffest * 2 + 1e-11 * np.abs(history.forces).max()
    if viscous:
        # There the certificate is in the norm of the viscous step, whose stiffness is larger.
        stiffest = np.sqrt((posed.A + posed.viscosity / np.diff(TIMES).min()).diagonal().max())
        open_ = slack_of(history).max() * stiffest * 2 + 1e-11 * np.abs(history.forces).max()
    assert np.abs(rest[:, free]).max() < open_
    rows = np.flatnonzero(outer & (count[nodes] == 1) & ~np.isin(nodes, corner))
    single, across = nodes[rows], along[rows] @ [[0, 1], [-1, 0]]
    assert np.abs(np.einsum("sia,ia->si", rest[:, single], across)).max(initial=0.0) < open_


def obeys(history):
    """Friction keeps to its bounds; what never closes exerts nothing."""
    contact = history.contact
    size = np.abs(history.forces).max()
    tangents = np.column_stack([-contact.normals[:, 1], contact.normals[:, 0]])
    inner = np.abs(contact.points).max(axis=1) > 1e-12
    pull = np.einsum("smd,md->sm", contact.traction, tangents)[:, inner] * contact.friction_lengths[inner]
    forward, backward = (
        bound[:, inner] * contact.friction_lengths[inner] for bound in (contact.bound, contact.backward)
    )
    assert (pull >= -forward - 1e-6 * size).all()
    assert (pull <= backward + 1e-6 * size).all()


def check(seed, frictional=False):
    """Build, run, and hold a scene to everything above."""
    scene, mesh, viscous = random_scene(seed, frictional)
    # By the solver that is chosen: steps at their rounding floor, 1.2e-8 in scene 16, are good enough then.
    history = vx.simulate(scene, mesh, TIMES, initial=None if viscous else "settled")
    posed = pose_scene(scene, mesh, TIMES)
    balances(history, posed, viscous)
    closes(history, posed)
    shows_its_own(history, posed, viscous)
    obeys(history)
    worn = history.contact.wear @ history.contact.friction_lengths
    if not viscous:
        assert worn == pytest.approx(history.dissipated, abs=1e-12 * max(history.dissipated[-1], 1e-300))


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")
@pytest.mark.filterwarnings("ignore:.*nothing holds the body in the normal direction")
@pytest.mark.parametrize("seed", range(21))
def test_random_scenes(seed):
    check(seed)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")
@pytest.mark.filterwarnings("ignore:.*nothing holds the body in the normal direction")
@pytest.mark.parametrize("coulomb", [False, True])
@pytest.mark.parametrize("seeds", [range(k, k + 50) for k in range(21, 221, 50)], ids=str)
def test_more_random_scenes(seeds, coulomb):
    for seed in seeds:
        check(seed, coulomb)
