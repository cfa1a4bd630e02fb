r"""A bolted flange on a shaking base: a joint that slips sideways hardly resists a torque.

A steel ring of radii 30 and 60 mm, 12 mm high, is pressed on a rigid base by four bolts. The shanks of the bolts act
like springs spread over the top: they resist sideways motion and rotation. A torque M acts on the ring from the start.
The torque is three quarters of the largest torque that friction can transmit, so the ring sticks before the base moves.
Then the base shakes along x_1, one cycle per unit of time. The whole bottom of the ring slips. The friction of a
slipping ring opposes the shaking, so that little friction resists the torque. In every cycle the ring rotates further,
until the springs alone transmit the torque:

$$ \text{angle} = M / (k J), \qquad J = \int r^2 \text{ over the top}, k \text{ the springs' stiffness per area}. $$

(Junker, SAE 690055, 1969, found that joints unscrew under transverse slip, not under axial loads.) At each instant the
torques of load, springs and friction balance up to rounding.

    vemcvx run problems/bolted_flange.py --n 2 --steps 64 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, FRICTION = 210e9, 0.3, 0.2
INNER, OUTER, HEIGHT, BOLTS = 0.03, 0.06, 0.012, 4
PRESSURE, SPRINGS, SHAKING = 20e6, 4e10, 6e-5
FORCE = PRESSURE / 2 * np.pi * (OUTER**2 - INNER**2)
"""Total force of the bolts; PRESSURE is the largest pressure under a bolt."""
FRICTION_TORQUE = 2 / 3 * FRICTION * FORCE * (OUTER**3 - INNER**3) / (OUTER**2 - INNER**2)
"""The largest torque that friction can transmit."""
SECOND_MOMENT = np.pi * (OUTER**4 - INNER**4) / 2
STEPS = 8
"""Number of steps in a cycle."""
SMALL = {"n": 2, "steps": 3 * STEPS}
UNITS = {"length": "m", "force": "N", "time": "cycles", "force per area": "Pa"}


def bolt_pressure(x, t):
    """Return the pressure under the bolts."""
    return PRESSURE * np.cos(BOLTS / 2 * np.arctan2(x[:, 1], x[:, 0])) ** 2


def scene(friction=FRICTION, fraction=0.75, shaking=SHAKING):
    def twist(x, t):
        return fraction * FRICTION_TORQUE / SECOND_MOMENT * np.column_stack([-x[:, 1], x[:, 0], np.zeros(len(x))])

    def shake(x, t):
        u = shaking * np.interp(t % 1.0, [0, 0.25, 0.75, 1], [0, 1, -1, 0])
        return np.tile([u, 0.0, 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.Pressure(bolt_pressure, on="top"),
        vx.Traction(twist, on="top"),
        vx.ElasticFoundation(normal=SPRINGS, tangential=SPRINGS, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(friction, on="bottom", ground=shake),
    )


initial = "settled"


def mesh(n, family="ring"):
    """Return n rings of 16n sectors in n layers; each polygon has the same area as its circle."""
    sectors = 16 * n
    widening = np.sqrt(2 * np.pi / sectors / np.sin(2 * np.pi / sectors))
    flat = vx.meshes.ring(widening * np.linspace(INNER, OUTER, n + 1), sectors)
    return flat.extruded(np.linspace(0.0, HEIGHT, n + 1))


def times(steps):
    return np.arange(steps + 1) / STEPS


def angle(history):
    """Return the angle by which the top has rotated, at every step."""
    mesh = history.mesh
    top = mesh.points[:, 2] > 0.99 * HEIGHT
    x, u = mesh.points[top], history.displacement[:, top]
    return ((x[:, 0] * u[:, :, 1] - x[:, 1] * u[:, :, 0]) / (x[:, :2] ** 2).sum(axis=1)).mean(axis=1)


def picture(history):
    """Draw the bottom of the ring while it slips, and the angle of the ring against time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    face, graph = figure.subplots(1, 2)
    vx.plots.contact_face(history, step=history.steps - 2, ax=face, units=UNITS)
    final = 0.75 * FRICTION_TORQUE / (SPRINGS * SECOND_MOMENT)
    graph.plot(history.times, angle(history) / final, "C0o-", linewidth=1.0, label="rotation of the ring")
    graph.axhline(1.0, color="0.5", linestyle="--", label="torque on the springs alone")
    graph.set(xlabel="cycles", ylabel="angle over $M/(kJ)$", ylim=(0, 1.1))
    graph.grid()
    graph.legend(loc="lower right")
    return figure
