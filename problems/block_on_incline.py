r"""A block pushed up an inclined plane: Coulomb friction on one-sided contact, and the oldest formula of friction.

The block (0, 2) x (0, 1), turned by the angle a of the plane, tan a = .1, is heavy (weight G) and rests on the plane
under nothing but its weight, with the coefficient of friction mu = .3. Its lower side end is pushed horizontally, by
a displacement that grows. When uphill motion impends, the horizontal force F satisfies

$$ F / G = (\tan a + \mu) / (1 - \mu \tan a) = 0.412371, $$

whatever the shape, the material or the mesh: friction is mu times the pressure at every point, so all forces add up to
those on a point. Beyond that load there is no equilibrium, which is why the displacement is given and not the force.
Before sliding, the block creeps up from its pushed end; its lower edge may lift.

    vemcvx run problems/block_on_incline.py --steps 20 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, SLID, STUCK, body_and_graph
from vemcvx.base.canvas import light_grid

SLOPE, FRICTION, WEIGHT = 0.1, 0.3, 6.0
ANGLE = np.arctan(SLOPE)
TURN = np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]])
PUSH = 0.06
UNITS = MM
SMALL = {"n": 8, "steps": 20}


def impending():
    """F / G at which uphill motion begins."""
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
    names = {name: edges for name, edges in flat.boundaries.items() if name != "boundary"}
    turned = vx.PolygonMesh(flat.points @ TURN.T, flat.cells, boundaries=names)

    def low(x):
        x, y = (x @ TURN).T
        return (x < 1e-9) & (y > 0.1) & (y < 0.6)

    return turned.with_boundary("pushed", low)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


initial = "settled"


def picture(history):
    """The pushed block, and its push over its weight: it levels off at the oldest formula of friction."""
    figure, graph = body_and_graph(history, stress="mean", shares=(1.2, 1.0))
    push, ratio = PUSH * history.times, history.reaction("pushed")[:, 0] / WEIGHT
    slides = ~history.contact.sticking.any(axis=1)
    graph.axhline(impending(), color="black", linewidth=1.3, label="impending motion")
    for chosen, kind, words in ((~slides, STUCK, "some of it sticks"), (slides, SLID, "all of it slides")):
        graph.plot(push[chosen], ratio[chosen], **kind, markersize=4, label=words)
    light_grid(graph)
    graph.legend(frameon=False, fontsize="small")
    graph.set(xlabel="pushed by (mm)", ylabel="push / weight")
    return figure
