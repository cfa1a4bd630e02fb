"""Scenes of every kind, and a program that simulates them until a signal ends it: python interrupted.py FOLDER STORE.

Each scene is run in a process of its own, which sends itself the signal, after a step that chance chooses.
"""

from __future__ import annotations

import os
import signal
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scenes import cyclic, paper_load, paper_scene, small

import vemcvx as vx

# A program of its own finds the problems where tests do.
sys.path.append(str(Path(__file__).parents[2] / "problems"))
from slip_weakening import SlipWeakening

TIMES = np.linspace(0.0, 1.0, 13)
SIGNALS = ("SIGKILL", "SIGTERM", "SIGINT")
STEEL = vx.Elasticity(200.0, 0.3)


def to_and_fro(x, t):
    """A top that presses down and rubs."""
    return np.tile([0.03 * np.sin(6 * t), -0.02 * t], (len(x), 1))


def across(x, t):
    """A side that moves to and fro."""
    return np.full(len(x), 0.03 * np.sin(6 * t))


def course(t):
    """A load that grows, is held, is taken back and held again."""
    return np.interp(t, [0.0, 0.3, 0.55, 0.8, 1.0], [0.0, 1.0, 1.0, -0.4, -0.4])


def changing(x, t):
    """A traction that is at no two instants a multiple of what it was."""
    return np.column_stack([9.0 * np.cos(7 * t * x[:, 1]) * t, -0.3 * t * t * x[:, 1] ** 2])


@dataclass(frozen=True)
class Kind:
    """A scene, and how it is simulated."""

    effects: tuple[vx.Effect, ...]
    family: str = "voronoi"
    options: dict[str, object] = field(default_factory=dict)

    def simulate(self, times=TIMES, **options):
        return vx.simulate(vx.Scene(*self.effects), small(self.family, 4), times, **{**self.options, **options})


BILATERAL = (vx.BilateralContact(on="bottom"),)
PULLED = (STEEL, vx.Clamp(on="right"), vx.Traction(changing, on="left"))
WEAKENING = SlipWeakening(peak=3.0, residual=1.0, distance=0.02, on="bottom")
RUBBED = (STEEL, vx.PrescribedDisplacement(to_and_fro, on="top"))
FREE = (STEEL, vx.Traction(paper_load(cyclic), on="left"), *BILATERAL)
CORNER = (*BILATERAL, vx.TrescaFriction(0.5, on="bottom"))
KINDS = {
    "tresca": Kind((*PULLED, *BILATERAL, vx.TrescaFriction(2.0, on="bottom"))),
    "held steps": Kind(paper_scene(course).effects),
    "one way": Kind((*PULLED, *BILATERAL, vx.TrescaFriction(3.0, on="bottom", backward=0.5))),
    "no friction": Kind(PULLED),
    "unilateral": Kind((*RUBBED, vx.UnilateralContact(on="bottom", gap=0.0005))),
    "compliance": Kind((*RUBBED, vx.NormalCompliance(500.0, on="bottom"), vx.TrescaFriction(0.5, on="bottom"))),
    "coulomb": Kind((*RUBBED, vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom", cap=1.5))),
    "viscous": Kind((*PULLED, vx.Viscosity(9.0, 4.0), *BILATERAL, vx.TrescaFriction(2.0, on="bottom"))),
    "viscous, moved": Kind((*RUBBED, vx.Viscosity(9.0), vx.UnilateralContact(on="bottom"))),
    "unclamped": Kind((*FREE, vx.TrescaFriction(9.0, on="bottom")), "squares"),
    "moved": Kind((*RUBBED, *BILATERAL, vx.TrescaFriction(lambda x, t: 0.5 + x[:, 0] * t, on="bottom"))),
    "thermal": Kind((*PULLED, vx.ThermalStrain(1e-3, temperature=lambda x, t: 9 * t * x[:, 0])), "squares"),
    "not condensed": Kind(paper_scene(course).effects, options={"condense": False}),
    "dragged": Kind((STEEL, vx.PrescribedDisplacement(across, on="left", direction=(1.0, 0.0)), *CORNER), "squares"),
    "weakening": Kind((*PULLED, *BILATERAL, WEAKENING)),
    "weakening, dragged": Kind(
        (STEEL, vx.PrescribedDisplacement(across, on="left", direction=(1.0, 0.0)), *BILATERAL, WEAKENING), "squares"
    ),
    "weakening, viscous": Kind((*PULLED, vx.Viscosity(9.0), *BILATERAL, WEAKENING)),
    "settled": Kind(paper_scene(lambda t: 0.5 + t).effects, options={"initial": "settled"}),
    "refined": Kind(paper_scene(course).effects, options={"solver": vx.Newton(1e-13), "check": False}),
}


def last_step(name):
    """After which the run of that name is to end."""
    return int(np.random.default_rng(list(name.encode())).integers(1, len(TIMES) - 1))


def ending(name, sent):
    """A progress that ends the process."""

    def progress(n, steps):
        if n == last_step(name):
            os.kill(os.getpid(), getattr(signal, sent))

    return progress


def main(folder, store):
    # Made here, and not once more in every process.
    for family in {kind.family for kind in KINDS.values()}:
        small(family, 4)
    for k, (name, kind) in enumerate(KINDS.items()):
        if os.fork() == 0:
            stream, sent = Path(folder) / name, SIGNALS[k % len(SIGNALS)]
            kind.simulate(store=int(store) if store.isdecimal() else store, stream=stream, progress=ending(name, sent))
        os.wait()


if __name__ == "__main__":
    main(*sys.argv[1:])
