r"""A crack in prestressed rock, under the pressure of a fluid: it opens where the fluid bears more than the rock.

A block |x|, |y| < 10 a in plane strain has the stress -S_H along x and -S across the crack |x| < a, y = 0; the same
pressures act on its sides, so that nothing needs to hold it. The fluid presses both faces of the crack apart with p(t).
The faces touch with the pressure S - p until p = S. Beyond that the crack in an infinite body opens by (Sneddon 1946)

$$ \frac{4 (1 - \nu^2)}{E} (p - S) (a^2 - x^2)^{1/2}. $$

In a block of 10 a it opens by 1 % more, and the mesh takes O(h) from it.

    vemcvx run problems/pressurised_crack.py --n 8 --steps 8 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import beside_closed_form, body_and_graph
from vemcvx.plots.style import SLIP

HALF, SIZE, YOUNG, POISSON, ACROSS, ALONG, MOST = 1.0, 10.0, 20e3, 0.25, 5.0, 8.0, 10.0
UNITS = {"length": "m", "force": "MN", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 8}
initial = "settled"


def fluid(t):
    """Return the pressure of the fluid at the instant t."""
    return MOST * t


def opening(x, p):
    """Return the opening in an infinite body under the pressure p."""
    widest = 4 * (1 - POISSON**2) / YOUNG * np.maximum(p - ACROSS, 0.0)
    return widest * np.sqrt(np.maximum(HALF**2 - x**2, 0.0))


def opened(history):
    """Return places x (m,) along the crack and the opening there at all stored steps (S, m)."""
    contact, u = history.contact, history.displacement
    jump = u[:, contact.nodes] - u[:, contact.partners]
    return contact.points[:, 0], -np.einsum("smd,md->sm", jump, contact.normals)


def scene(across=ACROSS, along=ALONG):
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.Prestress((-along, -across, 0.0)),
        vx.Pressure(along, on=["left", "right"]),
        vx.Pressure(across, on=["bottom", "top"]),
        vx.UnilateralContact(on="crack"),
        vx.Pressure(lambda x, t: np.full(len(x), fluid(t)), on="crack"),
    )


def mesh(n, family="squares"):
    """Return the block with cells of a/n at the crack."""
    block = vx.meshes.FAMILIES[family](int(2 * SIZE), box=((-SIZE, SIZE), (-SIZE, SIZE)))
    for level in range(1, int(np.ceil(np.log2(n))) + 1):
        block = block.refine(np.abs(block.centroids).max(axis=1) < max(SIZE / 2**level, 1.6 * HALF))
    x, y = block.centroids.T
    inside = np.abs(x) < HALF
    return block.cut("crack", {"above": inside & (y > 0), "below": inside & (y < 0)})


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The block around the open crack, and its opening at two pressures."""
    figure, graph = body_and_graph(history, window=((-3, 3), (-3, 3)), stress="yy", units=UNITS)
    x, found = opened(history)
    order, line = np.argsort(x), np.linspace(-HALF, HALF, 200)
    for step, how in ((-1, {}), (3 * history.steps // 4, {"colour": SLIP, "exact_label": None})):
        p = fluid(history.times[step])
        marks, exact = (x[order], 1e3 * found[step, order]), (line, 1e3 * opening(line, p))
        beside_closed_form(graph, marks, exact, label=f"{p:.3g} MPa", **{"exact_label": "Sneddon 1946"} | how)
    graph.set(xlabel="x (m)", ylabel="opening (mm)")
    return figure
