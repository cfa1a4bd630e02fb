"""An L-shaped bracket, hung up on top and pulled along a rough floor: a re-entrant corner where stress is infinite.

In the corner of 270 degrees strains grow like r^-0.455 (Williams, *Stress singularities resulting from various
boundary conditions in angular corners of plates in extension*, J. Appl. Mech. 19, 1952: the root of sin(1.5 pi a) =
-a sin(1.5 pi) between 0 and 1 is a = 0.5445), so that on equal squares the energy error falls with h^0.5445 only,
N^-0.27. The floor holds the foot back by friction, which slips from the right; adaptive meshes (`adaptive_meshes.py`)
win back N^-0.5.

    vemcvx run problems/l_shaped_bracket.py --n 32 --steps 16 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.base.canvas import plain_logarithms

UNITS = MM
SMALL = {"n": 16, "steps": 8}
EXPONENT = 0.5444837 - 1.0
"""Of the stress, from Williams' equation."""


def course(t):
    """The pull in time, as part of that at t = 1."""
    return t


def scene(pull=2.0, bound=1.2, course=course):
    def force(x, t):
        return np.tile([pull * course(t), -0.25 * pull * course(t)], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3),
        vx.Clamp(on="top"),
        vx.Traction(force, on="right"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom"),
    )


def mesh(n, family="l_shape"):
    return vx.meshes.l_shape(n)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def towards_corner(history):
    """Distances to the corner, and von Mises' stress, of the cells on the bisector, up to a fifth from it."""
    arm = history.mesh.centroids - np.array([0.5, 0.5])
    # Along the bisector of the body's angle the singular field is the same on every mesh.
    near = (np.abs(arm[:, 0] - arm[:, 1]) < 1e-9) & (arm[:, 0] > -0.15)
    distance = np.linalg.norm(arm[near], axis=1)
    order = np.argsort(distance)
    return distance[order], history.von_mises(-1)[near][order]


def picture(history):
    """Stress in the bracket, and how it grows towards the corner beside the power of the closed form."""
    figure, graph = body_and_graph(history, stress="shear", forces="friction", shares=(1.0, 1.1))
    fine = vx.adapt(scene(), vx.meshes.l_shape(4), [0.0, 1.0], 0.04)
    r, stress = towards_corner(fine.history)
    inside = np.array([r[0], 0.05])
    law = stress[2] * (inside / r[2]) ** EXPONENT
    beside_closed_form(graph, (r, stress), (inside, law), label="adaptive, 4 %", exact_label=r"$r^{-0.455}$")
    graph.set(xscale="log", yscale="log", xlabel="distance to the corner", ylabel="von Mises' stress")
    plain_logarithms(graph.yaxis)
    return figure
