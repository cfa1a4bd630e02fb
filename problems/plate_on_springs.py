r"""A long plate on an elastic foundation, loaded at a point: Winkler's beam, and asperities in its place.

A thin strip of height H on springs k per length, with the force P on the middle of its top, is a beam on Winkler's
foundation (Hetenyi 1946): with D = E H^3 / 12 (plane stress, unit thickness) and b = (k / 4D)^(1/4), its deflection is

$$ w(x) = P b / (2 k) \exp(-b|x|) (\cos b|x| + \sin b|x|). $$

Springs pull as well as push: where w < 0 they hold the plate down. With `asperities=True` NormalCompliance of the same
stiffness takes their place, which only pushes: the ends lift off (ask for 1e-6: so soft a bed leaves no more digits).

    vemcvx run problems/plate_on_springs.py --n 4 --steps 4 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import SECOND

LENGTH, HEIGHT, YOUNG, SPRINGS, FORCE = 40.0, 0.5, 1000.0, 0.2, 0.5
RIGIDITY = YOUNG * HEIGHT**3 / 12
DECAY = (SPRINGS / (4 * RIGIDITY)) ** 0.25
UNITS = MM
SMALL = {"n": 5, "steps": 2, "accuracy": 1e-6}


def deflection(x):
    """Of the beam, downwards, where x is the distance from the force."""
    b = DECAY * np.abs(x)
    return FORCE * DECAY / (2 * SPRINGS) * np.exp(-b) * (np.cos(b) + np.sin(b))


def scene(asperities=False):
    def press(x, t):
        return np.tile([0.0, -FORCE / 2 * t], (len(x), 1))

    below = vx.NormalCompliance(SPRINGS, on="bottom") if asperities else vx.ElasticFoundation(SPRINGS, on="bottom")
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=0.0, plane="stress"),
        vx.Symmetry(on="left"),
        below,
        vx.PointLoad(press, at=(0.0, HEIGHT)),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family]((40 * n, n), box=((0, LENGTH / 2), (0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The bent plate, and its deflection beside the beam's; and on asperities, which cannot pull."""
    window = ((0.0, LENGTH / 2), (-0.9, 0.9))
    how = {"stress": "xx", "forces": "none", "magnify": 2.0, "stretch": 2.0}
    figure, graph = body_and_graph(history, window=window, shares=(0.8, 1.0), **how)
    low = history.mesh.points[:, 1] == 0
    x = np.linspace(0, LENGTH / 2, 300)
    found = history.displacement[-1][low, 1]
    order = np.argsort(history.mesh.points[low, 0])
    marks = (history.mesh.points[low, 0][order], found[order])
    beside_closed_form(graph, marks, (x, -deflection(x)), label="springs", exact_label="Winkler's beam")
    soft = vx.Newton(accuracy=SMALL["accuracy"])
    lifted = vx.simulate(scene(asperities=True), history.mesh, history.times, solver=soft).displacement[-1][low, 1]
    graph.plot(marks[0], lifted[order], "--", color=SECOND, linewidth=1.4, label="asperities: the end lifts off")
    graph.axhline(0.0, color="0.6", linewidth=0.8)
    graph.legend(frameon=False, fontsize="small")
    graph.set(xlabel="distance from the force (mm)", ylabel="lower side moved by (mm)", xlim=(0, LENGTH / 2))
    return figure
