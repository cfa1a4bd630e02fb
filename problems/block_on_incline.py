r"""A block pushed up an inclined plane: Coulomb friction in unilateral contact.

The plane rises at the angle a, where tan a = .1. The block (0, 2) x (0, 1), rotated by a, rests on the plane under its
weight G, with the coefficient of friction mu = .3. A growing displacement pushes the lower part of the left side
horizontally. When the block begins to slide uphill, the horizontal force F satisfies

$$ F / G = (\tan a + \mu) / (1 - \mu \tan a) = 0.412371. $$

This formula holds for every shape, material and mesh. When every point slips, friction is mu times the pressure at
every point. Therefore the forces balance as on a rigid point mass. No equilibrium exists for a larger force F, so we
prescribe the displacement. Before the whole block slides, slip spreads from the ends of its base.

    vemcvx run problems/block_on_incline.py --steps 20 --plot
"""

import numpy as np

import vemcvx as vx

SLOPE, FRICTION, WEIGHT = 0.1, 0.3, 6.0
ANGLE = np.arctan(SLOPE)
ROTATION = np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]])
PUSH = 0.06
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 20}


def critical_ratio():
    """Return F / G at which uphill motion begins."""
    return (SLOPE + FRICTION) / (1 - FRICTION * SLOPE)


def scene(young=200.0, poisson=0.3, friction=FRICTION):
    def push(x, t):
        return np.full(len(x), PUSH * t)

    return vx.Scene(
        vx.Elasticity(young=young, poisson=poisson),
        vx.BodyForce((0.0, -WEIGHT / 2.0)),
        vx.PrescribedDisplacement(push, on="pushed", direction=(1.0, 0.0)),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(friction, on="bottom"),
    )


def mesh(n, family="voronoi"):
    flat = vx.meshes.FAMILIES[family](n, box=((0, 2), (0, 1)))
    block = vx.PolygonMesh(flat.points @ ROTATION.T, flat.cells, boundaries=flat.boundaries)

    def select_low(x):
        x, y = (x @ ROTATION).T
        return (x < 1e-9) & (y > 0.1) & (y < 0.6)

    return block.with_boundary("pushed", select_low)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


initial = "settled"


def picture(history):
    """Draw the pushed block, and the ratio push / weight."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    vx.plots.stressed_body(history, ax=body, stress="mean", units=UNITS)
    push, ratio = PUSH * history.times, history.reaction("pushed")[:, 0] / WEIGHT
    slides = ~history.contact.sticking.any(axis=1)
    graph.axhline(critical_ratio(), color="black", label="impending motion")
    graph.plot(push[~slides], ratio[~slides], "C0o", label="some nodes stick")
    graph.plot(push[slides], ratio[slides], "C1s", fillstyle="none", label="all nodes slip")
    graph.set(xlabel="displacement of the pushed side (mm)", ylabel="push / weight")
    graph.grid()
    graph.legend()
    return figure
