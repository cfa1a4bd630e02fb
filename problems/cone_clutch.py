r"""A plug in a conical socket, pressed from all sides and twisted: the torque at which the joint slips.

The joint is the part of a cone between the radii R_1 and R_2; the side of the cone leans by the angle alpha from the
axis. Both bodies have Young's modulus E and Poisson's ratio nu. Up to t = 1, a pressure rises to p on all sides, so
that the stress is -p I in both bodies. On the rim of the socket and the top of the plug, a prescribed displacement
replaces the pressure: -(p (1 - 2 nu) / E) x. Then the top of the plug is rotated by the angle theta (t - 1) about the
axis while the rim stays. The rotation of round bodies does not change the pressure, and nodes slip in circles. With the
coefficient of friction mu, the torque of full slip is

$$ T = \mu p \int r dA = \tfrac23 \pi \mu p (R_2^3 - R_1^3) / \sin \alpha . $$

A cone clutch under uniform pressure has this torque (Shigley, *Mechanical Engineering Design*, 16-9). Both bodies have
4n sectors, so that their polygons coincide at the joint; their layers do not match. The pressure at all nodes is p with
a relative error below (pi / (4n))^2. With n = 8 the torque is .64 % below T, because polygons replace the circles.

    vemcvx run problems/cone_clutch.py --n 8 --steps 10 --accuracy 1e-6 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, PRESSURE, FRICTION = 1000.0, 0.3, 4.0, 0.3
SMALLER, LARGER, HEIGHT, RIM = 0.6, 1.0, 1.0, 1.6
SLOPE = (LARGER - SMALLER) / HEIGHT
"""The slope tan alpha of the cone."""
TORQUE = 2 / 3 * np.pi * FRICTION * PRESSURE * (LARGER**3 - SMALLER**3) / np.sin(np.arctan(SLOPE))
ANGLE = 0.01
JOINT = "plug|socket"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 10, "accuracy": 1e-6}


def uniform_compression(x):
    """Return the displacement of a body under the pressure p on all sides, at points x (m, 3)."""
    return -PRESSURE * (1 - 2 * POISSON) / YOUNG * x


def scene(friction=FRICTION, angle=ANGLE):
    def compress(x, t):
        return min(t, 1.0) * uniform_compression(x)

    def turn_top(x, t):
        return compress(x, t) + angle * max(t - 1.0, 0.0) * np.column_stack([-x[:, 1], x[:, 0], 0.0 * x[:, 0]])

    def press(x, t):
        return np.full(len(x), PRESSURE * min(t, 1.0))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(compress, on="socket.outer"),
        vx.PrescribedDisplacement(turn_top, on="plug.top"),
        vx.Pressure(press, on=["plug.bottom", "socket.bottom", "socket.top"]),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


def lean_layers(flat, levels, inside):
    """Extrude the plane mesh `flat`, and scale its layers: inside the cone if `inside`, else between cone and rim."""
    solid = flat.extruded(levels)

    r, cone = np.hypot(*solid.points[:, :2].T), SMALLER + SLOPE * solid.points[:, 2]
    new = r * cone if inside else cone + (r - 1.0) / (RIM - 1.0) * (RIM - cone)
    points = solid.points.copy()
    points[:, :2] *= np.divide(new, r, out=np.ones_like(r), where=r > 0)[:, None]
    return vx.PolyhedralMesh(points, solid.cells, boundaries=solid.boundaries)


def mesh(n, family="ring"):
    """Return the plug with n/2 layers and the socket with 3n/4 layers; both have n/2 rings of cells."""
    sectors, layers = 4 * n, max(2, n // 2)
    plug = vx.meshes.ring(np.linspace(0.0, 1.0, 1 + n // 2), sectors)
    socket = vx.meshes.ring(np.linspace(1.0, RIM, 1 + n // 2), sectors)
    parts = {
        "plug": lean_layers(plug, np.linspace(0.0, HEIGHT, layers + 1), True),
        "socket": lean_layers(socket, np.linspace(0.0, HEIGHT, 3 * layers // 2 + 1), False),
    }
    return vx.meshes.bodies(parts)


def times(steps):
    """Return the instants: in the first step the bodies are pressed, in later steps the plug is rotated."""
    return np.append(0.0, np.linspace(1.0, 2.0, steps))


def torque(history):
    """Return the torque of friction about the axis at every step; it is positive against the rotation."""
    contact = history.contact
    x, force = contact.points, contact.traction * contact.friction_lengths[:, None]
    return -(force[:, :, 1] @ x[:, 0] - force[:, :, 0] @ x[:, 1])


def picture(history):
    """Draw the bodies in full slip, and the torque against the angle."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 3.4), layout="constrained")
    body, graph = figure.subplots(1, 2)
    vx.plots.deformed_body(history, ax=body, units=UNITS)
    angle = ANGLE * np.maximum(history.times - 1.0, 0.0)
    graph.plot(angle, torque(history), "C0o-", linewidth=1.0, label="computed")
    graph.axhline(TORQUE, color="0.5", linestyle="--", label="full slip of a cone clutch")
    graph.set(xlabel="angle (rad)", ylabel="torque (N mm)", ylim=(0, None))
    graph.grid()
    graph.legend(loc="lower right")
    return figure
