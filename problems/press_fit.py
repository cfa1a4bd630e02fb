r"""A press fit of two rings: the pressure between the rings is Lame's.

Two rings a < r < b and b < r < c are in plane stress; a quarter of them is computed. The outer radius of the inner ring
exceeds the inner radius of the outer ring by the interference delta. At time t, the gap between the rings is -t delta.
The inner ring has the constants E_1 and nu_1, the outer ring E_2 and nu_2. Let p be the pressure between the rings. At
r = b the inner ring shrinks by the first of the following lengths, and the outer ring widens by the second (Lame 1852;
Timoshenko and Goodier, *Theory of Elasticity*, 28):

$$ b p / E_1 ((b^2 + a^2) / (b^2 - a^2) - \nu_1), \qquad b p / E_2 ((c^2 + b^2) / (c^2 - b^2) + \nu_2). $$

The sum of both lengths is delta. The surfaces slide freely. The meshes do not match: nodes of the outer ring lie on
chords of the inner ring. Errors of nodal pressures are therefore O(h), and errors of the mean pressure O(h^2). The
errors of `contact.pressure_recovered` are at most a quarter of the errors of nodal pressures (in the root mean square).
Meshes with equal numbers of cells along the circle (`outer=n`) match, and all errors are O(h^2).

    vemcvx run problems/press_fit.py --n 8 --steps 4 --plot
"""

import numpy as np

import vemcvx as vx

RADII, YOUNG, POISSON, INTERFERENCE = (1.0, 1.6, 2.4), (200.0, 70.0), (0.3, 0.33), 0.004
JOINT = "inner|outer"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 12, "steps": 4, "accuracy": 1e-7}


def pressure(interference=INTERFERENCE):
    """Return Lame's pressure p for the interference delta."""
    a, b, c = RADII
    inner = ((b**2 + a**2) / (b**2 - a**2) - POISSON[0]) / YOUNG[0]
    outer = ((c**2 + b**2) / (c**2 - b**2) + POISSON[1]) / YOUNG[1]
    return interference / (b * (inner + outer))


def stresses(r):
    """Return Lame's radial and hoop stresses at the radii r."""
    a, b, c = RADII
    p, inner = pressure(), r < b
    mean = np.where(inner, -p * b**2 / (b**2 - a**2), p * b**2 / (c**2 - b**2))
    swing = mean * np.where(inner, a, c) ** 2 / r**2
    return mean - swing, mean + swing


def scene(interference=INTERFERENCE):
    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON[0], plane="stress", on="inner"),
        vx.Elasticity(YOUNG[1], POISSON[1], plane="stress", on="outer"),
        vx.Symmetry(on=["inner.first", "inner.last", "outer.first", "outer.last"]),
        vx.UnilateralContact(on=JOINT, gap=lambda x, t: np.full(len(x), -interference * t)),
    )


def mesh(n, family="ring", outer=None):
    """Return a quarter of both rings: 2n cells along the inner ring, and 3n (or 2 `outer`) along the outer ring."""
    a, b, c = RADII
    rings = {}
    for name, ends, across in (("inner", (a, b), n), ("outer", (b, c), outer or 3 * n // 2)):
        cells = max(2, round(across * np.log(ends[1] / ends[0])))
        rings[name] = vx.meshes.ring(np.geomspace(*ends, cells + 1), 2 * across, angles=(0.0, np.pi / 2))
    return vx.meshes.bodies(rings, tolerance=b * (np.pi / (4 * n)) ** 2 / 7)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the deformed rings, and the stresses along a radius."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    mirrors = [(-1, 1), (1, -1), (-1, -1)]
    vx.plots.stressed_body(history, ax=body, stress="shear", mirrors=mirrors, units=UNITS)
    x, (xx, yy, xy) = history.mesh.centroids, history.stress(-1).T
    r, (c, s) = np.hypot(*x.T), x.T / np.hypot(*x.T)
    radial, hoop = xx * c**2 + yy * s**2 + 2 * xy * c * s, xx * s**2 + yy * c**2 - 2 * xy * c * s
    cells, line = np.abs(np.arctan2(s, c) - np.pi / 4) < np.pi / 20, np.linspace(RADII[0], RADII[2], 600)
    exact = stresses(line)
    graph.plot(line, exact[0], "C0-", line, exact[1], "C1-")
    graph.plot(r[cells], radial[cells], "C0o", label=r"$\sigma_r$")
    graph.plot(r[cells], hoop[cells], "C1s", label=r"$\sigma_\theta$")
    graph.set(xlabel="radius (mm)", ylabel="stress (MPa)")
    graph.set_title("marks: cells near 45 degrees; lines: Lame 1852", fontsize="small")
    graph.grid()
    graph.legend()
    return figure
