r"""A ring pressed over another that is too large for it: the pressure between them is Lame's.

Two rings a < r < b and b < r < c, plane stress, a quarter of them; the outer radius of the inner ring exceeds the
inner radius of the outer one by the interference delta, which is posed as the gap -delta t between them. With the
pressure p on its outer radius the inner ring shrinks, and with p on its inner radius the outer one widens, by (Lame
1852; Timoshenko and Goodier, *Theory of Elasticity*, 28)

$$ b p / E_1 ((b^2 + a^2) / (b^2 - a^2) - \nu_1), \qquad b p / E_2 ((c^2 + b^2) / (c^2 - b^2) + \nu_2), $$

which together are delta. The surfaces are free to slide. Meshes do not match: the two polygons of the circle r = b
are up to b (pi / 4n)^2 / 8 apart, and the outer ring takes the outline of the inner one (`tolerance=`); nodes that it
lends to it lie on the chords. So errors of nodal pressures are of order h, those of the mean pressure of order h^2;
`contact.pressure_recovered` has a quarter of the former or less (root of the mean square). Equal numbers of cells
(`outer=n`) match, and all is of order h^2.

A gap counts in differences of two displacements, whose rounding alone is 3e-8 of the energy norm: ask for 1e-7.

    vemcvx run problems/press_fit.py --n 8 --steps 4 --accuracy 1e-7 --plot
"""

import numpy as np

import vemcvx as vx
from plate_with_hole import polar
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import COMPUTED, SECOND

RADII, YOUNG, POISSON, INTERFERENCE = (1.0, 1.6, 2.4), (200.0, 70.0), (0.3, 0.33), 0.004
JOINT = "inner|outer"
UNITS = MM
SMALL = {"n": 12, "steps": 4, "accuracy": 1e-7}


def pressure(interference=INTERFERENCE):
    """p of Lame, for the interference delta."""
    a, b, c = RADII
    inner = ((b**2 + a**2) / (b**2 - a**2) - POISSON[0]) / YOUNG[0]
    outer = ((c**2 + b**2) / (c**2 - b**2) + POISSON[1]) / YOUNG[1]
    return interference / (b * (inner + outer))


def stresses(r):
    """Radial and hoop stress at the radii r."""
    a, b, c = RADII
    p, inner = pressure(), r < b
    mean = np.where(inner, -p * b**2 / (b**2 - a**2), p * b**2 / (c**2 - b**2))
    swing = mean * np.where(inner, a, c) ** 2 / r**2
    return mean - swing, mean + swing


def scene(interference=INTERFERENCE):
    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON[0], plane="stress", on="inner"),
        vx.Elasticity(YOUNG[1], POISSON[1], plane="stress", on="outer"),
        vx.Symmetry(on=["inner.above", "inner.beside", "outer.above", "outer.beside"]),
        vx.UnilateralContact(on=JOINT, gap=lambda x, t: np.full(len(x), -interference * t)),
    )


def mesh(n, family="polar", outer=None):
    """2n cells around the quarter of the inner ring, 3n (or 2 `outer`) around that of the outer one."""
    a, b, c = RADII
    rings = {}
    for name, ends, across in (("inner", (a, b), n), ("outer", (b, c), outer or 3 * n // 2)):
        cells = max(2, round(across * np.log(ends[1] / ends[0])))
        rings[name] = polar(np.geomspace(*ends, cells + 1), np.linspace(0, np.pi / 2, 2 * across + 1))
    return vx.meshes.bodies(rings, tolerance=b * (np.pi / (4 * n)) ** 2 / 7)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The rings, drawn apart by the magnified interference where they press, and the stresses along a radius."""
    figure, graph = body_and_graph(history, stress="shear", mirrors=[(-1, 1), (1, -1), (-1, -1)])
    x, (xx, yy, xy) = history.mesh.centroids, history.stress(-1).T
    r, angle = np.hypot(*x.T), np.arctan2(x[:, 1], x[:, 0])
    chosen = np.abs(angle - np.pi / 4) < np.pi / 20
    c, s = np.cos(angle), np.sin(angle)
    radial, hoop = xx * c**2 + yy * s**2 + 2 * xy * c * s, xx * s**2 + yy * c**2 - 2 * xy * c * s
    line = np.linspace(RADII[0], RADII[2], 600)
    names, looks = (r"$\sigma_r$", r"$\sigma_\theta$"), ((COMPUTED, "o"), (SECOND, "s"))
    for found, exact, name, (colour, mark) in zip((radial, hoop), stresses(line), names, looks, strict=True):
        marks = r[chosen], found[chosen]
        beside_closed_form(graph, marks, (line, exact), colour=colour, marker=mark, label=name, exact_label=None)
    graph.set(xlabel="radius (mm)", ylabel="stress (MPa)")
    graph.set_title("in the cells about 45 degrees, and Lame 1852", fontsize="small")
    return figure
