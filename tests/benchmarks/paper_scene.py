"""The scenes of the benchmarks: Section 4 of Feng, Han and Huang, and a block in space under a rotating load."""

from __future__ import annotations

import numpy as np

import vemcvx as vx

YOUNG, POISSON, BOUND = 200.0, 0.3, 4.0


def pull(x, t):
    return np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])


SCENE = vx.Scene(
    vx.Elasticity(YOUNG, POISSON),
    vx.Clamp(on="right"),
    vx.Traction(pull, on="left"),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(BOUND, on="bottom"),
)


def turn(x, t):
    size = 0.5 * min(1.0, 4 * t)
    return np.tile(size * np.array([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t), -0.2]), (len(x), 1))


BLOCK = vx.Scene(
    vx.Elasticity(2.5, 0.25),
    vx.Clamp(on="right"),
    vx.Traction(turn, on="top"),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(0.2, on="bottom"),
)
