"""The scene that is measured: the paper's, section 4."""

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
