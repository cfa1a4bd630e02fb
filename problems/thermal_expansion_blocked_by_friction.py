r"""A bar on a rough floor, heated and cooled: it expands from its ends only, and does not return completely.

Half of a bar of length 2 L and height H is computed: x = 0 is its middle (a plane of symmetry) and x = L its free end.
The bar lies on a floor with the friction bound g per length, in plane stress, with nu = 0. The temperature theta is
uniform: 0, T, 0, T at t = 0, 1, 2, 3. The coefficient of expansion is alpha. In the model of a rod, s is the distance
from the end. The force N(s) on the section (compression positive) and the displacement u of the end obey

$$
N' = \pm g \text{ where the rod slips}, \qquad N = E H \alpha \theta \text{ where it never slipped},
\qquad u = \int (\alpha \theta - N / (E H)) ds.
$$

During the first heating, friction builds up the force N = g s over the length l = E H alpha T / g. Farther from the end
nothing moves, and the stress is -E alpha T. The end moves by

$$ u_1 = \alpha T l - g l^2 / (2 E H) = E H (\alpha T)^2 / (2 g). $$

During cooling, the bar slips back where s < l / 2. In this part N = -g s: N falls by 2 g s. Where s > l / 2, the bar
does not slip, and N falls by E H alpha T = g l. Both changes are equal at s = l / 2. The end returns by

$$ \alpha T l / 2 - 2 g (l / 2)^2 / (2 E H) = E H (\alpha T)^2 / (4 g) = u_1 / 2. $$

Half of the expansion stays. A tensile force of up to g l / 2 stays, too. During every further heating, the end returns
to u_1. Friction dissipates int g u(s) ds = g^2 l^3 / (6 E H) in the first heating, with u(s) = g (l - s)^2 / (2 E H).
The relative error of the rod model is O(H / l).

    vemcvx run problems/thermal_expansion_blocked_by_friction.py --n 4 --steps 24
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG, BOUND, EXPANSION, RISE = 40.0, 1.0, 20000.0, 1.0, 1e-5, 100.0
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 36}


def temperature(t):
    return RISE * np.interp(t, [0, 1, 2, 3], [0, 1, 0, 1])


def slip_length(young=YOUNG, bound=BOUND):
    return young * HEIGHT * EXPANSION * RISE / bound


def end_displacement(young=YOUNG, bound=BOUND):
    """Return the displacements of the rod's end after heating, cooling, and heating again."""
    first = young * HEIGHT * (EXPANSION * RISE) ** 2 / (2 * bound)
    return first, 0.5 * first, first


def first_dissipation(young=YOUNG, bound=BOUND):
    """Return the energy dissipated by friction in the first heating."""
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
    """Draw the free end of the heated bar, and the loop of its displacement against the temperature."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    body, graph = figure.subplots(2, 1)
    how = {"stress": "xx", "forces": "friction", "stretch": 3.4, "units": UNITS}
    window = ((LENGTH - 26.0, LENGTH + 1.4), (-0.4, HEIGHT + 0.1))
    vx.plots.stressed_body(history, step=history.steps // 3, ax=body, window=window, **how)
    first, back, _ = end_displacement()
    part = np.linspace(0, 1, 200)
    line = np.concatenate([first * part**2, first - back * part**2, back * (1 + part**2)])
    graph.plot(RISE * np.concatenate([part, 1 - part, part]), line, "k-", label="rod")
    end = history.mesh.points[:, 0] == LENGTH
    computed = history.displacement[:, end, 0].mean(axis=1)
    graph.plot(temperature(history.times), computed, "C0o", label="computed")
    graph.set(xlabel="temperature (degrees)", ylabel="displacement of the end (mm)")
    graph.grid()
    graph.legend()
    return figure
