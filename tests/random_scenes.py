"""The declared random family of scenes on which targets of accuracy are tried: blocks, pulled, pressed and let go.

Young's modulus over six decades, Poisson's ratio up to .4 (linear triangles lock beyond), loads and friction in
proportion to stiffness, a load that turns back at some instant in six cases of ten; in one of three contact is
one-sided and friction Coulomb's.
"""

from __future__ import annotations

import numpy as np

import vemcvx as vx

FAMILIES = ("squares", "triangles", "voronoi", "hexagons", "distorted", "nonconvex", "hanging")


def random_scene(seed):
    """A scene, and the instant at which its load turns (1 if it does not)."""
    rng = np.random.default_rng(seed)
    young, poisson = 10 ** rng.uniform(-2, 4), rng.uniform(0, 0.4)
    push, lift, bound, press = young * rng.uniform([0.01, -0.01, 0.002, 0.005], [0.06, 0.01, 0.04, 0.03])
    turn = rng.uniform(0.2, 0.9) if rng.random() < 0.6 else 1.0
    low, tilt = rng.uniform(-1, 0.8), rng.uniform(-1, 1)

    def course(t):
        return t / turn if t <= turn else 1 - (1 - low) * (t - turn) / (1 - turn)

    def pull(x, t):
        return course(t) * np.column_stack([push * (1 + tilt * (x[:, 1] - 0.5)), np.full(len(x), lift)])

    block = (vx.Elasticity(young, poisson), vx.Clamp(on="right"), vx.Traction(pull, on="left"))
    if seed % 3 < 2:
        return vx.Scene(*block, vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound, on="bottom")), turn
    pressed = vx.Pressure(lambda x, t: np.full(len(x), press * min(5 * t, 1.0)), on="top")
    return vx.Scene(*block, pressed, vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom")), turn


def coarse_mesh(seed, n=6):
    """Of a family that goes with the seed."""
    return vx.meshes.FAMILIES[FAMILIES[seed % len(FAMILIES)]](n)
