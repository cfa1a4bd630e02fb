r"""A pin with clearance in a lug, in space: the load turns once around the axis, and friction dissipates energy.

The lug is a ring a < r < b, clamped at its rim. The gap between pin and lug is delta times a. One half of the thickness
is computed. A shear stress q acts on the end of the pin. For t < 1 the stress rises in the direction x_1. Then the
direction of the stress, at the angle phi to x_1, turns once about the axis. At each instant, up to rounding,

$$ \text{sum of contact and friction forces on the pin } = -q A (\cos \phi, \sin \phi), $$

with the area A of the end of the pin. The mesh has 8n equal sectors. If the initial direction of the load is rotated by
a multiple of the angle of a sector, the solution is rotated by the same angle. While the load turns, the pin creeps a
little in the lug.

    vemcvx run problems/lug_and_pin.py --n 4 --steps 24 --accuracy 1e-6 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, FRICTION = (200.0, 70.0), (0.3, 0.33), 0.2
HOLE, RIM, THICK, CLEARANCE = 1.0, 2.0, 0.6, 0.002  # a, b, half of the thickness, delta
SHEAR = 0.12
"""The largest shear stress q on the end of the pin."""
JOINT = "pin|lug"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 24, "accuracy": 1e-6}


def direction(t):
    """Return the direction of the load, in radians from x_1."""
    return 2 * np.pi * np.clip(np.asarray(t) - 1.0, 0.0, 1.0)


def load(t):
    """Return the shear stress (..., 3) on the end of the pin."""
    size, angle = SHEAR * np.minimum(np.asarray(t), 1.0), direction(t)
    return size[..., None] * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)


def scene(friction=FRICTION, turn=0.0):
    """Return the scene of a load that begins at the angle `turn`."""
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON[0], on="pin"),
        vx.Elasticity(YOUNG[1], POISSON[1], on="lug"),
        vx.Symmetry(on=["pin.bottom", "lug.bottom"]),
        vx.Clamp(on="lug.outer"),
        vx.Traction(lambda x, t: rotation @ load(t), on="pin.top"),
        vx.UnilateralContact(on=JOINT, gap=CLEARANCE * HOLE),
        vx.CoulombFriction(friction, on=JOINT),
    )


def mesh(n, family="ring", layers=None):
    """Return pin and lug of 8n sectors each. The pin has n/2 layers and the lug 3n/4, or both have `layers`."""
    low = layers or max(1, n // 2)
    pin = vx.meshes.ring(np.linspace(0.0, HOLE, 1 + n), 8 * n).extruded(np.linspace(0.0, THICK, low + 1))
    rings = vx.meshes.ring(np.geomspace(HOLE, RIM, 1 + n), 8 * n)
    lug = rings.extruded(np.linspace(0.0, THICK, (layers or max(1, 3 * n // 4)) + 1))
    return vx.meshes.bodies({"pin": pin, "lug": lug})


def times(steps):
    """Return instants: a quarter of the steps raise the load, the others turn the load."""
    rise = max(1, steps // 4)
    return np.append(np.linspace(0.0, 1.0, rise + 1), np.linspace(1.0, 2.0, steps - rise + 1)[1:])


def joint_force(history):
    """Return the force of the joint on the pin at the stored instants, (S, 3)."""
    contact = history.contact
    friction = np.einsum("smd,m->sd", contact.traction, contact.friction_lengths)
    return friction - np.einsum("sm,m,md->sd", contact.pressure, contact.lengths, contact.normals)


def picture(history):
    """Draw pin and lug at the end, and the pressure around the pin in the plane of symmetry as the load turns."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.1), layout="constrained")
    body, graph = figure.subplots(1, 2)
    vx.plots.deformed_body(history, ax=body, view=(-0.4, -1.0, 1.6), units=UNITS)
    contact, rise = history.contact, int(np.searchsorted(history.times, 1.0))
    middle = np.flatnonzero(np.abs(contact.points[:, 2]) < 1e-9 * THICK)
    angle = np.degrees(np.arctan2(contact.points[middle, 1], contact.points[middle, 0])) % 360.0
    order = np.argsort(angle)
    for step, style in ((rise, "C0o-"), (rise + (history.steps - rise) // 4, "C1s-")):
        words = f"load at {np.degrees(direction(history.times[step])):.0f} degrees"
        graph.plot(angle[order], contact.pressure[step, middle[order]], style, linewidth=1.0, label=words)
    graph.set(xlabel="angle around the pin from $x_1$ (degrees)", ylabel="pressure (MPa)")
    graph.set(ylim=(0, 1.4 * contact.pressure.max()), xticks=range(0, 361, 90))
    graph.grid()
    graph.legend(loc="upper center")
    return figure
