"""A bolted joint under cyclic load: slip wears the joint at the edges of the clamped zone.

Two steel plates in plane strain lie on each other; each is 80 mm long, 10 mm high and has 40 x 10 cells. A bolt presses
with 60 MPa on the middle 30 mm of both outer faces. The left end of the lower plate is clamped. The right end of the
upper plate is guided along x. A force pulls and pushes this end; only Coulomb friction resists the force. A cycle has
four steps: pulled, free, pushed, free. With the force P of the bolt and the coefficient of friction mu, the largest
pull is 0.6 mu P, so that the joint as a whole does not slip. At each instant the sum of the nodal friction forces
equals the load up to rounding. From the second cycle on, all cycles add the same wear (friction work per length).

    vemcvx run problems/bolted_joint.py --n 10 --steps 40 --plot

A thousand cycles (`--steps 4000`) took 40 CPU seconds, with certified errors of at most 6e-10.
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, BOLT = 0.08, 0.01, 0.03
YOUNG, POISSON, FRICTION = 210e9, 0.3, 0.3
PRESSURE = 60e6
LOAD = 0.6 * FRICTION * PRESSURE * BOLT
JOINT = "lower|upper"
SMALL = {"n": 10, "steps": 12}
UNITS = {"length": "m", "force": "N", "time": "cycles", "force per area": "Pa", "energy per length": "J/m²"}


def bolt_pressure(x, t):
    """Return the constant pressure of the bolt."""
    return np.where(np.abs(x[:, 0] - LENGTH / 2) < BOLT / 2, PRESSURE, 0.0)


def load(t):
    """Return the force on the upper plate along x, per thickness: one cycle per unit of time."""
    return LOAD * np.interp(t % 1.0, [0, 0.25, 0.5, 0.75, 1], [0, 1, 0, -1, 0])


def scene(friction=FRICTION):
    def pull(x, t):
        return np.tile([load(t) / HEIGHT, 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.Clamp(on="lower.left"),
        vx.PrescribedDisplacement(0.0, on="upper.right", direction=(0.0, 1.0)),
        vx.Pressure(bolt_pressure, on=["lower.bottom", "upper.top"]),
        vx.Traction(pull, on="upper.right"),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


initial = "settled"


def mesh(n, family="squares"):
    """Return both plates in 4n x n cells."""
    below, above = ((0, LENGTH), (-HEIGHT, 0)), ((0, LENGTH), (0, HEIGHT))
    make = vx.meshes.FAMILIES[family]
    return vx.meshes.bodies({"lower": make((4 * n, n), box=below), "upper": make((4 * n, n), box=above)})


def times(steps):
    """Return the instants, with four steps per cycle."""
    return np.arange(steps + 1) / 4


def picture(history):
    """Draw the pulled joint, and the wear along the joint."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.6), layout="constrained")
    body, graph = figure.subplots(2, 1, height_ratios=(1.0, 1.3))
    vx.plots.stressed_body(history, ax=body, step=history.steps - 3, stress="shear", units=UNITS)
    vx.plots.along_contact(history, "wear", range(4, history.steps + 1, 4), ax=graph, units=UNITS)
    for edge in (-1, 1):
        graph.axvline(LENGTH / 2 + edge * BOLT / 2, color="0.6", linestyle=":")
    return figure
