r"""A silo carries its filling by friction on the walls: the floor feels no more than the lowest part of it.

Half of a plane silo of half-width B and height H: x = 0 is the middle, x = B a rigid rough wall, coefficient mu, y =
0 a smooth floor. The filling is elastic, plane strain, and its weight w per area grows from zero. Held between walls,
it presses on them with K times its vertical stress s, K = nu / (1 - nu); it settles everywhere, so friction hangs up
mu K s on all the wall, and the slice of height dz at the depth z below the top bears (Janssen, Z. VDI 39, 1895)

$$ B ds / dz = w B - \mu K s, \qquad s = w l (1 - \exp(-z / l)), \qquad l = B / (\mu K), $$

instead of w z, and presses on the wall with K s. The walls bear w B H - B s(H). A slice that stays plane is a model:
friction shears it, an error O((B / l)^2) in the stresses, and the floor, which lets nothing slip past, holds the wall
up within about B of it.

    vemcvx run problems/janssen_silo.py --n 4 --steps 4 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import SECOND

WIDTH, HEIGHT, YOUNG, POISSON, FRICTION, WEIGHT = 1.0, 16.0, 1000.0, 0.3, 0.4, 1.0
RATIO = POISSON / (1 - POISSON)
UNITS = MM
SMALL = {"n": 6, "steps": 4}


def depth_of_decay(friction=FRICTION):
    """l; without friction there is none."""
    return WIDTH / (friction * RATIO)


def vertical_stress(z, friction=FRICTION):
    """Mean compression of the slice at the depth z."""
    length = depth_of_decay(friction)
    return WEIGHT * length * (1 - np.exp(-z / length))


def scene(friction=FRICTION):
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.BodyForce(lambda x, t: np.tile([0.0, -WEIGHT * t], (len(x), 1))),
        vx.Symmetry(on="left"),
        vx.Symmetry(on="bottom"),
        vx.UnilateralContact(on="right"),
        vx.CoulombFriction(friction, on="right"),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0, WIDTH), (0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The filling between its middle and the wall, and its vertical stress over the depth."""
    figure, graph = body_and_graph(history, stress="yy", stretch=0.35, mirrors=[(-1, 1)], shares=(0.9, 1.0))
    mesh, contact = history.mesh, history.contact
    depth, sigma = HEIGHT - mesh.centroids[:, 1], -history.stress(-1)[:, 1]
    levels = np.unique(depth.round(9))
    mean = np.array([sigma[np.abs(depth - level) < 1e-6].mean() for level in levels])
    z = np.linspace(0, HEIGHT, 200)
    exact, wall = vertical_stress(z), contact.points[:, 1] < HEIGHT
    words = "vertical stress, mean of a slice"
    beside_closed_form(graph, (mean, levels), (exact, z), label=words, exact_label="Janssen 1895")
    marks = (contact.pressure[-1][wall], HEIGHT - contact.points[wall, 1])
    beside_closed_form(graph, marks, (RATIO * exact, z), colour=SECOND, label="pressure on the wall", exact_label=None)
    graph.plot(WEIGHT * z[z < 8], z[z < 8], "--", color="0.5", linewidth=1.2, label="a liquid")
    graph.set(xlabel="stress (MPa)", ylabel="depth (mm)", ylim=(HEIGHT, 0), xlim=(0, 11.5))
    graph.legend(frameon=False, fontsize="small", loc="lower right")
    return figure
