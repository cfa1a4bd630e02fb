r"""A tendon, tensioned, bonded and released: friction keeps its stress, but for a length at the end.

Half of a tendon (x = 0 is its middle, a line of symmetry) of length L and height H, plane stress, nu = 0, bears the
prestress s0, held by a jack at x = L; then it is laid on a bed with the friction bound g per length, and the jack
lets go: the pull at the end falls to 0, rises to 0.6 s0, and falls again, at t = 0, 1, 2, 3. As a rod, with s the
distance from the end and T the pull at it (force), the force N in it is

$$
N = \min(N_0, T + g s)
\qquad \text{on the first release}, N_0 = s_0 H: \text{ all of it is back at the transfer length } N_0 / g, \\
u_1 = N_0^2 / (2 E H g) \qquad \text{the draw-in of the end}.
$$

A pull Q on the end turns friction around on the length Q / 2g, N = Q - g s there, and takes Q^2 / (4 E H g) back; the
second release returns to u_1. That is how pretensioned concrete anchors its wires, with the draw-in as its test
(Guyon, *Prestressed Concrete*, 1953). Prestress and jack are in equilibrium, so u = 0 at t = 0. A rod is a model:
error O(g H / N0).

    vemcvx run problems/pretensioned_tendon.py --n 4 --steps 24 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import COMPUTED, SECOND

LENGTH, HEIGHT, YOUNG, BOUND, PRESTRESS, AGAIN = 40.0, 1.0, 20000.0, 1.0, 24.0, 0.6
UNITS = MM
SMALL = {"n": 4, "steps": 24}


def jack(t):
    """The pull at the end, stress."""
    return PRESTRESS * np.interp(t, [0, 1, 2, 3], [1, 0, AGAIN, 0])


def transfer_length():
    return PRESTRESS * HEIGHT / BOUND


def draw_in():
    """Of the end, inwards: released, pulled again, released again."""
    first = (PRESTRESS * HEIGHT) ** 2 / (2 * YOUNG * HEIGHT * BOUND)
    return first, first - (AGAIN * PRESTRESS * HEIGHT) ** 2 / (4 * YOUNG * HEIGHT * BOUND), first


def stress(s, again=False):
    """Of the rod at the distance s from its end, after the first release or the pull that follows."""
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
    """The end of the tendon after its release, and the stress along it, then and when it is pulled again."""
    window = ((LENGTH - 1.5 * transfer_length(), LENGTH + 0.5), (-0.6, HEIGHT + 0.1))
    figure, graph = body_and_graph(
        history, step=history.steps // 3, stress="xx", forces="friction", window=window, stretch=4.0
    )
    x = history.mesh.centroids[:, 0]
    places = np.unique(x.round(9))
    s = np.linspace(0, 36, 400)
    for third, again, colour, words in ((1, False, COMPUTED, "released"), (2, True, SECOND, "pulled again")):
        sigma = history.stress(third * history.steps // 3)[:, 0]
        mean = np.array([sigma[np.abs(x - place) < 1e-6].mean() for place in places])
        marks, line = (LENGTH - places, mean), (s, stress(s, again))
        beside_closed_form(graph, marks, line, colour=colour, label=words, exact_label=None if again else "rod")
    graph.set(xlabel="distance from the end (mm)", ylabel="mean tension (MPa)", xlim=(36, -0.7))
    return figure
