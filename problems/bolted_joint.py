"""A bolted joint under cycles of load: micro-slip wears it at the edges of the clamped zone. SI units.

Two steel plates, 80 mm x 10 mm each in 40 x 10 cells, plane strain, lie on each other and are clamped together by
nothing but the pressure of a bolt, 60 MPa on the middle 30 mm of both outer faces. The left end of the lower plate is
clamped; the right end of the upper one, guided along x, is pulled and pushed by a force, and only Coulomb's friction
holds it along x. A cycle is four steps: pulled, free, pushed, free. The force is 0.6 mu P, so that the joint as a whole
does not slip, and friction bears it: the sum of its nodal forces is the load, to rounding, at each instant. From the
second cycle on every cycle does the same, and wear (friction work per length) grows in proportion to their number.

    vemcvx run problems/bolted_joint.py --n 10 --steps 40 --plot

A thousand cycles (`--steps 4000`) took 28 CPU seconds, certified to 5e-12: four to six systems a step, each
begun on what stuck, slipped and touched in the step before.
"""

import numpy as np

import vemcvx as vx
from vemcvx.base.canvas import new_figure
from vemcvx.plots import stressed_body, wear

LENGTH, HEIGHT, BOLT = 0.08, 0.01, 0.03
YOUNG, POISSON, FRICTION = 210e9, 0.3, 0.3
PRESSURE = 60e6
LOAD = 0.6 * FRICTION * PRESSURE * BOLT
JOINT = "lower|upper"
SMALL = {"n": 10, "steps": 12}
UNITS = {"length": "m", "time": "cycles", "force per area": "Pa", "energy per length": "J/m²"}


def clamped(x, t):
    """The bolt's pressure: the joint is tightened before t = 0, when it has settled."""
    return np.where(np.abs(x[:, 0] - LENGTH / 2) < BOLT / 2, PRESSURE, 0.0)


def load(t):
    """Force per thickness along x: one cycle per unit of time."""
    return LOAD * np.interp(t % 1.0, [0, 0.25, 0.5, 0.75, 1], [0, 1, 0, -1, 0])


def scene(friction=FRICTION):
    def pull(x, t):
        return np.tile([load(t) / HEIGHT, 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.Clamp(on="lower.left"),
        vx.PrescribedDisplacement(0.0, on="upper.right", direction=(0.0, 1.0)),
        vx.Pressure(clamped, on=["lower.bottom", "upper.top"]),
        vx.Traction(pull, on="upper.right"),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


initial = "settled"


def mesh(n, family="squares"):
    """Both plates in 4n x n cells."""
    below, above = ((0, LENGTH), (-HEIGHT, 0)), ((0, LENGTH), (0, HEIGHT))
    make = vx.meshes.FAMILIES[family]
    return vx.meshes.bodies({"lower": make((4 * n, n), box=below), "upper": make((4 * n, n), box=above)})


def times(steps):
    """Four steps a cycle."""
    return np.arange(steps + 1) / 4


def picture(history):
    """The joint when pulled, and the wear along it: the work of friction at the edges of the clamped zone."""
    figure = new_figure(8.4, 5.6)
    body, graph = figure.subplots(2, 1, height_ratios=(1.0, 1.3))
    stressed_body(history, ax=body, step=history.steps - 3, stress="shear", units=UNITS)
    wear(history, steps=range(4, history.steps + 1, 4), ax=graph, units=UNITS)
    for edge in (-1, 1):
        graph.axvline(LENGTH / 2 + edge * BOLT / 2, color="0.6", linestyle=":", linewidth=1.2)
    return figure
