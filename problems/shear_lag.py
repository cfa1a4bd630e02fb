"""A thin strip pushed over a rough floor, released and pushed again: shear lag with reversal.

The strip (0, L) x (0, H) with L = 50, H = 1, E = 20000 and nu = 0 is held at x = L. A force per thickness pushes its
end x = 0. The force is 0, F, 0 and F at t = 0, 1, 2 and 3, and linear between these instants. Tresca friction with the
bound g acts below. Because L/H is large, the strip is nearly a rod with the friction g per length. On first loading a
length F/g slips, and the end moves by F^2 / (2 E H g). When the load then reverses by dF, the end moves by
dF^2 / (4 E H g), as long as the zone that slides back is shorter than F/g. So the end returns by half, and the
second push restores the displacement of the first push. The relative error of the rod model is O(H g / F).

    vemcvx run problems/shear_lag.py --n 4 --steps 24
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG, BOUND, FORCE = 50.0, 1.0, 20000.0, 1.0, 20.0
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 36}


def force(t):
    return FORCE * np.interp(t, [0, 1, 2, 3], [0, 1, 0, 1])


def end_displacement():
    """Return the displacements of the rod's end after the push, the release, and the second push."""
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
    """Draw the strip near its pushed end, and the loop of force and displacement of this end."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    body, graph = figure.subplots(2, 1)
    how = {"stress": "xx", "forces": "friction", "stretch": 3.4, "units": UNITS}
    window = ((-0.6, 26.0), (-0.4, HEIGHT + 0.1))
    vx.plots.stressed_body(history, step=history.steps // 3, ax=body, window=window, **how)
    first, back, _ = end_displacement()
    F, k = np.linspace(0, FORCE, 200), 4 * YOUNG * HEIGHT * BOUND
    line = np.concatenate([2 * F**2 / k, first - F**2 / k, back + F**2 / k])
    graph.plot(line, np.concatenate([F, FORCE - F, F]), "k-", label="rod")
    end = history.mesh.points[:, 0] == 0
    graph.plot(history.displacement[:, end, 0].mean(axis=1), force(history.times), "C0o", label="computed")
    graph.set(xlabel="displacement of the end (mm)", ylabel="push (N/mm)")
    graph.grid()
    graph.legend()
    return figure
