r"""A fault with prescribed slip, and the shear stress that the fault loses.

A block |x|, |y| < 10 a in plane strain has no supports. The fault |x| < a, y = 0 stays closed and slips by

$$ s = \frac{4 (1 - \nu^2)}{E} \tau (a^2 - x^2)^{1/2}. $$

A crack in an infinite body has this slip if its shear stress falls by tau (Starr 1928). In this finite block with
n = 32 the computed fall is tau within 1 % for |x| <= 0.8 a; near the tips the fall is larger than tau.

    vemcvx run problems/fault_slip.py --n 8 --steps 2 --plot
"""

import numpy as np

import vemcvx as vx

HALF, SIZE, YOUNG, POISSON, DROP = 1.0, 10.0, 20e3, 0.25, 3.0
UNITS = {"length": "m", "force": "MN", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 2}


def slip(x, t, drop=DROP):
    """Return the slip along the fault, right-lateral, at points x (m, 2)."""
    return 4 * (1 - POISSON**2) / YOUNG * drop * t * np.sqrt(np.maximum(HALF**2 - x[:, 0] ** 2, 0.0))


def stress_drop(history):
    """Return places x along the fault, and the lost shear stress, one row per instant."""
    contact = history.contact
    return contact.points[:, 0], history.forces[:, contact.nodes, 0] / contact.lengths


def scene(drop=DROP):
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.PrescribedSlip(lambda x, t: slip(x, t, drop), on="crack"),
    )


def mesh(n, family="squares"):
    """Return the block with cells of width a/n at the fault if n is a power of two, else with smaller cells."""
    block = vx.meshes.FAMILIES[family](int(2 * SIZE), box=((-SIZE, SIZE), (-SIZE, SIZE)))
    for level in range(1, int(np.ceil(np.log2(n))) + 1):
        block = block.refine(np.abs(block.centroids).max(axis=1) < max(SIZE / 2**level, 1.6 * HALF))
    x, y = block.centroids.T
    inside = np.abs(x) < HALF
    return block.cut("crack", {"above": inside & (y > 0), "below": inside & (y < 0)})


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the shear stress around the fault, and the shear stress that the fault lost."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    window = ((-3, 3), (-3, 3))
    vx.plots.stressed_body(history, ax=body, window=window, stress="xy", forces="none", units=UNITS)
    x, drop = stress_drop(history)
    graph.plot([-HALF, HALF], [DROP, DROP], "k-", label="Starr 1928")
    graph.plot(x, drop[-1], "C0o", label="computed")
    graph.set(xlabel="x (m)", ylabel="shear stress lost (MPa)", ylim=(0.0, None))
    graph.locator_params(nbins=6)
    graph.grid()
    graph.legend()
    return figure
