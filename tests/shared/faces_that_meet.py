"""Random scenes in space with friction on one face of a block, or on several faces that meet at edges and corners."""

from __future__ import annotations

from functools import partial

import numpy as np

import vemcvx as vx

FAMILIES = [vx.meshes.cubes, vx.meshes.tetrahedra, vx.meshes.voronoi3, vx.meshes.kelvin, vx.meshes.prisms]
KINDS = ["tresca_bi", "tresca_uni", "coulomb", "tresca_closed", "compl"]
TIMES = np.linspace(0.0, 1.0, 4)


def random_scene(seed):
    """Return a scene, a mesh, and the kind of friction."""
    rng = np.random.default_rng(seed)
    family, n = FAMILIES[rng.integers(5)], int(rng.integers(2, 4))
    count = int(rng.integers(1, 4))
    on = [str(name) for name in rng.choice(["bottom", "front", "left"], count, replace=False)]
    sway, speed, _ = rng.standard_normal((2, 3)) * 0.02, rng.uniform(1, 6, 2), rng.uniform(0, 6, 2)

    def force(x, t):
        swings = sway[0] * np.cos(speed[0] * t) + sway[1] * np.sin(speed[1] * t) - [0.0, 0.0, 0.02]
        return np.tile(min(1.0, 5 * t) * swings, (len(x), 1))

    kind = KINDS[rng.integers(5)]
    size, along = 10 ** rng.uniform(-3.5, -1.5), rng.uniform(-1, 1, 3)

    def bound(x, t):
        return size * np.maximum(0.0, (x - 0.5) @ along + 0.3)

    coefficient = float(rng.uniform(0.05, 0.6))
    contact = {"tresca_bi": vx.BilateralContact, "compl": partial(vx.NormalCompliance, 5.0)}
    friction = vx.CoulombFriction(coefficient, on=on)
    if kind.startswith("tresca"):
        closed = True if kind == "tresca_closed" else None
        friction = vx.TrescaFriction(bound, on=on, while_closed=closed)
    effects = [
        vx.Elasticity(1.0, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(force, on="top"),
        contact.get(kind, vx.UnilateralContact)(on=on),
        friction,
    ]
    if rng.random() < 0.3:
        effects.append(vx.Symmetry(on="back"))
    return vx.Scene(*effects), family(n), kind
