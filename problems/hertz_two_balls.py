r"""Two elastic balls pressed together: Hertz' point contact with both bodies meshed in space.

Radii R_1, R_2 and materials E_i, nu_i. In small strains the surfaces near the contact are one flat interface with the
gap (x_1^2 + x_2^2) / 2R, 1/R = 1/R_1 + 1/R_2, between two elastic half-spaces; this is Hertz' own model, and it is
posed here as such. Under the force P,

$$
1 / E^* = (1 - \nu_1^2) / E_1 + (1 - \nu_2^2) / E_2, \qquad a^3 = 3 P R / (4 E^*),
\qquad p(r) = p_0 \sqrt{1-r^2/a^2}, \\
p_0 = 3 P / (2 \pi a^2)
$$

(Johnson, *Contact Mechanics*, 4.2). Each half-space is a block that reaches 10 a, of which a quarter is computed; cells
are even up to 1.25 a and grow outwards from there. The top is pressed down and P is measured; there is no friction. The
radius is that of the second moment of the forces, <r^2> = 2/5 a^2, the peak that of the half-ellipsoid which is nearest
to all pressures in the mean square. With n = 8 both are Hertz' within 2 %, and the largest nodal pressure is, too.
Where meshes do not match (`upper=6`: cells that are 4/3 times as wide) pressures of nodes of two bodies alternate, by
order h, and the largest is 8 % above; radius and peak are Hertz' within 3.1 %, with n = 12 and `upper=9` within 2 %.

    vemcvx run problems/hertz_two_balls.py --n 8 --steps 2 --accuracy 1e-6 --plot
"""

import numpy as np

import vemcvx as vx
from hertz_contact import grid
from problem_pictures import MM, beside_closed_form, face_and_graph
from vemcvx.plots.style import COMPUTED, SECOND

RADII, YOUNG, POISSON = (3.0, 1.5), (1000.0, 400.0), (0.3, 0.4)
RADIUS = 1 / sum(1 / radius for radius in RADII)
EFFECTIVE = 1 / sum((1 - poisson**2) / young for young, poisson in zip(YOUNG, POISSON, strict=True))
CONTACT = 0.05
"""About the radius of the contact."""
REACH, EVEN, GROWTH = 10 * CONTACT, 1.25, 1.5
DEPTH = 2.2e-3
JOINT = "lower|upper"
UNITS = MM
SMALL = {"n": 4, "steps": 2, "accuracy": 1e-6}


def hertz(force):
    """Radius of the contact and peak pressure under the force P."""
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
    """Lines from 0 to the reach: steps of a/n up to `EVEN` a, then growing."""
    line = list(CONTACT / n * np.arange(round(EVEN * n) + 1))
    step = CONTACT / n
    while line[-1] < REACH:
        step *= GROWTH
        line.append(line[-1] + step)
    return np.array([*line[:-1], REACH])


def mesh(n, family="graded", upper=None):
    """Blocks of boxes, n across the radius, in the upper body n or `upper`."""
    below, above = lines(n), lines(upper or n)
    lower = grid(below, below).extruded(-below[::-1])
    return vx.meshes.bodies({"lower": lower, "upper": grid(above, above).extruded(above)})


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def force(history):
    """P of the whole contact at every step."""
    contact = history.contact
    return 4 * contact.pressure @ contact.lengths


def measured(history, step=-1):
    """Radius of the contact by the second moment of its forces, and the peak of the nearest half-ellipsoid."""
    contact = history.contact
    p, areas, r = contact.pressure[step], contact.lengths, np.hypot(*contact.points[:, :2].T)
    radius = np.sqrt(2.5 * (p * areas) @ r**2 / (p @ areas))
    shape = np.sqrt(np.maximum(1 - (r / hertz(force(history)[step])[0]) ** 2, 0.0))
    return radius, (areas * shape) @ p / ((areas * shape) @ shape)


def picture(history):
    """The quarter of the contact, and the pressure over the radius beside Hertz' half-ellipse."""
    reach = 1.6 * CONTACT
    figure, graph = face_and_graph(history, show="pressure", window=((0.0, reach), (0.0, reach)))
    r, p = np.hypot(*history.contact.points[:, :2].T), history.contact.pressure
    near = r < reach
    for step, colour, mark in ((history.steps, COMPUTED, "o"), (history.steps // 2, SECOND, "s")):
        P = force(history)[step]
        a, peak = hertz(P)
        line = np.linspace(0.0, a, 401)
        exact = line, peak * np.sqrt(1 - (line / a) ** 2)
        words = "Hertz" if step == history.steps else None
        marks = r[near], p[step, near]
        beside_closed_form(graph, marks, exact, colour=colour, marker=mark, label=f"P = {P:.2g} N", exact_label=words)
    graph.set(xlabel="distance $r$ from the axis (mm)", ylabel="pressure (MPa)", ylim=(0, None))
    return figure
