r"""A tube under pressure in a rigid housing: it widens, closes the gap, and leans on the housing.

A quarter of a thick tube a < r < b in plane strain, the pressure p(t) inside, and a rigid housing at the distance
`gap` outside. Lame (1852): with p inside and q outside,

$$
\sigma_r = A - B / r^2, \qquad \sigma_\theta = A + B / r^2, \qquad u_r = (1 + \nu) / E ((1 - 2 \nu) A r + B / r), \\
A = (p a^2 - q b^2) / (b^2 - a^2), \qquad B = (p - q) a^2 b^2 / (b^2 - a^2).
$$

q = 0 until u_r(b) = gap; from then on u_r(b) = gap, and q grows in proportion to the rest of p. On a mesh the circle
is a polygon, an error O(h^2).

    vemcvx run problems/liner_in_housing.py --n 8 --steps 10 --plot
"""

import numpy as np

import vemcvx as vx
from plate_with_hole import polar
from problem_pictures import MM, beside_closed_form, body_and_graph

INNER, OUTER, YOUNG, POISSON, GAP, PRESSURE = 1.0, 1.8, 100.0, 0.3, 0.01, 3.0
UNITS = MM
SMALL = {"n": 10, "steps": 10}


def unit(p, q):
    """A and B under the pressures p and q."""
    a2, b2 = INNER**2, OUTER**2
    return (p * a2 - q * b2) / (b2 - a2), (p - q) * a2 * b2 / (b2 - a2)


def widening(r, p, q):
    """u_r."""
    A, B = unit(p, q)
    return (1 + POISSON) / YOUNG * ((1 - 2 * POISSON) * A * r + B / r)


def contact_pressure(p, gap=GAP):
    """q: what makes u_r(b) = gap, if the gap is closed at all."""
    return np.maximum((gap - widening(OUTER, p, 0.0)) / widening(OUTER, 0.0, 1.0), 0.0)


def closing_pressure(gap=GAP):
    return gap / widening(OUTER, 1.0, 0.0)


def scene(gap=GAP, pressure=PRESSURE):
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.Symmetry(on=["above", "beside"]),
        vx.Pressure(lambda x, t: np.full(len(x), pressure * t), on="inner"),
        vx.UnilateralContact(on="outer", gap=gap),
    )


def mesh(n, family="polar"):
    return polar(np.linspace(INNER, OUTER, n + 1), np.linspace(0, np.pi / 2, 2 * n + 1))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The tube leaning on its housing, and how the pressure between them grows."""
    figure, graph = body_and_graph(history, stress="shear", mirrors=[(-1, 1), (1, -1), (-1, -1)])
    p, line = PRESSURE * history.times, np.linspace(0, PRESSURE, 200)
    marks = (p, history.contact.pressure.mean(axis=1))
    beside_closed_form(graph, marks, (line, contact_pressure(line)), label="on the housing", exact_label="Lame 1852")
    graph.axvline(closing_pressure(), color="0.6", linestyle=":", linewidth=1.2)
    graph.text(closing_pressure() - 0.05, 1.0, "the gap closes", rotation=90, ha="right", va="center", color="0.4")
    graph.set(xlabel="pressure inside (MPa)", ylabel="pressure on the housing (MPa)")
    return figure
