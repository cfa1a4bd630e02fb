r"""A block pushed over a rough obstacle: Section 4 of Feng, Han and Huang.

The unit square is the cross-section of an elastic body in plane strain, E = 200, nu = .3. It is clamped on its right
side, x_1 = 1, and rests on a rigid obstacle below, x_2 = 0, in bilateral contact: it can slide there but not lift off.
Sliding is resisted by Tresca friction with the bound g = 4. Its top is free; on its left side acts the traction

$$ f_2(x, t) = (8 (1.25 - x_2) t, -0.01 t), \qquad 0 \le t \le 1, $$

which pushes the block to the right, most strongly at the bottom, and a little down. There is no body force, and
u_0 = 0. Stresses, g and f_2 are in daN/mm^2, lengths in mm, time in s.

What happens: at first everything sticks. After a fifth of the time the loaded corner begins to slip, and slip spreads
to the right as the load grows, against friction that points to the left at its bound. In the end nearly half of the
contact slips.

    vemcvx run problems/feng_han_huang.py --mesh voronoi --n 24 --steps 64 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import SLID, STUCK, body_and_graph
from vemcvx.base.canvas import light_grid

UNITS = {"length": "mm", "force": "daN", "time": "s", "force per area": "daN/mm²"}
SMALL = {"n": 16, "steps": 32}


def course(t):
    """The load in time, as part of that at t = 1."""
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
    """The deformed block on its floor, and how friction reaches its bound, node after node, as the load grows."""
    figure, graph = body_and_graph(history, stress="mean", forces="friction", shares=(1.1, 1.0), units=UNITS)
    contact = history.contact
    order = np.argsort(contact.points[:, 0])
    x, quarters = contact.points[order, 0], np.arange(1, 5) * history.steps // 4
    for step, grey in zip(quarters, ("0.75", "0.6", "0.4", "0.0"), strict=True):
        friction, slips = contact.traction[step, order, 0], ~contact.sticking[step, order]
        graph.plot(x, friction, "-", color=grey, linewidth=1.2, label=f"t = {history.times[step]:g}")
        for chosen, kind in ((slips, SLID), (~slips, STUCK)):
            graph.plot(x[chosen], friction[chosen], **kind, markersize=3.5, zorder=3)
    graph.axhline(-contact.bound.max(), color="0.5", linestyle="--", linewidth=1.0)
    for kind, words in ((SLID, "slips"), (STUCK, "sticks")):
        graph.plot([], [], **kind, markersize=4, label=words)
    light_grid(graph)
    graph.legend(frameon=False, fontsize="small")
    graph.set(xlabel="$x_1$ (mm)", ylabel="friction on the body (daN/mm²)")
    return figure
