r"""A parabolic cylinder pressed on an elastic block: Hertz' line contact, to be compared in pressure and half-width.

The obstacle lies x^2 / 2R below the lower side of the block, plane strain, and is rigid. Under the force P per length,

$$ a^2 = 4 P R (1 - \nu^2) / (\pi E), \qquad p(x) = p_0 \sqrt{1-x^2/a^2}, \qquad p_0 = 2 P / (\pi a) $$

(Johnson, *Contact Mechanics*, 4.2). The block is 40 half-widths high and wide, so that it is nearly a half-space; one
half of it is computed, and its mesh is graded from a/n at the contact outwards. The top is pressed down and P is
measured.

    vemcvx run problems/hertz_contact.py --n 20 --steps 5 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import COMPUTED, SECOND

RADIUS, YOUNG, POISSON, HALF_WIDTH = 1.0, 1000.0, 0.3, 0.02
REACH = 20 * HALF_WIDTH
UNITS = MM
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


def graded(fine, n, reach, growth=1.15):
    """Coordinates from 0 on: steps of fine/n up to 1.6 fine, then growing, up to reach."""
    line = list(np.arange(0.0, 1.6 * fine, fine / n))
    step = fine / n
    while line[-1] < reach:
        step = min(step * growth, reach / 4)
        line.append(line[-1] + step)
    return np.array(line) * reach / line[-1] if line[-1] > 1.5 * reach else np.array([*line[:-1], reach])


def grid(x, y):
    """Rectangles between the lines x and y, sides named."""
    points = np.array([(a, b) for b in y for a in x])
    first = (np.arange(len(y) - 1)[:, None] * len(x) + np.arange(len(x) - 1)).ravel()
    made = vx.PolygonMesh(points, first[:, None] + [0, 1, len(x) + 1, len(x)])
    for name, axis, value in (("left", 0, x[0]), ("right", 0, x[-1]), ("bottom", 1, y[0]), ("top", 1, y[-1])):
        made = made.with_boundary(name, lambda p, axis=axis, value=value: np.abs(p[:, axis] - value) < 1e-12)
    return made


def mesh(n, family="graded"):
    return grid(graded(HALF_WIDTH, n, REACH), graded(HALF_WIDTH, n, REACH))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def fitted(x, p):
    """Half-width and peak of p^2 = p0^2 (1 - (x - m)^2 / a^2), by least squares over the inner part; m is free."""
    inner = p > 0.35 * p.max()
    curve, tilt, level = np.polyfit(x[inner], p[inner] ** 2, 2)
    top = level - tilt**2 / (4 * curve)
    return np.sqrt(-top / curve), np.sqrt(top)


def picture(history):
    """The block around the contact, its other half in the mirror, and the pressure beside Hertz' half-ellipse."""
    reach = 2.2 * HALF_WIDTH
    window = ((-reach, reach), (-0.3 * reach, 1.5 * reach))
    figure, graph = body_and_graph(history, stress="yy", window=window, mirrors=[(-1, 1)])
    x, p = history.contact.points[:, 0], history.contact.pressure
    for step, colour in ((history.steps, COMPUTED), (history.steps // 2, SECOND)):
        P = 2 * history.force("bottom")[step, 1]
        a = np.sqrt(4 * P * RADIUS * (1 - POISSON**2) / (np.pi * YOUNG))
        line = np.linspace(-a, a, 401)
        exact = 2 * P / (np.pi * a) * np.sqrt(1 - (line / a) ** 2)
        near = x < 1.6 * HALF_WIDTH
        marks = np.concatenate([-x[near][::-1], x[near]]), np.concatenate([p[step, near][::-1], p[step, near]])
        label, words = f"P = {P:.2g}", "Hertz" if step == history.steps else None
        beside_closed_form(graph, marks, (line, exact), colour=colour, label=label, exact_label=words)
    graph.set(xlabel="$x_1$ (mm)", ylabel="pressure (MPa)", ylim=(0, None))
    return figure
