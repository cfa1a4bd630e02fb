"""Set-up and a further step of guaranteed bounds against assembling and factorising K: one run, one thread.

Seconds of the processor: medians of REPEATED K, and of the steps of a run but the first.

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
from vemcvx.bound.skeleton import instant
from vemcvx.linear import choose_linear
from vemcvx.scene import pose_scene

REPEATED = 5
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
    scene = scene_with(body)
    # A small one of as many terms warms up imports and reference triangles, and the run all else.
    vx.error_bound(vx.simulate(scene, vx.meshes.FAMILIES[family](4), [0.0, 1.0]), step=-1)
    history = vx.simulate(scene, mesh, times)
    marks = [time.process_time()]

    def lap() -> float:
        marks.append(time.process_time())
        return marks[-1] - marks[-2]

    assembling, factorising = [], []
    for _ in range(1 + REPEATED):
        posed = pose_scene(scene, mesh, times.tolist())
        assembling.append(lap())
        choose_linear(posed.system.n).factorise(posed.system.K)
        factorising.append(lap())
    # The first one pays for memory that no process has had before.
    K = float(np.median(np.add(assembling, factorising)[1:]))
    before = peak()
    circle = hypercircle(posed)
    setup = lap()
    instants = [instant(history, row) for row in range(steps + 1)]
    found = []
    for one, other in pairwise(instants):
        lap()
        pair = circle.pair(other, one)
        found.append(lap())
        assert pair.lower <= pair.upper
    figures = {
        "cells": mesh.n_cells,
        "K": K,
        "assembling": float(np.median(assembling[1:])),
        "setup/K": setup / K,
        "first/K": found[0] / K,
        "(setup + first)/K": (setup + found[0]) / K,
        "step/K": float(np.median(found[1:])) / K,
        "upper/lower": pair.upper / pair.lower,
        "GB before": before,
        "GB": peak(),
    }
    print(family, body, json.dumps({name: float(f"{value:.4g}") for name, value in figures.items()}))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), *sys.argv[3:4])
