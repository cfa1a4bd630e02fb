r"""A belt moves back and forth under a strip that is held at one end: partial slip, and the force of the support.

The strip (0, L) x (0, H), plane stress, nu = 0, lies on a belt with the friction bound g per length and is held at
x = 0. The belt moves by U(t) = U0 (0, 1, -1, 1) at t = 0, 1, 3, 5. In the rod model, u is the displacement. Next to the
support, over a length l, the rod slips, and friction pulls the rod along. Beyond l the rod moves with the belt:

$$
E H u'' = -g, \qquad u(0) = 0, \qquad u(l) = U, \qquad u'(l) = 0: \qquad u = U - g (l - x)^2 / (2 E H),
\qquad l = (2 E H U / g)^{1/2}.
$$

So the force of the support is F(U) = g l. For U >= U* = g L^2 / (2 E H) all of the strip slips, and F = g L. When the
belt reverses at U1, friction reverses in a zone that grows from the support. By Masing's rule (1926), the force of the
support is then F(U1) - 2 F((U1 - U) / 2). In the first motion up to U1 > U*, the work of the belt is
2/3 g L U* + g L (U1 - U*), of which g L U* / 3 is stored. The relative error of the rod model is O(H / l).

    vemcvx run problems/strip_on_a_belt.py --n 4 --steps 40 --plot
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG, BOUND = 20.0, 1.0, 2000.0, 1.0
FULL = BOUND * LENGTH**2 / (2 * YOUNG * HEIGHT)
AMPLITUDE = 1.25 * FULL
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 40}


def move_belt(t):
    """Return the displacement of the belt."""
    return AMPLITUDE * np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])


def hold(t):
    """Return the force F of the support, by the rod model."""

    def first(U):
        return BOUND * LENGTH * np.minimum(np.sqrt(U / FULL), 1.0)

    back, forth = ((AMPLITUDE + sign * move_belt(t)) / 2 for sign in (-1, 1))
    most = BOUND * LENGTH
    return np.select([t <= 1, t <= 3], [first(np.abs(move_belt(t))), most - 2 * first(back)], 2 * first(forth) - most)


def displacement(x, U):
    """Return the displacement of the rod in the first motion of the belt, for U <= U*."""
    slips = np.sqrt(2 * YOUNG * HEIGHT * U / BOUND)
    return U - BOUND * np.maximum(slips - x, 0.0) ** 2 / (2 * YOUNG * HEIGHT)


def scene(bound=BOUND):
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=0.0, plane="stress"),
        vx.Symmetry(on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom", ground=lambda x, t: (move_belt(t), 0.0)),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 5.0, steps + 1)


def picture(history):
    """Draw the strip in the first motion of the belt, and the force of the support against the belt's displacement."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    body, graph = figure.subplots(2, 1)
    how = {"stress": "xx", "forces": "friction", "stretch": 2.5, "units": UNITS}
    vx.plots.stressed_body(history, step=history.steps // 10, ax=body, **how)
    dense = times(2000)
    graph.plot(move_belt(dense), hold(dense), "k-", label="rod")
    graph.plot(move_belt(history.times), -history.reaction("left")[:, 0], "C0o", label="computed")
    for sign in (1, -1):
        graph.axhline(sign * BOUND * LENGTH, color="0.5", linestyle="--", linewidth=1.0)
    graph.set(xlabel="displacement of the belt (mm)", ylabel="force of the support (N/mm)")
    graph.grid()
    graph.legend(loc="lower right")
    return figure
