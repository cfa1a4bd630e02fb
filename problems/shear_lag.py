"""A thin strip pushed over a rough floor, released and pushed again: shear lag with reversal.

The strip (0, 50) x (0, 1), E = 200, nu = 0, is held at its far end and pushed at x = 0 with the force F(t) on its
cross section: 0, F, 0, F at t = 0, 1, 2, 3. Tresca friction with bound g resists below. Because L/H is large the
strip is a rod with friction g per length: on first loading a length F/g slips and the end moves by F^2 / (2 E H g);
when the load then changes by dF against its last direction, the end moves by dF^2 / (4 E H g), as long as the zone
that slides back is inside the first. So it returns by half, and the second push brings it to where the first one left
it. The rod is a model: its error is of the order of H over the slip length.

    vemcvx run problems/shear_lag.py --n 4 --steps 24
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG, BOUND, FORCE = 50.0, 1.0, 200.0, 1.0, 20.0


def force(t):
    return FORCE * np.interp(t, [0, 1, 2, 3], [0, 1, 0, 1])


def end_displacement():
    """Of the rod, when pushed, released, and pushed again."""
    first = FORCE**2 / (2 * YOUNG * HEIGHT * BOUND)
    back = FORCE**2 / (4 * YOUNG * HEIGHT * BOUND)
    return first, first - back, first


def scene(young=YOUNG, bound=BOUND):
    def push(x, t):
        return np.tile([force(t) / HEIGHT, 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=young, poisson=0.0),
        vx.Clamp(on="right"),
        vx.Traction(push, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=bound, on="bottom"),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 3.0, steps + 1)
