r"""A tendon, tensioned, bonded and released: friction preserves its stress except along a length at the end.

Half of a tendon (x = 0 is its middle, a line of symmetry) of length L and height H, plane stress, nu = 0, has the
prestress s0, held by a jack at x = L. Then it is laid on a bed with the friction bound g per length, and the jack is
released: the pull at the end falls to 0, rises to 0.6 s0, and falls again, at t = 0, 1, 2, 3. Let s be the distance
from the end, T the pull at the end (a force) and N the force in the tendon. As a rod,

$$
N = \min(N_0, T + g s)
\qquad \text{on the first release}, \qquad N_0 = s_0 H \text{ at the transfer length } s = N_0 / g, \\
u_1 = N_0^2 / (2 E H g) \qquad \text{the draw-in of the end}.
$$

A pull Q on the end reverses friction along the length Q / 2g, where N = Q - g s, and recovers Q^2 / (4 E H g) of the
draw-in. The second release returns to u_1. Pretensioned concrete anchors its wires in this way, and the draw-in is its
test (Guyon, *Prestressed Concrete*, 1953). Prestress and jack are in equilibrium, so that u = 0 at t = 0. The rod is a
model with the error O(g H / N0).

    vemcvx run problems/pretensioned_tendon.py --n 4 --steps 24 --plot
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG, BOUND, PRESTRESS, AGAIN = 40.0, 1.0, 20000.0, 1.0, 24.0, 0.6
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 24}


def jack(t):
    """Return the pull at the end, a stress."""
    return PRESTRESS * np.interp(t, [0, 1, 2, 3], [1, 0, AGAIN, 0])


def transfer_length():
    return PRESTRESS * HEIGHT / BOUND


def draw_in():
    """Return the displacement of the end, inwards: released, pulled again, released again."""
    first = (PRESTRESS * HEIGHT) ** 2 / (2 * YOUNG * HEIGHT * BOUND)
    return first, first - (AGAIN * PRESTRESS * HEIGHT) ** 2 / (4 * YOUNG * HEIGHT * BOUND), first


def stress(s, again=False):
    """Return the stress of the rod at the distance s from its end, after the first release or the pull that follows."""
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
    """Draw the end of the tendon after its release, and the stress along it, then and when it is pulled again."""
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
