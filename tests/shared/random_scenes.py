"""Random scenes on which accuracy targets are tested: blocks that are pulled, pressed and released.

Young's modulus varies over six decades, and Poisson's ratio from 0 to 0.4 (linear triangles lock for larger ratios).
Loads and friction are proportional to the stiffness. In six of ten scenes, the load reverses. One of three scenes has
unilateral contact with Coulomb's friction.
"""

from __future__ import annotations

import numpy as np
from scenes import SEEDED, drawn

import vemcvx as vx


def random_scene(seed):
    """Return a scene, and the instant at which the load reverses (1 for monotone loads)."""
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
    """Return a coarse mesh of a family that depends on the seed."""
    return vx.meshes.FAMILIES[drawn(SEEDED[seed % len(SEEDED)], seed)](n)


KINDS = ("heat", "bump", "patch", "dip", "Coulomb", "free", "turn", "smooth")
"""Scene number k is of the kind KINDS[k % 8]."""


def feature_scene(seed):
    """Return a scene and the initial state. A coarse run may miss a feature of the scene."""
    rng = np.random.default_rng(1000 + seed)
    young, poisson = 10 ** rng.uniform(-2, 4), rng.uniform(0, 0.4)
    steel, clamp = vx.Elasticity(young, poisson), vx.Clamp(on="right")
    size, place, when = young * rng.uniform(0.02, 0.06), rng.uniform(0.25, 0.6), rng.uniform(0.25, 0.75)

    def pull(course, push=size, on="left"):
        return vx.Traction(lambda x, t: course(t) * push * np.column_stack([1.3 - x[:, 1], 0.0 * x[:, 0]]), on=on)

    def press(course, push=size):
        return vx.Pressure(lambda x, t: np.full(len(x), push * course(t)), on="top")

    def ramp(t):
        return t

    def turn(t):
        return np.interp(t, [0.0, when, 1.0], [0.0, 1.0, -0.8])

    def wave(t):
        return np.sin(np.pi * (1 + when) * t)

    rough = vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound=0.3 * size, on="bottom")
    kind = KINDS[seed % len(KINDS)]
    if kind == "heat":
        bell = vx.ThermalStrain(
            0.05, lambda x, t: wave(t) * np.exp(-(((x[:, 0] - place) ** 2 + (x[:, 1] - 0.4) ** 2) / 0.08))
        )
        return vx.Scene(steel, clamp, *rough, bell), None
    if kind == "bump":
        bump = vx.UnilateralContact(on="bottom", gap=lambda x, t: np.where(np.abs(x[:, 0] - place) < 0.05, 0.0, 0.01))
        return vx.Scene(steel, clamp, bump, press(ramp), pull(ramp, 0.2 * size)), None
    if kind == "patch":
        patch = vx.TrescaFriction(lambda x, t: np.where(np.abs(x[:, 0] - place) < 0.07, 4 * size, 0.0), on="bottom")
        return vx.Scene(steel, clamp, vx.BilateralContact(on="bottom"), patch, pull(ramp)), None
    if kind == "dip":
        dip = vx.TrescaFriction(
            lambda x, t: np.full(len(x), size * (0.01 if 0.0 < t - when < 0.05 else 0.8)), on="bottom"
        )
        return vx.Scene(steel, clamp, vx.BilateralContact(on="bottom"), dip, pull(lambda t: 1.0)), "settled"
    if kind == "Coulomb":
        pressed = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(rng.uniform(0.1, 0.4), on="bottom")
        return vx.Scene(steel, clamp, *pressed, press(lambda t: min(4 * t, 1.0)), pull(turn, 0.5 * size)), None
    if kind == "free":
        held = vx.BilateralContact(on="bottom"), vx.TrescaFriction(lambda x, t: size * (0.5 + x[:, 0]), on="bottom")
        return vx.Scene(steel, *held, pull(turn, 0.9 * size)), None
    return vx.Scene(steel, clamp, *rough, pull(turn if kind == "turn" else wave)), None
