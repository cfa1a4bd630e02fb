r"""A long plate on an elastic foundation, loaded at a point: Winkler's beam, and the same plate on asperities.

A thin strip of height H on springs of stiffness k per length, with the force P on the middle of its top, is a beam on
Winkler's foundation (Hetenyi 1946). With D = E H^3 / 12 (plane stress, unit thickness) and b = (k / 4D)^(1/4), the
downward deflection of a long beam at the distance x from the force is

$$ w(x) = P b / (2 k) \exp(-b|x|) (\cos b|x| + \sin b|x|). $$

The right half of the strip is computed. Springs pull as well as push: where w < 0 they hold the plate down. With
`asperities=True`, NormalCompliance of the same stiffness replaces the springs. Asperities only push, so the ends lift
off. Use the accuracy 1e-6 with asperities, because rounding limits the accuracy.

    vemcvx run problems/plate_on_springs.py --n 4 --steps 4 --plot
"""

import numpy as np

import vemcvx as vx

LENGTH, HEIGHT, YOUNG, SPRINGS, FORCE = 40.0, 0.5, 1000.0, 0.2, 0.5
RIGIDITY = YOUNG * HEIGHT**3 / 12
DECAY = (SPRINGS / (4 * RIGIDITY)) ** 0.25
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 5, "steps": 2, "accuracy": 1e-6}


def deflection(x):
    """Return the downward deflection w of the beam at the distance x from the force."""
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
    """Draw the bent plate, and its deflection on springs and on asperities."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    body, graph = figure.subplots(2, 1, height_ratios=(0.8, 1.0))
    how = {"stress": "xx", "forces": "none", "magnify": 2.0, "stretch": 2.0, "units": UNITS}
    vx.plots.stressed_body(history, ax=body, window=((0.0, LENGTH / 2), (-0.9, 0.9)), **how)
    points, line = history.mesh.points, np.linspace(0, LENGTH / 2, 300)
    low = np.flatnonzero(points[:, 1] == 0)
    low = low[np.argsort(points[low, 0])]
    solver = vx.Newton(accuracy=SMALL["accuracy"])
    lifted = vx.simulate(scene(asperities=True), history.mesh, history.times, solver=solver)
    graph.plot(line, -deflection(line), "k-", label="Winkler's beam")
    graph.plot(points[low[::4], 0], history.displacement[-1][low[::4], 1], "C0o", label="springs")
    graph.plot(points[low, 0], lifted.displacement[-1][low, 1], "C1--", label="asperities: the end lifts off")
    graph.axhline(0.0, color="0.6", linewidth=0.8)
    graph.set(xlabel="distance from the force (mm)", ylabel="displacement of the bottom (mm)", xlim=(0, LENGTH / 2))
    graph.grid()
    graph.legend()
    return figure
