r"""Two elastic cylinders pressed together: Hertz' line contact with both bodies meshed.

The cylinders have radii R_1, R_2 and materials E_i, nu_i, in plane strain. In Hertz' model of small strains, one flat
interface between two elastic half-planes replaces both arcs, with the gap x^2 / (2R) and 1/R = 1/R_1 + 1/R_2. Under the
force P per length the half-width a and the pressure p(x) are

$$
1 / E^* = (1 - \nu_1^2) / E_1 + (1 - \nu_2^2) / E_2, \qquad a^2 = 4 P R / (\pi E^*),
\qquad p(x) = p_0 \sqrt{1-x^2/a^2}, \\
p_0 = 2 P / (\pi a)
$$

(Johnson, *Contact Mechanics*, 4.2). Each half-plane is a block about 40 half-widths wide and 20 high. We compute the
right half, x > 0. Cells have the width a/n at the contact, and grow outwards. The meshes do not match: in each
direction the upper body has about 3/4 of the cells of the lower body. The top is pressed down without friction, and P
is the sum of the computed contact forces. For n = 16 a half-ellipse is fitted to the nodal pressures. Its half-width
and its peak are within .5 % of Hertz' values.

    vemcvx run problems/hertz_two_cylinders.py --n 12 --steps 4 --plot
"""

import numpy as np

import vemcvx as vx

RADII, YOUNG, POISSON = (3.0, 1.5), (1000.0, 400.0), (0.3, 0.4)
HALF_WIDTH = 0.02  # approximate half-width a of the contact at t = 1
RADIUS = 1 / sum(1 / radius for radius in RADII)
EFFECTIVE = 1 / sum((1 - poisson**2) / young for young, poisson in zip(YOUNG, POISSON, strict=True))
REACH = 20 * HALF_WIDTH
DEPTH = 8e-4
JOINT = "lower|upper"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 10, "steps": 4}


def hertz(force):
    """Return the half-width a and the peak pressure p_0 under the force P per length on the whole contact."""
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


def coordinates(n):
    """Return coordinates from 0 to `REACH`: steps of a/n up to 1.6 a, then growing steps."""
    line, step = list(np.arange(0.0, 1.6 * HALF_WIDTH, HALF_WIDTH / n)), HALF_WIDTH / n
    while line[-1] < REACH:
        step *= 1.15
        line.append(line[-1] + step)
    return np.array([*line[:-1], REACH])


def grid(x, y):
    """Return a mesh of rectangles with corners at all (x[i], y[j]); x and y are arrays of equal length."""
    lattice = vx.meshes.squares(len(x) - 1, box=((0, len(x) - 1), (0, len(y) - 1)))
    i, j = lattice.points.round().astype(int).T
    return vx.PolygonMesh(np.column_stack([x[i], y[j]]), lattice.cells)


def mesh(n, family="graded"):
    """Return both bodies: n cells across the half-width in the lower body, and 3n/4 in the upper body."""
    below, above = coordinates(n), coordinates(max(2, 3 * n // 4))
    return vx.meshes.bodies({"lower": grid(below, -below[::-1]), "upper": grid(above, above)})


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def force(history):
    """Return the force P on the whole contact at every step."""
    contact = history.contact
    return 2 * contact.pressure @ contact.lengths


def picture(history):
    """Draw both bodies near the contact with their mirror images, and the pressure beside Hertz' half-ellipse."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    reach = 2.2 * HALF_WIDTH
    window = ((-reach, reach), (-reach, reach))
    vx.plots.stressed_body(history, ax=body, stress="shear", window=window, mirrors=[(-1, 1)], units=UNITS)
    near = history.contact.points[:, 0] < 1.6 * HALF_WIDTH
    x, p = history.contact.points[near, 0], history.contact.pressure_recovered[:, near]
    for step, color, marker in ((history.steps, "C0", "o"), (history.steps // 2, "C1", "s")):
        P = force(history)[step]
        a, peak = hertz(P)
        line = np.linspace(-a, a, 401)
        graph.plot(line, peak * np.sqrt(1 - (line / a) ** 2), color=color, label=f"Hertz, P = {P:.2g} N/mm")
        graph.plot([*-x, *x], [*p[step], *p[step]], color + marker, label="computed")
    graph.set(xlabel="$x_1$ (mm)", ylabel="pressure (MPa)", ylim=(0, 1.3 * p.max()))
    graph.grid()
    graph.legend(ncols=2, loc="upper center", columnspacing=1.0)
    return figure
