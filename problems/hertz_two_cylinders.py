r"""Two elastic cylinders pressed together: Hertz' line contact with both bodies meshed, and what both of them give.

Radii R_1, R_2 and materials E_i, nu_i, plane strain. In small strains the two arcs near the contact are one flat
interface with the gap x^2 / 2R, 1/R = 1/R_1 + 1/R_2, between two elastic half-planes; this is Hertz' own model, and it
is posed here as such. Under the force P per length,

$$
1 / E^* = (1 - \nu_1^2) / E_1 + (1 - \nu_2^2) / E_2, \qquad a^2 = 4 P R / (\pi E^*),
\qquad p(x) = p_0 \sqrt{1-x^2/a^2}, \\
p_0 = 2 P / (\pi a)
$$

(Johnson, *Contact Mechanics*, 4.2). Each half-plane is a block 40 half-widths wide and 20 high, of which one half is
computed; meshes are graded from a/n at the contact outwards, and those of the two bodies do not match: the upper one
has 3/4 of the cells. The top is pressed down and P is measured; there is no friction. With n = 16 half-width and peak
are Hertz' within .5 %.

    vemcvx run problems/hertz_two_cylinders.py --n 12 --steps 4 --plot
"""

import numpy as np

import vemcvx as vx
from hertz_contact import graded, grid
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import COMPUTED, SECOND

RADII, YOUNG, POISSON, HALF_WIDTH = (3.0, 1.5), (1000.0, 400.0), (0.3, 0.4), 0.02
RADIUS = 1 / sum(1 / radius for radius in RADII)
EFFECTIVE = 1 / sum((1 - poisson**2) / young for young, poisson in zip(YOUNG, POISSON, strict=True))
REACH = 20 * HALF_WIDTH
DEPTH = 8e-4
JOINT = "lower|upper"
UNITS = MM
SMALL = {"n": 10, "steps": 4}


def hertz(force):
    """Half-width and peak pressure under the force P per length of the whole contact."""
    a = np.sqrt(4 * force * RADIUS / (np.pi * EFFECTIVE))
    return a, 2 * force / (np.pi * a)


def scene(depth=DEPTH):
    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON[0], on="lower"),
        vx.Elasticity(YOUNG[1], POISSON[1], on="upper"),
        vx.Symmetry(on=["lower.left", "upper.left"]),
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(lambda x, t: np.tile([0.0, -depth * t], (len(x), 1)), on="upper.top"),
        vx.UnilateralContact(on=JOINT, gap=lambda x, t: x[:, 0] ** 2 / (2 * RADIUS)),
    )


def mesh(n, family="graded"):
    below, above = (graded(HALF_WIDTH, cells, REACH) for cells in (n, max(2, 3 * n // 4)))
    return vx.meshes.bodies({"lower": grid(below, -below[::-1]), "upper": grid(above, above)})


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def force(history):
    """P of the whole contact at every step."""
    contact = history.contact
    return 2 * contact.pressure @ contact.lengths


def picture(history):
    """Both bodies around the contact, with their mirror images, and the pressure beside Hertz' half-ellipse."""
    reach = 2.2 * HALF_WIDTH
    window = ((-reach, reach), (-reach, reach))
    figure, graph = body_and_graph(history, stress="shear", window=window, mirrors=[(-1, 1)])
    x, p = history.contact.points[:, 0], history.contact.pressure_recovered
    for step, colour, mark in ((history.steps, COMPUTED, "o"), (history.steps // 2, SECOND, "s")):
        P = force(history)[step]
        a, peak = hertz(P)
        line = np.linspace(-a, a, 401)
        near = x < 1.6 * HALF_WIDTH
        marks = np.concatenate([-x[near][::-1], x[near]]), np.concatenate([p[step, near][::-1], p[step, near]])
        words = "Hertz" if step == history.steps else None
        exact = line, peak * np.sqrt(1 - (line / a) ** 2)
        beside_closed_form(
            graph, marks, exact, colour=colour, marker=mark, label=f"P = {P:.2g} N/mm", exact_label=words
        )
    graph.set(xlabel="$x_1$ (mm)", ylabel="pressure (MPa)", ylim=(0, None))
    return figure
