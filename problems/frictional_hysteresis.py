r"""A block sheared back and forth over a rough floor: stick, slip and reversal in closed form, exact on every mesh.

The block (0, 2) x (0, 1/2), E = 1000, nu = 1/4, rests in bilateral contact with Tresca friction, bound g. Its top is
moved by U(t) = U0 (0, 1, -1, 1) at t = 0, 1, 3, 5, and its sides carry the shear tractions +-mu gamma of a block that
shears uniformly. Then so it does: u = (a + gamma y, 0) with, step by step,

$$ \gamma_n = \operatorname{clip}((U_n - a_{n-1}) / H, \pm g / \mu), \qquad a_n = U_n - \gamma_n H. $$

It sticks (a constant) while mu |gamma| < g and slips as a whole otherwise; a closed loop of amplitude U0 > g H / mu
dissipates 4 g L (U0 - g H / mu). The field is linear, so virtual elements reproduce it on any mesh: whatever differs
from it is the error of the algebra.

    vemcvx run problems/frictional_hysteresis.py --mesh nonconvex --n 4 --steps 40
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph

YOUNG, POISSON, LENGTH, HEIGHT = 1000.0, 0.25, 2.0, 0.5
MU = YOUNG / (2 * (1 + POISSON))
BOUND = 0.8
AMPLITUDE = 2.5 * BOUND * HEIGHT / MU
UNITS = MM
SMALL = {"n": 8, "steps": 40}


def top(t):
    """U(t)."""
    return AMPLITUDE * np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])


def closed_form(instants):
    """The shear gamma and the slip a at every instant."""
    gamma, a = np.zeros(len(instants)), np.zeros(len(instants))
    for n, U in enumerate(top(instants[1:]), start=1):
        gamma[n] = np.clip((U - a[n - 1]) / HEIGHT, -BOUND / MU, BOUND / MU)
        a[n] = U - gamma[n] * HEIGHT
    return gamma, a


def exact(points, instants, floor=0.0):
    """The displacement (N + 1, n_nodes, 2) at the nodes; `floor` is the height of the floor."""
    gamma, a = closed_form(instants)
    along = a[:, None] + gamma[:, None] * (points[:, 1] - floor)
    return np.stack([along, np.zeros_like(along)], axis=2)


def scene(steps=20):
    instants = times(steps)
    gamma, _ = closed_form(instants)

    def shear(sign):
        def force(x, t):
            return np.tile([0.0, sign * MU * np.interp(t, instants, gamma)], (len(x), 1))

        return force

    def moved(x, t):
        return np.tile([top(t), 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.PrescribedDisplacement(moved, on="top"),
        vx.Traction(shear(1.0), on="right"),
        vx.Traction(shear(-1.0), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=BOUND, on="bottom"),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 5.0, steps + 1)


def picture(history):
    """The sheared block at the first turn, and the loop of friction against the motion of the top."""
    figure, graph = body_and_graph(
        history, step=history.steps // 5, stress="shear", forces="friction", stretch=2.0, shares=(1.2, 1.0)
    )
    traction = -history.contact.traction[:, :, 0].mean(axis=1)
    dense = times(1000)
    marks, line = (top(history.times), traction), (top(dense), MU * closed_form(dense)[0])
    beside_closed_form(graph, marks, line)
    for sign in (1, -1):
        graph.axhline(sign * BOUND, color="0.5", linestyle="--", linewidth=1.0)
    graph.legend(frameon=False, fontsize="small", loc="upper left")
    graph.set(ylim=(-0.9, 1.25))
    graph.set(xlabel="top moved aside by $U$ (mm)", ylabel="friction on the floor (MPa)")
    return figure
