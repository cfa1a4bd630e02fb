r"""A round pad pressed on a floor and twisted: it slips from its edge inwards, up to the torque 2/3 mu P R.

The pad, of radius R and height H = R/4, E = 1000, is pressed by the uniform pressure p on its top, which then turns by
the angle t w about the axis. The floor is rigid, with Coulomb friction. With nu = 0 pressing does not widen the pad and
twisting does not press it, so that the pressure on the floor stays p. A thin pad bears the shear G r t w / H up to the
bound, at the radius c = mu p H / (G t w), outside of which it slips:

$$
T = \pi \mu p (4 R^3 - c^3) / 6 \qquad \text{for } c \lt R, \qquad T = \pi G t w R^4 / (2 H) \qquad \text{before},
$$

and in full slip, when c tends to 0, whatever the pad, T = 2/3 mu P R with P = p pi R^2. (All but the axis: it does not
move. At the end of these steps c < R/5, and c^3 is less than .2 % of 4 R^3.) With n = 6 the torque of full slip is
computed within .5 %.

    vemcvx run problems/twisted_pad.py --n 8 --steps 16 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, face_and_graph

YOUNG, RADIUS, HEIGHT = 1000.0, 1.0, 0.25
PRESSURE, FRICTION = 4.0, 0.5
SHEAR = YOUNG / 2
FIRST = FRICTION * PRESSURE * HEIGHT / (SHEAR * RADIUS)
"""The angle at which the edge begins to slip."""
ANGLE = 6 * FIRST
FULL = 2 / 3 * FRICTION * PRESSURE * np.pi * RADIUS**3
UNITS = MM
SMALL = {"n": 6, "steps": 12}


def thin_pad(angle):
    """The torque of a thin pad turned by these angles."""
    c = np.minimum(RADIUS, FRICTION * PRESSURE * HEIGHT / (SHEAR * np.maximum(angle, 1e-9 * FIRST)))
    slips = np.pi * FRICTION * PRESSURE * (4 * RADIUS**3 - c**3) / 6
    return np.where(c < RADIUS, slips, np.pi * SHEAR * angle * RADIUS**4 / (2 * HEIGHT))


def scene(friction=FRICTION, angle=ANGLE, poisson=0.0):
    def turned(along):
        return lambda x, t: angle * t * x[:, :2] @ along

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=poisson),
        vx.Pressure(PRESSURE, on="top"),
        vx.PrescribedDisplacement(turned((0.0, -1.0)), on="top", direction=(1.0, 0.0, 0.0)),
        vx.PrescribedDisplacement(turned((1.0, 0.0)), on="top", direction=(0.0, 1.0, 0.0)),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(friction, on="bottom"),
    )


initial = "settled"


def rings(radii, sectors, hole=False):
    """Quadrilaterals between circles, and a polygon of as many corners as there are sectors inside the first.

    The corners are a little outside of their circles, so that the polygons have the areas of the circles.
    """
    angle = 2 * np.pi * np.arange(sectors) / sectors
    widened = np.sqrt(2 * np.pi / sectors / np.sin(2 * np.pi / sectors)) * np.asarray(radii)
    points = np.concatenate([r * np.column_stack([np.cos(angle), np.sin(angle)]) for r in widened])
    here, after = np.arange(sectors), np.roll(np.arange(sectors), -1)
    inner = sectors * np.arange(len(radii) - 1)[:, None]
    between = np.stack([inner + here, inner + sectors + here, inner + sectors + after, inner + after], axis=2)
    return vx.PolygonMesh(points, [*([] if hole else [here]), *between.reshape(-1, 4)])


def mesh(n, family="rings"):
    """n rings, 6n sectors, n/2 layers."""
    flat = rings(RADIUS * np.arange(1, n + 1) / n, 6 * n)
    return flat.extruded(np.linspace(0.0, HEIGHT, 1 + n // 2))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def torque(history):
    """The torque of friction about the axis at every step, against the twist."""
    contact = history.contact
    x, force = contact.points, contact.traction * contact.friction_lengths[:, None]
    return -(force[:, :, 1] @ x[:, 0] - force[:, :, 0] @ x[:, 1])


def picture(history):
    """The sole when its edge slips, and the torque beside that of a thin pad."""
    figure, graph = face_and_graph(history, step=history.steps // 6)
    dense = np.linspace(0.0, 1.0, 401)
    marks = ANGLE / FIRST * history.times, torque(history) / FULL
    beside_closed_form(graph, marks, (ANGLE / FIRST * dense, thin_pad(ANGLE * dense) / FULL), exact_label="thin pad")
    graph.axhline(1.0, color="0.5", linestyle="--", linewidth=1.0, label="full slip, $2/3\\,\\mu P R$")
    graph.legend(frameon=False, fontsize="small", loc="lower right")
    graph.set(xlabel="angle, over that of the first slip", ylabel="torque, over that of full slip", ylim=(0, 1.1))
    return figure
