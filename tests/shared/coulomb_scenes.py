"""The declared random family of scenes with Coulomb friction: moduli over seven decades, coefficients up to 2, loads
that turn back, gaps, caps, obstacles that give way, and bodies that nothing but friction and contact hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scenes import SEEDED, drawn

import vemcvx as vx
from vemcvx.stepping.posed_step import pose_step


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


def converged(run, before, now, programs=250):
    """The step by convex programs alone, iterated until nothing moves by more than 1e-12; None where that fails.

    It knows nothing of what judges the package's own answers.
    """
    norms, newton = run.system.norms, vx.Newton(accuracy=1e-11, max_iterations=400)
    run = replace(run.asking(newton), check=False)
    w, last, damping, before_that = norms.weights_under(now.t, before.p), np.inf, 1.0, None
    if run.operators.kernel is not None:
        w = np.full(len(w), np.abs(pose_step(run, before, now, w).program.g).sum())
    for k in range(programs):
        state = pose_step(run, before, now, w).solve()
        if before_that is not None:
            apart = energy_norm(run, state.y - before_that.y)
            if apart <= 1e-12 * state.scale:
                return state
            if k > 15 and apart > 0.97 * last:
                damping = max(0.7 * damping, 0.1)
            last = apart
        before_that = state
        w = (1 - damping) * w + damping * norms.weights_under(now.t, state.p)
    return None


def energy_norm(run, y):
    """|y|_K of the retained unknowns (m,)."""
    return float(np.sqrt(max(y @ (run.operators.K @ y), 0.0)))
