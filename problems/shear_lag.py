"""A thin strip pushed over a rough floor, released and pushed again: shear lag with reversal.

The strip (0, 50) x (0, 1), E = 20000, nu = 0, is held at its far end and pushed at x = 0 with the force F(t) on its
cross section: 0, F, 0, F at t = 0, 1, 2, 3. Tresca friction with bound g resists below. Because L/H is large the
strip is a rod with friction g per length: on first loading a length F/g slips and the end moves by F^2 / (2 E H g);
when the load then changes by dF against its last direction, the end moves by dF^2 / (4 E H g), as long as the zone
that slides back is inside the first. So it returns by half, and the second push brings it to where the first one left
it. The rod is a model: its error is of the order of H over the slip length.

    vemcvx run problems/shear_lag.py --n 4 --steps 24
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph

LENGTH, HEIGHT, YOUNG, BOUND, FORCE = 50.0, 1.0, 20000.0, 1.0, 20.0
UNITS = MM
SMALL = {"n": 4, "steps": 36}


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


def picture(history):
    """The pushed end, and the loop of force and displacement at it."""
    window = ((-0.6, 26.0), (-0.4, HEIGHT + 0.1))
    step = history.steps // 3
    figure, graph = body_and_graph(history, step=step, stress="xx", forces="friction", window=window, stretch=3.4)
    end = history.mesh.points[:, 0] == 0
    found = history.displacement[:, end, 0].mean(axis=1)
    turns = np.array([force(t) for t in history.times])
    first, back, _ = end_displacement()
    F = np.linspace(0, FORCE, 200)
    pushed, released = F**2 / (2 * YOUNG * HEIGHT * BOUND), first - (FORCE - F) ** 2 / (4 * YOUNG * HEIGHT * BOUND)
    again = back + F**2 / (4 * YOUNG * HEIGHT * BOUND)
    line = np.concatenate([pushed, released[::-1], again]), np.concatenate([F, F[::-1], F])
    beside_closed_form(graph, (found, turns), line, exact_label="rod")
    graph.set(xlabel="displacement of the end (mm)", ylabel="push (N/mm)")
    return figure
