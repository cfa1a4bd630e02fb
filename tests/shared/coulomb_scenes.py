"""The declared random family of scenes with Coulomb friction: moduli over seven decades, coefficients up to 2, loads
that turn back, gaps, caps, obstacles that give way, and bodies that nothing but friction and contact hold."""

from __future__ import annotations

import contextlib
from itertools import pairwise

import numpy as np
from exact_steps import Steps, Stuck
from scenes import SEEDED, drawn

import vemcvx as vx


def coulomb_scene(seed):
    """A scene and its mesh."""
    rng = np.random.default_rng(1000 + seed)
    young, poisson = 10 ** rng.uniform(-2, 5), rng.uniform(0, 0.4)
    mu = rng.choice([rng.uniform(0.05, 0.6), rng.uniform(0.6, 2.0)])
    press = young * 10 ** rng.uniform(-4, -2)
    push, lift = press * rng.uniform(-3, 3), press * rng.uniform(-0.4, 0.4)
    turn, low = rng.uniform(0.3, 0.9) if rng.random() < 0.6 else 1.0, rng.uniform(-1, 0.8)
    kind = ("clamped", "rollers", "moved", "free")[rng.integers(4)]

    def course(t):
        return t / turn if t <= turn else 1 - (1 - low) * (t - turn) / (1 - turn)

    if kind == "free":
        # Pressed and pushed in proportion, below what friction holds; a high push tips some of them over.
        push, lift = push * min(rng.uniform(0.1, 0.9) * mu * press / abs(push), 1.0), 0.0

    def pull(x, t):
        level = course(t) * (min(4 * t, 1.0) if kind == "free" else 1.0)
        return level * np.column_stack([np.full(len(x), push), lift * x[:, 1]])

    def pressing(x, t):
        return np.full(len(x), press * min(4 * t, 1.0))

    def moved(x, t):
        return np.full(len(x), course(t) * push / young)

    held = {
        "clamped": [vx.Clamp(on="right")],
        "rollers": [vx.PrescribedDisplacement(0.0, on="right", direction=(1.0, 0.0))],
        "moved": [vx.PrescribedDisplacement(moved, on="right", direction=(1.0, 0.0))],
        "free": [],
    }[kind]
    slant = press / young * rng.uniform(0, 0.5) if rng.random() < 0.3 and kind in ("clamped", "rollers") else 0.0
    soft, give = rng.random() < 0.25, young * 10 ** rng.uniform(-1, 1)
    cap = press * rng.uniform(0.2, 1.0) * mu if rng.random() < 0.2 and kind != "free" else None
    contact = (
        vx.NormalCompliance(give, on="bottom")
        if soft
        else vx.UnilateralContact(on="bottom", gap=lambda x, t: slant * (x[:, 0] - x[:, 0].min()))
    )
    scene = vx.Scene(
        vx.Elasticity(young, poisson),
        vx.Pressure(pressing, on="top"),
        vx.Traction(pull, on="left"),
        *held,
        contact,
        vx.CoulombFriction(mu, on="bottom", cap=cap),
    )
    return scene, vx.meshes.FAMILIES[drawn(SEEDED[rng.integers(len(SEEDED))], seed)](int(rng.integers(3, 7)))


def away_from_given_friction(system, run):
    """(N,) relative energy distances to the exact steps whose weights are those of the answer; NaN where none is found.

    The weights of an answer are those that its own pressures ask for.
    """
    exact, away = Steps(system), np.full(len(run.times) - 1, np.nan)
    for n, (s, t) in enumerate(pairwise(run.times.tolist()), start=1):
        # Beyond the terms of the system come those of nodes that supports drag along.
        before, w = run.state[n - 1], run.weights[n][: system.norms.count]
        asked = system.norms.weights_under(t, run.pressures[n])
        assert np.abs(w - asked).max() <= 1e-12 * w.max(initial=0.0)
        guess = run.state[n] - before, run.multipliers[n].ravel()[: system.B.shape[0]], run.pressures[n]
        with contextlib.suppress(Stuck):
            step = exact.step(before, s, t, guess, weights=w)
            away[n - 1] = step.distance(exact.scaled(before, run.state[n], step.unit)) / run.unit[n]
    return away
