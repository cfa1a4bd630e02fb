r"""A block pressed on a rough floor, then sheared to and fro: two stages, in closed form, exact on every mesh.

The block (0, 2) x (0, 1/2), E = 1000, nu = 0, rests on a floor with Coulomb friction, coefficient f. In the first
stage, 0 <= t <= 1, a pressure that grows to P presses its top: u_y = -t P y / E, and friction does nothing. In the
second one the pressure stays and the top is moved along the floor by U(t) = U0 (0, 1, -1, 1) at t = 1, 2, 4, 6. The
sides carry the shear tractions +-mu gamma of a block that shears uniformly by gamma, with mu = E / 2, and slips as a
whole by a:

$$ \gamma_n = \operatorname{clip}((U_n - a_{n-1}) / H, \pm f P / \mu), \qquad a_n = U_n - \gamma_n H. $$

A closed loop of amplitude U0 > f P H / mu dissipates 4 f P L (U0 - f P H / mu). The first stage has stored
P^2 L H / 2E by then, which stays. Both stages together are one history, `vx.joined`.

    vemcvx run problems/pressed_then_sheared.py --n 4 --out results/pressed --plot --report
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph

YOUNG, LENGTH, HEIGHT, PRESSURE, COEFFICIENT = 1000.0, 2.0, 0.5, 4.0, 0.2
MU = YOUNG / 2
AMPLITUDE = 2.5 * COEFFICIENT * PRESSURE * HEIGHT / MU
TIMES = np.linspace(0.0, 1.0, 3), np.linspace(1.0, 6.0, 41)
"""The instants of both stages."""
UNITS = MM
SMALL = {"n": 4}


def top(t):
    """U(t)."""
    return AMPLITUDE * np.interp(t, [1, 2, 4, 6], [0, 1, -1, 1])


def closed_form(coefficient=COEFFICIENT):
    """The shear gamma and the slip a at every instant of the second stage."""
    gamma, a = np.zeros(len(TIMES[1])), np.zeros(len(TIMES[1]))
    most = coefficient * PRESSURE / MU
    for n, U in enumerate(top(TIMES[1][1:]), start=1):
        gamma[n] = np.clip((U - a[n - 1]) / HEIGHT, -most, most)
        a[n] = U - gamma[n] * HEIGHT
    return gamma, a


def stages(coefficient=COEFFICIENT):
    """Press, then shear."""

    def press(x, t):
        return np.full(len(x), PRESSURE * min(t, 1.0))

    def shear(sign):
        gamma, _ = closed_form(coefficient)
        return lambda x, t: np.tile([0.0, sign * MU * np.interp(t, TIMES[1], gamma)], (len(x), 1))

    def moved(x, t):
        return np.full(len(x), top(t))

    common = (
        vx.Elasticity(young=YOUNG, poisson=0.0),
        vx.Pressure(press, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(coefficient, on="bottom"),
    )
    held = vx.PrescribedDisplacement(0.0, on="top", direction=(1.0, 0.0))
    sheared = (
        vx.PrescribedDisplacement(moved, on="top", direction=(1.0, 0.0)),
        vx.Traction(shear(1.0), on="right"),
        vx.Traction(shear(-1.0), on="left"),
    )
    return [(vx.Scene(*common, held), TIMES[0]), (vx.Scene(*common, *sheared), TIMES[1])]


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0.0, LENGTH), (0.0, HEIGHT)))


def picture(history):
    """The block at the peak, and the loop of its top in the second stage."""
    figure, graph = body_and_graph(history, stress="shear", forces="contact", shares=(1.2, 1.0))
    later = history.times >= 1.0
    gamma, _ = closed_form()
    computed = top(history.times[later]), history.reaction("top")[later, 0]
    beside_closed_form(graph, computed, (top(TIMES[1]), MU * gamma * LENGTH))
    graph.set(xlabel="way of the top (mm)", ylabel="its reaction (N)")
    return figure
