r"""A block pushed over a rough obstacle: Section 4 of Feng, Han and Huang.

The unit square is the cross-section of an elastic body in plane strain, E = 200, nu = .3. The body is clamped on its
right side, x_1 = 1, and rests on a rigid obstacle below, x_2 = 0, in bilateral contact: it can slide but not lift off.
Tresca friction with the bound g = 4 resists sliding. The top is free. The traction on the left side is

$$ f_2(x, t) = (8 (1.25 - x_2) t, -0.01 t), \qquad 0 \le t \le 1. $$

This traction pushes the block to the right, and a little down. There is no body force, and the block is undeformed at
t = 0. Stresses, g and f_2 are in daN/mm^2, lengths in mm, time in s.

At first all nodes stick. At t = .2 the loaded corner begins to slip. Slip spreads to the right as the load grows; where
nodes slip, friction is at its bound and points to the left. At the end nearly half of the contact slips.

    vemcvx run problems/feng_han_huang.py --mesh voronoi --n 24 --steps 64 --plot
"""

import numpy as np

import vemcvx as vx

UNITS = {"length": "mm", "force": "daN", "time": "s", "force per area": "daN/mm²"}
SMALL = {"n": 16, "steps": 32}


def course(t):
    """Return the load at the instant t, divided by the load at t = 1."""
    return t


def scene(young=200.0, poisson=0.3, bound=4.0, push=8.0, press=0.01, course=course, stabilisation="shear"):
    def pull(x, t):
        return np.column_stack([push * (1.25 - x[:, 1]), np.full(len(x), -press)]) * course(t)

    return vx.Scene(
        vx.Elasticity(young=young, poisson=poisson, stabilisation=stabilisation),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=bound, on="bottom"),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the deformed block on its floor, and friction along the floor at four instants."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
    vx.plots.stressed_body(history, ax=body, stress="mean", forces="friction", units=UNITS)
    contact = history.contact
    order = np.argsort(contact.points[:, 0])
    x = contact.points[order, 0]
    for step, grey in zip(np.arange(1, 5) * history.steps // 4, ("0.75", "0.6", "0.4", "0.0"), strict=True):
        friction, slips = contact.traction[step, order, 0], ~contact.sticking[step, order]
        last = step == history.steps
        graph.plot(x, friction, "-", color=grey, label=f"t = {history.times[step]:g}")
        graph.plot(x[slips], friction[slips], "C1s", fillstyle="none", label="slips" if last else None)
        graph.plot(x[~slips], friction[~slips], "C0o", label="sticks" if last else None)
    graph.axhline(-contact.bound.max(), color="0.5", linestyle="--", linewidth=1.0)
    graph.set(xlabel="$x_1$ (mm)", ylabel="friction on the body (daN/mm²)")
    graph.grid()
    graph.legend()
    return figure
