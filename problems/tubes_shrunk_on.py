r"""A tube shrunk on another one in space: the pressure between them is Lame's, and they slide along each other.

Two tubes a < r < b and b < r < c of length L, a quarter of them; the outer radius of the inner one exceeds the inner
radius of the outer one by the interference delta, which is posed as the gap -delta t. Ends are free and the joint is
smooth, so that both tubes are in plane stress: radial and hoop stresses are those of :mod:`press_fit` (Lame 1852;
Timoshenko and Goodier, *Theory of Elasticity*, 28), and the tubes change their lengths,

$$
e_z = -\nu(\sigma_r + \sigma_\theta) / E, \qquad \sigma_r + \sigma_\theta = -2 p b^2 / (b^2 - a^2),
\qquad 2 p b^2 / (c^2 - b^2),
$$

the inner one by growing, the outer one by shrinking: they slide on each other by the difference times z. Both have 3n
sectors in the quarter, so that they approximate the circle r = b by the same polygon; layers do not match: n/2, 3n/4.
With n = 8 the mean pressure is Lame's within .6 %; pressures of nodes, of order h, scatter by 4 %, and recovered
ones, `contact.pressure_recovered`, by 1 %.

    vemcvx run problems/tubes_shrunk_on.py --n 8 --steps 2 --accuracy 1e-7 --plot
"""

import numpy as np

import vemcvx as vx
from press_fit import INTERFERENCE, POISSON, RADII, YOUNG, pressure, stresses
from problem_pictures import MM, beside_closed_form
from vemcvx.base.canvas import new_figure
from vemcvx.plots import deformed_body
from vemcvx.plots.style import COMPUTED, SECOND

LENGTH, JOINT = 0.8, "inner|outer"
UNITS = MM
SMALL = {"n": 8, "steps": 2, "accuracy": 1e-7}


def lengthwise():
    """Strains e_z of the inner and the outer tube."""
    a, b, c = RADII
    sums = -2 * pressure() * b**2 / (b**2 - a**2), 2 * pressure() * b**2 / (c**2 - b**2)
    return tuple(-nu * both / young for nu, both, young in zip(POISSON, sums, YOUNG, strict=True))


def scene(interference=INTERFERENCE):
    walls = [f"{tube}.{side}" for tube in ("inner", "outer") for side in ("first", "last", "bottom")]
    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON[0], on="inner"),
        vx.Elasticity(YOUNG[1], POISSON[1], on="outer"),
        vx.Symmetry(on=walls),
        vx.UnilateralContact(on=JOINT, gap=lambda x, t: np.full(len(x), -interference * t)),
    )


def mesh(n, family="ring"):
    """Hexahedra: 3n sectors, in n/2 layers of the inner tube and 3n/4 of the outer one."""
    tubes, layers = {}, max(1, n // 2)
    for name, ends, high in (("inner", RADII[:2], layers), ("outer", RADII[1:], 3 * layers // 2)):
        rings = max(2, round(6 * n * np.log(ends[1] / ends[0]) / np.pi))
        flat = vx.meshes.ring(np.geomspace(*ends, rings + 1), 3 * n, angles=(0.0, np.pi / 2))
        tubes[name] = flat.extruded(np.linspace(0.0, LENGTH, high + 1))
    return vx.meshes.bodies(tubes)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def mean_pressure(history):
    """The force of the joint over its area, at every step."""
    contact = history.contact
    return contact.pressure @ contact.lengths / contact.lengths.sum()


def picture(history):
    """The tubes in the stress across the symmetry, and the stresses along the radius in the middle layers."""
    figure = new_figure(8.2, 3.3)
    body, graph = figure.subplots(1, 2)
    deformed_body(history, ax=body, stress="von_mises", units=UNITS)
    x, sigma = history.mesh.centroids, history.stress(-1)
    r = np.hypot(x[:, 0], x[:, 1])
    c, s = x[:, 0] / r, x[:, 1] / r
    radial = sigma[:, 0] * c**2 + sigma[:, 1] * s**2 + 2 * sigma[:, 3] * c * s
    hoop = sigma[:, 0] * s**2 + sigma[:, 1] * c**2 - 2 * sigma[:, 3] * c * s
    chosen, line = np.abs(np.arctan2(s, c) - np.pi / 4) < np.pi / 16, np.linspace(RADII[0], RADII[2], 600)
    names, looks = (r"$\sigma_r$", r"$\sigma_\theta$"), ((COMPUTED, "o"), (SECOND, "s"))
    for found, exact, name, (colour, mark) in zip((radial, hoop), stresses(line), names, looks, strict=True):
        marks = r[chosen], found[chosen]
        beside_closed_form(graph, marks, (line, exact), colour=colour, marker=mark, label=name, exact_label=None)
    graph.set(xlabel="radius (mm)", ylabel="stress (MPa)")
    graph.set_title("in the cells about 45 degrees, and Lame 1852", fontsize="small")
    return figure
