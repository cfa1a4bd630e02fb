r"""A parabolic cylinder pressed on an elastic block: Hertz' line contact.

The gap between the block and the rigid cylinder of radius R is x^2 / 2R at x. The elastic block is in plane strain,
with Young's modulus E and Poisson's ratio nu. Under the force P per length the half-width a of the contact and the
pressure p(x) are

$$ a^2 = 4 P R (1 - \nu^2) / (\pi E), \qquad p(x) = p_0 \sqrt{1-x^2/a^2}, \qquad p_0 = 2 P / (\pi a) $$

(Johnson, *Contact Mechanics*, 4.2). The block is about 40 half-widths wide and 20 high, so that it is nearly a
half-space. The right half is computed. Cells have the width a/n at the contact, and grow outwards. The top is pressed
down, and P is the sum of the computed contact forces.

    vemcvx run problems/hertz_contact.py --n 20 --steps 5 --plot
"""

import numpy as np

import vemcvx as vx

RADIUS, YOUNG, POISSON, HALF_WIDTH = 1.0, 1000.0, 0.3, 0.02
"""`HALF_WIDTH` is the approximate half-width a of the contact at t = 1."""
REACH = 20 * HALF_WIDTH
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 14, "steps": 4}


def scene(radius=RADIUS, depth=9e-4):
    def down(x, t):
        return np.column_stack([np.zeros(len(x)), np.full(len(x), -depth * t)])

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.Symmetry(on="left"),
        vx.PrescribedDisplacement(down, on="top"),
        vx.UnilateralContact(on="bottom", gap=lambda x, t: x[:, 0] ** 2 / (2 * radius)),
    )


def coordinates(n):
    """Return coordinates from 0 to `REACH`: steps of a/n up to 1.6 a, then growing steps."""
    line, step = list(np.arange(0.0, 1.6 * HALF_WIDTH, HALF_WIDTH / n)), HALF_WIDTH / n
    while line[-1] < REACH:
        step *= 1.15
        line.append(line[-1] + step)
    return np.array([*line[:-1], REACH])


def mesh(n, family="graded"):
    """Return rectangles that grow away from the contact."""
    line = coordinates(n)
    lattice = vx.meshes.squares(len(line) - 1, box=((0, len(line) - 1), (0, len(line) - 1)))
    return vx.PolygonMesh(line[lattice.points.round().astype(int)], lattice.cells)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def fit_half_ellipse(x, p):
    """Return a and p0 of the half-ellipse p^2 = p0^2 (1 - (x - m)^2 / a^2), fitted to the points with p > .35 max p."""
    inner = p > 0.35 * p.max()
    curve, tilt, level = np.polyfit(x[inner], p[inner] ** 2, 2)
    top = level - tilt**2 / (4 * curve)
    return np.sqrt(-top / curve), np.sqrt(top)


def picture(history):
    """Draw the block near the contact with its mirror image, and the pressure beside Hertz' half-ellipse."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    reach = 2.2 * HALF_WIDTH
    window = ((-reach, reach), (-0.3 * reach, 1.5 * reach))
    vx.plots.stressed_body(history, ax=body, stress="yy", window=window, mirrors=[(-1, 1)], units=UNITS)
    near = history.contact.points[:, 0] < 1.6 * HALF_WIDTH
    x, p = history.contact.points[near, 0], history.contact.pressure[:, near]
    for step, color, marker in ((history.steps, "C0", "o"), (history.steps // 2, "C1", "s")):
        P = 2 * history.force("bottom")[step, 1]
        a = np.sqrt(4 * P * RADIUS * (1 - POISSON**2) / (np.pi * YOUNG))
        line = np.linspace(-a, a, 401)
        graph.plot(
            line, 2 * P / (np.pi * a) * np.sqrt(1 - (line / a) ** 2), color=color, label=f"Hertz, P = {P:.2g} N/mm"
        )
        graph.plot([*-x, *x], [*p[step], *p[step]], color + marker, label="computed")
    graph.set(xlabel="$x_1$ (mm)", ylabel="pressure (MPa)", ylim=(0, 1.3 * p.max()))
    graph.grid()
    graph.legend(ncols=2, loc="upper center", columnspacing=1.0)
    return figure
