r"""A round pad pressed on a floor and twisted: it slips from its edge inwards.

The pad has the radius R, the height H = R/4 and the shear modulus G. The uniform pressure p acts on its top. From t = 0
to 1 the top rotates about the axis by the angle t w. The floor is rigid, with the friction coefficient mu. With nu = 0,
pressing does not widen the pad and twisting does not change the pressure, so the pressure on the floor stays p. The
shear stress of a thin pad at the radius r is G r t w / H if r < c = mu p H / (G t w). At larger radii the pad slips,
and the shear stress is the bound mu p. The torque is

$$
T = \pi \mu p (4 R^3 - c^3) / 6 \qquad \text{for } c \lt R, \qquad T = \pi G t w R^4 / (2 H) \qquad \text{for } c \ge R.
$$

In full slip, when c tends to 0, every pad has T = 2/3 mu P R, with the force P = p pi R^2. In the run c stays positive,
because nothing slips on the axis. At the end c = R/6, and c^3 is .12 % of 4 R^3. With n = 6 the torque of full slip has
an error below .5 %.

    vemcvx run problems/twisted_pad.py --n 8 --steps 16 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, RADIUS, HEIGHT = 1000.0, 1.0, 0.25
PRESSURE, FRICTION = 4.0, 0.5
SHEAR = YOUNG / 2
FIRST = FRICTION * PRESSURE * HEIGHT / (SHEAR * RADIUS)
"""The angle at which the edge begins to slip."""
ANGLE = 6 * FIRST
FULL = 2 / 3 * FRICTION * PRESSURE * np.pi * RADIUS**3
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 6, "steps": 12}


def thin_pad(angle):
    """Return the torque T on a thin pad whose top rotates by `angle`."""
    c = np.minimum(RADIUS, FRICTION * PRESSURE * HEIGHT / (SHEAR * np.maximum(angle, 1e-9 * FIRST)))
    slips = np.pi * FRICTION * PRESSURE * (4 * RADIUS**3 - c**3) / 6
    return np.where(c < RADIUS, slips, np.pi * SHEAR * angle * RADIUS**4 / (2 * HEIGHT))


def scene(friction=FRICTION, angle=ANGLE, poisson=0.0):
    def rotate(along):
        return lambda x, t: angle * t * x[:, :2] @ along

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=poisson),
        vx.Pressure(PRESSURE, on="top"),
        vx.PrescribedDisplacement(rotate((0.0, -1.0)), on="top", direction=(1.0, 0.0, 0.0)),
        vx.PrescribedDisplacement(rotate((1.0, 0.0)), on="top", direction=(0.0, 1.0, 0.0)),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(friction, on="bottom"),
    )


initial = "settled"


def mesh(n, family="rings"):
    """Return n rings of 6n sectors in n/2 layers; the innermost ring is one polygonal cell."""
    sectors = 6 * n
    widening = np.sqrt(2 * np.pi / sectors / np.sin(2 * np.pi / sectors))
    ring = vx.meshes.ring(widening * RADIUS * np.arange(1, n + 1) / n, sectors)
    disc = vx.PolygonMesh(ring.points, [np.arange(sectors), *ring.cells])
    return disc.extruded(np.linspace(0.0, HEIGHT, 1 + n // 2))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def torque(history):
    """Return the torque of friction about the axis at every step, positive against the rotation."""
    contact = history.contact
    x, force = contact.points, contact.traction * contact.friction_lengths[:, None]
    return -(force[:, :, 1] @ x[:, 0] - force[:, :, 0] @ x[:, 1])


def picture(history):
    """Draw the bottom of the pad when its edge slips, and compare its torque with the torque on a thin pad."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    face, graph = figure.subplots(1, 2)
    vx.plots.contact_face(history, step=history.steps // 6, ax=face, units=UNITS)
    angle = ANGLE * np.linspace(0.0, 1.0, 401)
    graph.plot(angle / FIRST, thin_pad(angle) / FULL, "k-", label="thin pad")
    graph.plot(ANGLE / FIRST * history.times, torque(history) / FULL, "C0o", label="computed")
    graph.axhline(1.0, color="0.5", linestyle="--", linewidth=1.0, label=r"full slip, $2/3\,\mu P R$")
    graph.set(xlabel="angle / angle of the first slip", ylabel="torque / torque of full slip", ylim=(0, 1.1))
    graph.grid()
    graph.legend(loc="lower right")
    return figure
