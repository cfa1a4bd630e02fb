"""Random stacks of bodies are compared with the independent program of :mod:`independent_p1`.

A stack has two or three bodies of triangles, on which virtual elements are linear elements. Moduli vary over two
decades, gaps move, and friction between bodies is Tresca's or Coulomb's. The lowest body is clamped, or springs and
a moving obstacle hold it. The uppermost body has a prescribed motion, or only friction holds it under two loads.
"""

from __future__ import annotations

import numpy as np
import pytest
from independent_p1 import AGREE, TIMES, Bodies, March, NotPolished, scalar, vector

import vemcvx as vx

NAMES = ("lower", "middle", "upper")


def stack_boxes(rng):
    """Return the names and the mesh of two or three stacked boxes, and the bodies for the independent program."""
    names = NAMES if rng.random() < 0.4 else ("lower", "upper")
    columns, y, made = int(rng.integers(3, 5)), 0.0, {}
    for name in names:
        height, rows = rng.uniform(0.4, 0.8), int(rng.integers(2, 4))
        made[name] = vx.meshes.triangles((columns, rows), box=((0, 1), (y, y + height)))
        y += height
    mesh = vx.meshes.bodies(made)
    other = Bodies(np.array(mesh.points), np.array(mesh.cells), mesh.cell_data["body"].astype(int), names)
    return names, mesh, other


def draw(seed):
    """Return a scene, its mesh, and the bodies for the independent program."""
    rng = np.random.default_rng(seed)
    names, mesh, other = stack_boxes(rng)
    young, poisson = 10 ** rng.uniform(1, 3, len(names)), rng.uniform(0, 0.4, len(names))
    body = mesh.cell_data["body"].astype(int)
    other.isotropic(young[body], poisson[body])
    effects = [vx.Elasticity(E, nu, on=name) for E, nu, name in zip(young, poisson, names, strict=True)]
    soft, free = young.min(), rng.random() < 0.3
    effects += support_lowest(rng, soft, other)
    effects += load_uppermost(rng, soft, names[-1], other, free)
    # If only friction holds a body, all joints have the same law, because Clarabel fails if laws differ.
    laws = np.full(len(other.joined), rng.random()) if free else rng.random(len(other.joined))
    for joint, law in zip(other.joined, laws, strict=True):
        effects += join(rng, soft, joint, other, free=free, coulomb=law < 0.5)
    return vx.Scene(*effects), mesh, other


def support_lowest(rng, soft, other):
    """Return the supports of the lowest body: a clamp, or springs and a moving obstacle."""
    if rng.random() < 0.5:
        other.clamp("lower.bottom")
        return [vx.Clamp(on="lower.bottom")]
    size, rate = rng.uniform(1e-3, 5e-3), rng.uniform(3, 9)

    def gap(x, y, t):
        return size * (1 - np.cos(rate * t) + x)

    other.springs("lower.left", soft, soft).springs("lower.right", soft, soft).wall("lower.bottom", gap)
    springs = vx.ElasticFoundation(soft, soft, on=["lower.left", "lower.right"])
    return [springs, vx.UnilateralContact(on="lower.bottom", gap=scalar(gap))]


def load_uppermost(rng, soft, name, other, free):
    """Return a motion to and fro or, if `free`, a pressure and a small pull."""
    down, aside, rate = rng.uniform(0.01, 0.03), rng.uniform(0.005, 0.03), rng.uniform(5, 9)
    if not free:

        def move(x, y, t):
            return aside * np.sin(rate * t) + 0 * x, -down * min(2 * t, 1.0) + 0 * x

        other.move(f"{name}.top", move)
        return [vx.PrescribedDisplacement(vector(move), on=f"{name}.top")]
    press, pull = 0.02 * soft, 0.01 * soft * rng.uniform(0.2, 1.0)

    def pressure(x, y, t):
        return press * (1 + 0.2 * x) * min(4 * t, 1.0)

    def force(x, y, t):
        return pull * min(4 * t, 1.0) * np.sin(rate * t) + 0 * x, 0 * x

    other.pressure(f"{name}.top", pressure).traction(f"{name}.left", force)
    return [
        vx.Pressure(scalar(pressure), on=f"{name}.top"),
        vx.Traction(vector(force), on=f"{name}.left"),
    ]


def join(rng, soft, joint, other, *, free, coulomb):
    """Return one-sided contact and friction."""
    size, rate = (0.0 if free else rng.uniform(0, 0.01)), rng.uniform(3, 9)

    def gap(x, y, t):
        return size * ((x - 0.5) ** 2 + 0.3 * np.sin(rate * t) ** 2)

    other.wall(joint, gap)
    contact = vx.UnilateralContact(on=joint, gap=scalar(gap))
    if coulomb:
        mu = rng.uniform(0.2, 0.5) + (0.2 if free else 0.0)
        other.rub(joint, coefficient=lambda x, y: mu + 0 * x)
        return [contact, vx.CoulombFriction(mu, on=joint)]
    bound = soft * rng.uniform(0.002, 0.01) + (0.006 * soft if free else 0.0)
    other.rub(joint, lambda x, y, t: bound * (1 + x))
    return [contact, vx.TrescaFriction(lambda x, t: bound * (1 + x[:, 0]), on=joint, while_closed=False)]


def contact_forces(result, other):
    """Return nodal forces (instants, nodes, 2) of contact and friction. At a joint they act on the body below."""
    found = np.zeros_like(result.forces)
    for parts, values, sign in (
        ([wall[0] for wall in other.obstacles], result.pressures, -1.0),
        ([rub[0] for rub in other.rubs], result.lam, -1.0),
    ):
        column = 0
        for rows in parts:
            part = sign * values[:, column : column + len(rows.nodes), None] * rows.directions
            np.add.at(found, (slice(None), rows.nodes), part)
            column += len(rows.nodes)
    return found


def assert_agreement(seed):
    scene, mesh, other = draw(seed)
    ours = vx.simulate(scene, mesh, TIMES, solver=vx.Newton(accuracy=1e-8))
    theirs, contact = March(other).run(TIMES), ours.contact
    assert ours.certificate.max() <= 1e-8
    forces = contact.traction * contact.friction_lengths[:, None]
    forces = forces - (contact.pressure * contact.lengths)[:, :, None] * contact.normals
    pairs = [(forces, contact_forces(theirs, other)[:, contact.nodes])]
    pairs += [(getattr(ours, name), getattr(theirs, name)) for name in ("displacement", "energy", "work", "dissipated")]
    for one, two in pairs:
        assert np.abs(one - two).max() <= AGREE * (np.abs(two).max() or 1.0)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
@pytest.mark.parametrize("seed", [0, 3, 12, 25])
def test_stacks_agree_with_independent_programs(seed):
    """In stack 25, friction bounds of some iterations are too small to hold the middle body."""
    assert_agreement(seed)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
@pytest.mark.parametrize("chunk", range(6))
def test_many_stacks_agree(chunk):
    """The independent program may fail for at most 2 of the 20 stacks of a chunk."""
    failed = []
    for seed in range(100 + 20 * chunk, 120 + 20 * chunk):
        try:
            assert_agreement(seed)
        except NotPolished:
            failed.append(seed)
    assert len(failed) <= 2, failed
