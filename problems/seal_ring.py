r"""A soft seal ring in its groove: the contact pressure exceeds the sealed pressure.

A rubber ring of rectangular section, a < r < b, is a body of revolution: x_1 is the radius r, x_2 the axial coordinate,
and all forces are integrals over the full turn. The rod r = a and the bottom of the groove r = b - delta squeeze the
ring by delta. Then the sealed pressure q acts on the lower side, and pushes the ring over a small clearance to the
upper wall of the groove. Friction acts on all walls. Rubber is almost incompressible, nu = .4999; square cells do not
lock.

Without friction the stresses do not depend on x_2. With Lame's constants lambda and G, the radial displacement u_r, the
axial strain e_z and the contact pressure p are

$$
u_r = A (r - a^2 / r), \quad A = -\frac{\delta b}{b^2 - a^2}, \quad e_z = -\frac{q + 2 \lambda A}{\lambda + 2 G}, \qquad
p(r) = q + 2 G e_z - 2 G A (1 + a^2 / r^2).
$$

Incompressible rubber has e_z = -2 A. Then the contact pressure exceeds q by -2 G A (3 + a^2 / r^2), the squeeze
pressure, however large q is. Friction bears a part of the force of q until the ring reaches the upper wall. Then the
ring cannot move, and the contact pressure grows as fast as q: it exceeds q by at least four fifths of the squeeze
pressure. The forces of q, of the wall and of friction balance up to rounding.

`wall_pressure` leaves out the nodes at the upper corners, on which two walls act.

    vemcvx run problems/seal_ring.py --n 8 --steps 8 --plot
"""

import numpy as np

import vemcvx as vx

RADII, HEIGHT, YOUNG, POISSON = (20.0, 25.0), 4.0, 5.0, 0.4999
SQUEEZE, CLEARANCE, FRICTION, SEALED = 0.1, 0.05, 0.1, 0.5
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 8}
initial = "settled"


def pressure(r, sealed):
    """Return the contact pressure p at the radius r without friction, under the sealed pressure `sealed`."""
    a, b = RADII
    shear, lame = YOUNG / (2 * (1 + POISSON)), YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    slope = -SQUEEZE * b / (b**2 - a**2)
    axial = -(sealed + 2 * lame * slope) / (lame + 2 * shear)
    return sealed + 2 * shear * axial - 2 * shear * slope * (1 + a**2 / r**2)


def scene(friction=FRICTION):
    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON, plane="axisymmetric"),
        vx.UnilateralContact(on="left"),
        vx.UnilateralContact(on="right", gap=-SQUEEZE),
        vx.UnilateralContact(on="top", gap=CLEARANCE),
        vx.CoulombFriction(friction, on=["left", "right", "top"]),
        vx.Pressure(lambda x, t: np.full(len(x), SEALED * t), on="bottom"),
    )


def mesh(n, family="squares"):
    """Return the section of the ring, with n cells along its height."""
    return vx.meshes.FAMILIES[family]((5 * n // 4, n), box=(RADII, (0.0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def wall_pressure(history, wall, step=-1):
    """Return axial coordinates and pressures on the rod (wall 0) or on the bottom of the groove (wall 1)."""
    contact = history.contact
    r, z = contact.points.T
    nodes = np.flatnonzero((np.abs(r - RADII[wall]) < 1e-9) & (z < HEIGHT - 1e-9))
    nodes = nodes[np.argsort(contact.points[nodes, 1])]
    return contact.points[nodes, 1], contact.pressure[step, nodes]


def picture(history):
    """Draw the ring, and the contact pressure minus q along both walls, beside the closed form without friction."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    vx.plots.stressed_body(history, history.steps, ax=body, stress="yy", units=UNITS)
    for wall, name in enumerate(("rod", "groove")):
        for step, marker in ((0, "o"), (history.steps, "s")):
            z, p = wall_pressure(history, wall, step)
            sealed = SEALED * history.times[step]
            graph.plot(p - sealed, z, f"C{wall}{marker}", label=f"{name}, q = {sealed:.3g} MPa")
        graph.axvline(pressure(RADII[wall], sealed) - sealed, color=f"C{wall}", label=f"{name}, no friction")
    graph.set(xlabel="contact pressure minus sealed pressure q (MPa)", ylabel="$z$ (mm)", xlim=(0, 0.18))
    graph.grid()
    graph.legend(loc="lower left")
    return figure
