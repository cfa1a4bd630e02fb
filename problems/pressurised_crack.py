r"""A crack in prestressed rock under fluid pressure: it opens once the pressure exceeds the prestress.

A block |x|, |y| < 10 a in plane strain has the crack |x| < a, y = 0. The prestress is -S_H along x and -S along y. The
pressures S_H and S act on the sides of the block, so that the block needs no supports. A fluid of pressure p(t) presses
both faces of the crack apart. Until p = S the faces touch with the pressure S - p. If p > S, a crack in an infinite
body opens by (Sneddon 1946)

$$ \frac{4 (1 - \nu^2)}{E} (p - S) (a^2 - x^2)^{1/2}. $$

In this finite block the opening is 1 % larger. The mesh error of the opening is O(h).

    vemcvx run problems/pressurised_crack.py --n 8 --steps 8 --plot
"""

import numpy as np

import vemcvx as vx

HALF, SIZE, YOUNG, POISSON, ACROSS, ALONG, MOST = 1.0, 10.0, 20e3, 0.25, 5.0, 8.0, 10.0
UNITS = {"length": "m", "force": "MN", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 8}
initial = "settled"


def fluid(t):
    """Return the pressure of the fluid at the instant t."""
    return MOST * t


def opening(x, p):
    """Return the opening in an infinite body at the place x under the fluid pressure p."""
    widest = 4 * (1 - POISSON**2) / YOUNG * np.maximum(p - ACROSS, 0.0)
    return widest * np.sqrt(np.maximum(HALF**2 - x**2, 0.0))


def measure_opening(history):
    """Return places x (m,) along the crack, and the openings at all stored steps, one row per step."""
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
    """Draw the block around the open crack, and the opening of the crack at two pressures."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    vx.plots.stressed_body(history, ax=body, window=((-3, 3), (-3, 3)), stress="yy", units=UNITS)
    x, computed = measure_opening(history)
    line = np.linspace(-HALF, HALF, 200)
    for step, color, marker in ((history.steps, "C0", "o"), (3 * history.steps // 4, "C1", "s")):
        p = fluid(history.times[step])
        graph.plot(line, 1e3 * opening(line, p), color=color, label=f"Sneddon 1946, {p:.3g} MPa")
        graph.plot(x, 1e3 * computed[step], color + marker, label="computed")
    graph.set(xlabel="x (m)", ylabel="opening (mm)", ylim=(None, 1.35e3 * opening(0.0, fluid(1.0))))
    graph.locator_params(nbins=6)
    graph.grid()
    graph.legend(ncols=2, loc="upper center", columnspacing=1.0)
    return figure
