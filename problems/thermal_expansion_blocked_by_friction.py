r"""A bar on a rough floor, heated and cooled: it expands from its ends only, and does not come back altogether.

Half of a bar of length 2 L and height H, x = 0 being its middle (a plane of symmetry) and x = L its free end, lies on a
floor with the friction bound g per length. Its temperature theta is the same everywhere and goes 0, T, 0, T at t = 0,
1, 2, 3; plane stress, nu = 0. As a rod, with s the distance from the end, the force N(s) (compression positive) on its
section and the displacement u of the end obey

$$
N' = \pm g \text{ where it slips}, \qquad N = E H \alpha \theta \text{ where it never slipped},
\qquad u = \int (\alpha \theta - N / (E H)) ds.
$$

Heated: friction builds up the force N = g s over the length l = E H alpha T / g, beyond which the bar is locked with
the stress -E alpha T; the end moves by

$$ u_1 = \alpha T l - g l^2 / (2 E H) = E H (\alpha T)^2 / (2 g). $$

Cooled: near the end the slip reverses, N = -g s, up to where this is E H alpha T below the N of before, g s: a length
l / 2. The change of N over it is -2 g s, and the end returns by

$$ \alpha T l / 2 - 2 g (l / 2)^2 / (2 E H) = E H (\alpha T)^2 / (4 g) = u_1 / 2; $$

half of the expansion stays, with compression up to g l / 2 locked in. Heated again, the end returns to u_1, whatever
the number of cycles. What is lost to friction in the first heating is int g u(s) ds = g^2 l^3 / (6 E H), with
u(s) = g (l - s)^2 / (2 E H). The rod is a model: its error is of the order of H / l.

    vemcvx run problems/thermal_expansion_blocked_by_friction.py --n 4 --steps 24
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph

LENGTH, HEIGHT, YOUNG, BOUND, EXPANSION, RISE = 40.0, 1.0, 20000.0, 1.0, 1e-5, 100.0
UNITS = MM
SMALL = {"n": 4, "steps": 36}


def temperature(t):
    return RISE * np.interp(t, [0, 1, 2, 3], [0, 1, 0, 1])


def slip_length(young=YOUNG, bound=BOUND):
    return young * HEIGHT * EXPANSION * RISE / bound


def end_displacement(young=YOUNG, bound=BOUND):
    """Of the rod, when heated, cooled, and heated again."""
    first = young * HEIGHT * (EXPANSION * RISE) ** 2 / (2 * bound)
    return first, 0.5 * first, first


def first_loss(young=YOUNG, bound=BOUND):
    """Energy lost to friction in the first heating."""
    return bound**2 * slip_length(young, bound) ** 3 / (6 * young * HEIGHT)


def scene(young=YOUNG, bound=BOUND):
    return vx.Scene(
        vx.Elasticity(young=young, poisson=0.0, plane="stress"),
        vx.ThermalStrain(expansion=EXPANSION, temperature=lambda x, t: np.full(len(x), temperature(t))),
        vx.Symmetry(on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=bound, on="bottom"),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 3.0, steps + 1)


def picture(history):
    """The free end of the heated bar, and the loop of its displacement over the temperature."""
    window = ((LENGTH - 26.0, LENGTH + 1.4), (-0.4, HEIGHT + 0.1))
    step = history.steps // 3
    figure, graph = body_and_graph(history, step=step, stress="xx", forces="friction", window=window, stretch=3.4)
    end = history.mesh.points[:, 0] == LENGTH
    found = history.displacement[:, end, 0].mean(axis=1)
    first, back, _ = end_displacement()
    rise = np.linspace(0, RISE, 200)
    share = rise / RISE
    line = np.concatenate([first * share**2, first - back * (1 - share[::-1]) ** 2, back * (1 + share**2)])
    temperatures = np.concatenate([rise, rise[::-1], rise])
    beside_closed_form(graph, (temperature(history.times), found), (temperatures, line), exact_label="rod")
    graph.set(xlabel="temperature (degrees)", ylabel="end moved by (mm)")
    return figure
