r"""Two blocks that rub on each other, sheared back and forth: the loop of friction in closed form, exact on every mesh.

Blocks of shear moduli mu_1, mu_2 and heights H_1, H_2 lie on each other, with the same length and meshes that do not
match. The lower one is clamped below, the top of the upper one moved by U(t) = U0 (0, 1, -1, 1) at t = 0, 1, 3, 5;
their sides are free along x only, so that both shear uniformly. Bilateral contact and Tresca friction, bound g,
between them. Both carry the friction traction q, so that the slip of the upper over the lower block is

$$ a = U - C q, \qquad C = H_1 / \mu_1 + H_2 / \mu_2, $$

and step by step q_n = clip((U_n - a_{n-1}) / C, +-g): springs in series with a slider. A closed loop of amplitude
U0 > g C dissipates 4 g (U0 - g C) per length. Traces of both sides are linear on the common edges, so virtual elements
reproduce it on any two meshes: whatever differs from it is the error of the algebra.

    vemcvx run problems/two_blocks_in_series.py --mesh nonconvex --n 4 --steps 40
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph

LENGTH, HEIGHTS, YOUNG, POISSON, BOUND = 2.0, (0.6, 0.4), (1000.0, 3000.0), 0.3, 0.8
MU = tuple(young / (2 * (1 + POISSON)) for young in YOUNG)
COMPLIANCE = sum(height / mu for height, mu in zip(HEIGHTS, MU, strict=True))
AMPLITUDE = 2.5 * BOUND * COMPLIANCE
JOINT = "lower|upper"
UNITS = MM
SMALL = {"n": 4, "steps": 40}


def top(t):
    """U(t)."""
    return AMPLITUDE * np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])


def closed_form(instants):
    """The friction traction q and the slip a of the upper block over the lower one at every instant."""
    q, a = np.zeros(len(instants)), np.zeros(len(instants))
    for n, U in enumerate(top(instants[1:]), start=1):
        q[n] = np.clip((U - a[n - 1]) / COMPLIANCE, -BOUND, BOUND)
        a[n] = U - q[n] * COMPLIANCE
    return q, a


def scene():
    def moved(x, t):
        return np.tile([top(t), 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON, on="lower"),
        vx.Elasticity(YOUNG[1], POISSON, on="upper"),
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(moved, on="upper.top"),
        vx.PrescribedDisplacement(
            0.0, on=["lower.left", "lower.right", "upper.left", "upper.right"], direction=(0.0, 1.0)
        ),
        vx.BilateralContact(on=JOINT),
        vx.TrescaFriction(BOUND, on=JOINT),
    )


def mesh(n, family="hexagons"):
    """The lower block in cells of `family`; the upper one in squares, n + 3 across its height."""
    lower = vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHTS[0])))
    upper = vx.meshes.squares(n + 3, box=((0, LENGTH), (HEIGHTS[0], sum(HEIGHTS))))
    return vx.meshes.bodies({"lower": lower, "upper": upper})


def times(steps):
    return np.linspace(0.0, 5.0, steps + 1)


def picture(history):
    """Both blocks at the first turn, and the loop of friction against the motion of the top."""
    figure, graph = body_and_graph(
        history, step=history.steps // 5, stress="shear", forces="friction", shares=(1.2, 1.0)
    )
    traction, dense = history.contact.traction[:, :, 0].mean(axis=1), times(1000)
    beside_closed_form(graph, (top(history.times), traction), (top(dense), closed_form(dense)[0]))
    for sign in (1, -1):
        graph.axhline(sign * BOUND, color="0.5", linestyle="--", linewidth=1.0)
    graph.legend(frameon=False, fontsize="small", loc="upper left")
    graph.set(ylim=(-0.9, 1.25))
    graph.set(xlabel="top moved aside by $U$ (mm)", ylabel="friction between them (MPa)")
    return figure
