r"""A tendon, tensioned, bonded and released: friction preserves its stress except along the transfer length.

Half of a tendon is computed, with the length L from the middle x = 0 and the height H, in plane stress with nu = 0. At
t = 0 a jack at x = L holds the prestress S of the tendon, and u = 0. The tendon lies on a bed with the friction bound g
per length. The jack releases the tendon, pulls again and releases again: at t = 0, 1, 2, 3 the stress at the end is S,
0, 0.6 S and 0. Let s be the distance from the end, T the pull at the end (a force), N the force in the tendon, and
N_0 = S H. During the first release T falls to 0, and the end draws in by u_1. The theory of rods gives

$$ N = \min(N_0, T + g s), \qquad \text{transfer length } N_0 / g, \qquad u_1 = N_0^2 / (2 E H g). $$

The second pull Q reverses friction along the length Q / 2g, where N = Q - g s, and reduces the draw-in by
Q^2 / (4 E H g). The second release restores u_1. In pretensioned concrete, a measured draw-in tests the anchorage
(Guyon, *Prestressed Concrete*, 1953). The relative error of the theory of rods is O(g H / N_0).

    vemcvx run problems/pretensioned_tendon.py --n 4 --steps 24 --plot
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG, BOUND, PRESTRESS, AGAIN = 40.0, 1.0, 20000.0, 1.0, 24.0, 0.6
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 24}


def jack(t):
    """Return the stress with which the jack pulls at the end."""
    return PRESTRESS * np.interp(t, [0, 1, 2, 3], [1, 0, AGAIN, 0])


def transfer_length():
    return PRESTRESS * HEIGHT / BOUND


def draw_in():
    """Return three draw-ins of the end: after the first release, the second pull and the second release."""
    first = (PRESTRESS * HEIGHT) ** 2 / (2 * YOUNG * HEIGHT * BOUND)
    return first, first - (AGAIN * PRESTRESS * HEIGHT) ** 2 / (4 * YOUNG * HEIGHT * BOUND), first


def stress(s, again=False):
    """Return the stress of the rod at the distance s from its end, after the release or after the second pull."""
    released = np.minimum(PRESTRESS, BOUND * s / HEIGHT)
    return np.maximum(released, AGAIN * PRESTRESS - BOUND * s / HEIGHT) if again else released


def scene(prestress=PRESTRESS, bound=BOUND):
    def pull(x, t):
        return np.tile([prestress / PRESTRESS * jack(t), 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=0.0, plane="stress"),
        vx.Prestress((prestress, 0.0, 0.0)),
        vx.Symmetry(on="left"),
        vx.Traction(pull, on="right"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom"),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 3.0, steps + 1)


def picture(history):
    """Draw the released end of the tendon, and the stress after the first release and after the second pull."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    body, graph = figure.subplots(2, 1)
    window = ((LENGTH - 1.5 * transfer_length(), LENGTH + 0.5), (-0.6, HEIGHT + 0.1))
    how = {"stress": "xx", "forces": "friction", "stretch": 4.0, "units": UNITS}
    vx.plots.stressed_body(history, step=history.steps // 3, ax=body, window=window, **how)
    x = history.mesh.centroids[:, 0]
    places, s = np.unique(x.round(9)), np.linspace(0, 36, 400)
    for third, is_again, marks, words in ((1, False, "C0o", "released"), (2, True, "C1s", "pulled again")):
        sigma = history.stress(third * history.steps // 3)[:, 0]
        mean = [sigma[np.abs(x - place) < 1e-6].mean() for place in places]
        graph.plot(s, stress(s, is_again), marks[:2] + "-", label=f"rod, {words}")
        graph.plot((LENGTH - places)[::3], mean[::3], marks, label=words)
    graph.set(xlabel="distance from the end (mm)", ylabel="mean tension (MPa)", xlim=(36, -0.7))
    graph.grid()
    graph.legend()
    return figure
