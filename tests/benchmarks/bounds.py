"""Set-up and a further step of guaranteed bounds against assembling and factorising K: one run, one thread.

python tests/benchmarks/bounds.py FAMILY N [none|grows|waves|travels]: the cells of FAMILY (n), a body force that is
none, linear in space, a wave that grows, or one that travels.
"""

from __future__ import annotations

import json
import os
import sys
import time
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np

import vemcvx as vx
from vemcvx.bound.hypercircle import hypercircle
from vemcvx.bound.skeleton import Instant
from vemcvx.linear import choose_linear
from vemcvx.scene.pose import pose_scene

BODY = {
    "none": None,
    "grows": lambda x, t: np.column_stack([0.0 * x[:, 0], -t * x[:, 0]]),
    "waves": lambda x, t: t * np.column_stack([np.sin(9.0 * x[:, 1]), np.cos(7.0 * x[:, 0])]),
    "travels": lambda x, t: np.column_stack([np.sin(9.0 * x[:, 1] - 5.0 * t) - np.sin(9.0 * x[:, 1]), 0.0 * x[:, 0]]),
}


def peak() -> float:
    """GB; not ru_maxrss, which a process inherits from the one that starts it."""
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return int(status["VmHWM"].split()[0]) / 2**20


def scene_with(body: str) -> vx.Scene:
    """The paper's scene under a body force."""
    pull = vx.Traction(
        lambda x, t: np.column_stack([8.0 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)]), on="left"
    )
    contact = vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound=4.0, on="bottom")
    loads = [] if BODY[body] is None else [vx.BodyForce(BODY[body])]
    return vx.Scene(vx.Elasticity(young=200.0, poisson=0.3), vx.Clamp(on="right"), pull, *contact, *loads)


def main(family: str, n: int, body: str = "none", steps: int = 6) -> None:
    """Print the figures as JSON."""
    mesh, times = vx.meshes.FAMILIES[family](n), np.linspace(0.0, 1.0, steps + 1)
    # A few bytes a scene of as many terms are warmed up: imports, reference triangles.
    small = vx.simulate(scene_with(body), vx.meshes.FAMILIES[family](4), [0.0, 1.0])
    vx.error_bound(small, step=-1)
    scene = scene_with(body)
    marks = [time.process_time()]

    def lap() -> float:
        marks.append(time.process_time())
        return marks[-1] - marks[-2]

    posed = pose_scene(scene, mesh, times.tolist())
    assembling = lap()
    choose_linear(posed.system.n).factorise(posed.system.K)
    K = assembling + lap()
    circle = hypercircle(posed)
    setup = lap()
    rng = np.random.default_rng(0)
    found = []
    states = [_state(posed, t, rng) for t in times]
    lap()
    for before, now in pairwise(states):
        pair = circle.pair(now, before)
        found.append(lap())
        assert np.isfinite(pair.upper)
    figures = {
        "cells": mesh.n_cells,
        "K": K,
        "assembling": assembling,
        "setup/K": setup / K,
        "first/K": found[0] / K,
        "(setup + first)/K": (setup + found[0]) / K,
        "step/K": float(np.median(found[1:])) / K,
        "GB": peak(),
    }
    print(family, body, json.dumps({name: float(f"{value:.4g}") for name, value in figures.items()}))


def _state(posed: object, t: float, rng: np.random.Generator) -> Instant:
    """A displacement that supports admit, and multipliers: bounds take as long for wrong answers as for right ones."""
    y = 1e-2 * t * rng.normal(size=posed.system.n)
    u = (posed.supports.P @ y + posed.supports.motion(t)).reshape(-1, 2)
    terms = posed.terms
    weights = terms.weights(t)
    return Instant(
        t, u, t * weights[:, None] * np.ones((len(weights), 1)), np.zeros(0), weights, np.zeros(len(weights))
    )


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), *sys.argv[3:4])
