r"""A plug in a conical socket, pressed from all sides and twisted: the torque at which the joint slips.

The joint is the part R_1 < r < R_2 of a cone whose side leans by alpha from the axis; both bodies are of one material.
Up to t = 1 all sides are pressed by p: the rim of the socket and the top of the plug are moved by -p (1 - 2 nu) / E x,
all else bears p, and both bodies are in the stress -p, and the joint, too, whatever its shape. Then the top of the plug
is turned by the angle theta (t - 1) about the axis while the rim stays. Turning round bodies does not press them,
places slip in circles, and full slip has the torque

$$ T = \mu p \int r dA = \tfrac23 \pi \mu p (R_2^3 - R_1^3) / \sin \alpha, $$

of a cone clutch under uniform pressure (Shigley, *Mechanical Engineering Design*, 16-9, with the axial force
p pi (R_2^2 - R_1^2)). Both have 4n sectors, for the nodes of one on the chords of the other would wedge the joint as it
turns; their layers do not match. The pressure of all nodes is p within (pi / 4n)^2, and the torque with n = 8 .64 %
below that of the cone, as polygons in the place of circles are.

    vemcvx run problems/cone_clutch.py --n 8 --steps 10 --accuracy 1e-6 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots import deformed_body
from vemcvx.plots.style import COMPUTED

YOUNG, POISSON, PRESSURE, FRICTION = 1000.0, 0.3, 4.0, 0.3
SMALLER, LARGER, HEIGHT, RIM = 0.6, 1.0, 1.0, 1.6
SLOPE = (LARGER - SMALLER) / HEIGHT
"""tan alpha"""
TORQUE = 2 / 3 * np.pi * FRICTION * PRESSURE * (LARGER**3 - SMALLER**3) / np.sin(np.arctan(SLOPE))
ANGLE = 0.01
JOINT = "plug|socket"
UNITS = MM
SMALL = {"n": 8, "steps": 10, "accuracy": 1e-6}


def pressed(x):
    """The displacement of a body in the stress -p."""
    return -PRESSURE * (1 - 2 * POISSON) / YOUNG * x


def scene(friction=FRICTION, angle=ANGLE):
    def still(x, t):
        return min(t, 1.0) * pressed(x)

    def turned(x, t):
        return still(x, t) + angle * max(t - 1.0, 0.0) * np.column_stack([-x[:, 1], x[:, 0], 0.0 * x[:, 0]])

    def around(x, t):
        return np.full(len(x), PRESSURE * min(t, 1.0))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(still, on="socket.outer"),
        vx.PrescribedDisplacement(turned, on="plug.top"),
        vx.Pressure(around, on=["plug.bottom", "socket.bottom", "socket.top"]),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


def conical(flat, levels, inside):
    """Prisms over a ring, those up to the joint (`inside`) or from the joint to the rim leaning as the joint does."""
    solid = flat.extruded(levels)
    named = {name: faces for name, faces in solid.boundaries.items() if name != "boundary"}
    r, cone = np.hypot(*solid.points[:, :2].T), SMALLER + SLOPE * solid.points[:, 2]
    new = r * cone if inside else cone + (r - 1.0) / (RIM - 1.0) * (RIM - cone)
    points = solid.points.copy()
    points[:, :2] *= np.divide(new, r, out=np.ones_like(r), where=r > 0)[:, None]
    return vx.PolyhedralMesh(points, solid.cells, boundaries=named)


def mesh(n, family="ring"):
    """The plug in rings that grow with the cone and n/2 layers, the socket in rings from there to the rim and 3n/4."""
    sectors, layers = 4 * n, max(2, n // 2)
    plug = vx.meshes.ring(np.linspace(0.0, 1.0, 1 + n // 2), sectors)
    socket = vx.meshes.ring(np.linspace(1.0, RIM, 1 + n // 2), sectors)
    parts = {
        "plug": conical(plug, np.linspace(0.0, HEIGHT, layers + 1), True),
        "socket": conical(socket, np.linspace(0.0, HEIGHT, 3 * layers // 2 + 1), False),
    }
    return vx.meshes.bodies(parts)


def times(steps):
    """One step presses, the others turn."""
    return np.append(0.0, np.linspace(1.0, 2.0, steps))


def torque(history):
    """The torque of friction about the axis at every step, against the twist."""
    contact = history.contact
    x, force = contact.points, contact.traction * contact.friction_lengths[:, None]
    return -(force[:, :, 1] @ x[:, 0] - force[:, :, 0] @ x[:, 1])


def picture(history):
    """The bodies in full slip, and the torque over the angle."""
    figure = new_figure(8.4, 3.4)
    body, graph = figure.subplots(1, 2)
    deformed_body(history, ax=body, units=UNITS)
    marks = ANGLE * np.maximum(history.times - 1.0, 0.0), torque(history)
    graph.plot(*marks, "o-", color=COMPUTED, markersize=4, linewidth=1.0, label="computed")
    graph.axhline(TORQUE, color="0.5", linestyle="--", linewidth=1.2, label="full slip of a cone clutch")
    light_grid(graph)
    graph.legend(frameon=False, fontsize="small", loc="lower right")
    graph.set(xlabel="angle (rad)", ylabel="torque (N mm)", ylim=(0, None))
    return figure
