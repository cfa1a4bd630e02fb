r"""A silo: friction on the wall bears a part of the weight, and the pressure on the floor stays bounded.

Half of a plane silo of half-width B and height H is computed: x = 0 is the middle, x = B is a rigid rough wall with the
friction coefficient mu, and y = 0 is a smooth floor. The filling is elastic, in plane strain, and its weight w per area
grows from zero. Let s be the vertical stress in compression. Between rigid walls the horizontal stress is K s, with
K = nu / (1 - nu). Janssen (Z. VDI 39, 1895) assumed that the filling settles everywhere, so that friction is at its
bound mu K s along the whole wall. The equilibrium of a slice of height dz at the depth z below the top then gives

$$ B ds / dz = w B - \mu K s, \qquad s = w l (1 - \exp(-z / l)), \qquad l = B / (\mu K), $$

in place of s = w z without friction. The pressure on the wall is K s, and the wall at x = B carries w B H - B s(H). The
formula assumes that slices stay plane. Friction shears the slices, so the stresses of the formula have an error
O((B / l)^2). Within about B of the floor the filling cannot settle, and friction on the wall is below its bound.

    vemcvx run problems/janssen_silo.py --n 4 --steps 4 --plot
"""

import numpy as np

import vemcvx as vx

WIDTH, HEIGHT, YOUNG, POISSON, FRICTION, WEIGHT = 1.0, 16.0, 1000.0, 0.3, 0.4, 1.0
RATIO = POISSON / (1 - POISSON)
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 6, "steps": 4}


def decay_length(friction=FRICTION):
    """Return l, the depth over which the stress saturates; `friction` is positive."""
    return WIDTH / (friction * RATIO)


def vertical_stress(z, friction=FRICTION):
    """Return the mean compressive stress of the slice at the depth z."""
    length = decay_length(friction)
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
    """Draw the filling between its walls, and its vertical stress and the pressure on the wall against the depth."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(0.9, 1.0))
    vx.plots.stressed_body(history, ax=body, stress="yy", stretch=0.35, mirrors=[(-1, 1)], units=UNITS)
    depth, sigma = HEIGHT - history.mesh.centroids[:, 1], -history.stress(-1)[:, 1]
    levels = np.unique(depth.round(9))[::2]
    mean = [sigma[np.abs(depth - level) < 1e-6].mean() for level in levels]
    contact = history.contact
    wall = np.flatnonzero(contact.points[:, 1] < HEIGHT)[::2]
    z = np.linspace(0, HEIGHT, 200)
    graph.plot(vertical_stress(z), z, "k-", label="Janssen 1895")
    graph.plot(mean, levels, "C0o", label="vertical stress, mean of a slice")
    graph.plot(RATIO * vertical_stress(z), z, "k-")
    graph.plot(contact.pressure[-1][wall], HEIGHT - contact.points[wall, 1], "C1s", label="pressure on the wall")
    graph.plot([0, 8 * WEIGHT], [0, 8], "--", color="0.5", label="a liquid")
    graph.set(xlabel="stress (MPa)", ylabel="depth (mm)", ylim=(HEIGHT, 0), xlim=(0, 11.5))
    graph.grid()
    graph.legend(loc="lower right")
    return figure
