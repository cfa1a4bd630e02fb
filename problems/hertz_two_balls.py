r"""Two elastic balls pressed together: Hertz' point contact with both bodies meshed in space.

The balls have radii R_1, R_2 and materials E_i, nu_i. In Hertz' model, the surfaces near the contact are one flat
interface between two elastic half-spaces, with the gap (x_1^2 + x_2^2) / 2R, where 1/R = 1/R_1 + 1/R_2. Under the force
P the contact has the radius a, and the pressure is p(r) at the distance r from the middle of the contact:

$$
1 / E^* = (1 - \nu_1^2) / E_1 + (1 - \nu_2^2) / E_2, \qquad a^3 = 3 P R / (4 E^*),
\qquad p(r) = p_0 \sqrt{1-r^2/a^2}, \\
p_0 = 3 P / (2 \pi a^2)
$$

(Johnson, *Contact Mechanics*, 4.2). A block that extends to 10 a replaces each half-space; a quarter of the block is
computed. Cells have equal widths up to 1.25 a, and then grow outwards. The top is pressed down, there is no friction,
and P is the sum of the computed contact forces. The radius a is computed from the mean of r^2, weighted by the contact
forces: this mean is 2/5 a^2 in Hertz' model. For the peak pressure, a half-ellipsoid of Hertz' radius is fitted to all
nodal pressures (least squares). With n = 8 the radius, the peak and the largest nodal pressure agree with Hertz within
2 %. If the upper body has cells 4/3 times as wide (`upper=6`), the meshes do not match: nodal pressures oscillate by
O(h), and the largest nodal pressure is 8 % too high. Radius and peak then agree with Hertz within 3.1 %. With n = 12
and `upper=9` they agree within 2 %.

    vemcvx run problems/hertz_two_balls.py --n 8 --steps 2 --accuracy 1e-6 --plot
"""

import numpy as np

import vemcvx as vx

RADII, YOUNG, POISSON = (3.0, 1.5), (1000.0, 400.0), (0.3, 0.4)
RADIUS = 1 / sum(1 / radius for radius in RADII)
EFFECTIVE = 1 / sum((1 - poisson**2) / young for young, poisson in zip(YOUNG, POISSON, strict=True))
CONTACT = 0.05
"""Approximate radius a of the contact."""
REACH, EVEN, GROWTH = 10 * CONTACT, 1.25, 1.5
DEPTH = 2.2e-3
JOINT = "lower|upper"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 2, "accuracy": 1e-6}


def hertz(force):
    """Return the radius a of the contact and the peak pressure p_0 under the force P."""
    a = np.cbrt(3 * force * RADIUS / (4 * EFFECTIVE))
    return a, 3 * force / (2 * np.pi * a**2)


def scene(depth=DEPTH):
    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON[0], on="lower"),
        vx.Elasticity(YOUNG[1], POISSON[1], on="upper"),
        vx.Symmetry(on=["lower.left", "upper.left", "lower.front", "upper.front"]),
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(lambda x, t: [0.0, 0.0, -depth * t], on="upper.top"),
        vx.UnilateralContact(on=JOINT, gap=lambda x, t: (x[:, 0] ** 2 + x[:, 1] ** 2) / (2 * RADIUS)),
    )


def lines(n):
    """Return coordinates from 0 to `REACH`: steps of a/n up to `EVEN` times a, then growing steps."""
    line = list(CONTACT / n * np.arange(round(EVEN * n) + 1))
    step = CONTACT / n
    while line[-1] < REACH:
        step *= GROWTH
        line.append(line[-1] + step)
    return np.array([*line[:-1], REACH])


def grid(line):
    """Return a mesh of rectangles with corners at all pairs of coordinates in `line`."""
    lattice = vx.meshes.squares(len(line) - 1, box=((0, len(line) - 1), (0, len(line) - 1)))
    return vx.PolygonMesh(line[lattice.points.round().astype(int)], lattice.cells)


def mesh(n, family="graded", upper=None):
    """Return two blocks with n boxes across the radius a; the upper block may have `upper` boxes."""
    below, above = lines(n), lines(upper or n)
    lower = grid(below).extruded(-below[::-1])
    return vx.meshes.bodies({"lower": lower, "upper": grid(above).extruded(above)})


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def force(history):
    """Return the force P on the whole contact at every step."""
    contact = history.contact
    return 4 * contact.pressure @ contact.lengths


def measure(history, step=-1):
    """Return the radius from the mean of r^2, and the peak of the fitted half-ellipsoid."""
    contact = history.contact
    p, areas, r = contact.pressure[step], contact.lengths, np.hypot(*contact.points[:, :2].T)
    radius = np.sqrt(2.5 * (p * areas) @ r**2 / (p @ areas))
    shape = np.sqrt(np.maximum(1 - (r / hertz(force(history)[step])[0]) ** 2, 0.0))
    return radius, (areas * shape) @ p / ((areas * shape) @ shape)


def picture(history):
    """Draw the quarter of the contact, and the pressure against the radius beside Hertz' half-ellipse."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    face, graph = figure.subplots(1, 2)
    reach = 1.6 * CONTACT
    vx.plots.contact_face(history, ax=face, show="pressure", window=((0.0, reach), (0.0, reach)), units=UNITS)
    r, p = np.hypot(*history.contact.points[:, :2].T), history.contact.pressure
    near = r < reach
    for step, color, marker in ((history.steps, "C0", "o"), (history.steps // 2, "C1", "s")):
        P = force(history)[step]
        a, peak = hertz(P)
        line = np.linspace(0.0, a, 401)
        graph.plot(line, peak * np.sqrt(1 - (line / a) ** 2), color=color, label=f"Hertz, P = {P:.2g} N")
        graph.plot(r[near], p[step, near], color + marker, label="computed")
    graph.set(xlabel="distance $r$ from the axis (mm)", ylabel="pressure (MPa)", ylim=(0, None))
    graph.grid()
    graph.legend()
    return figure
