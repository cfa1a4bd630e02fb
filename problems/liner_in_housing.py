r"""A tube under pressure in a rigid housing: it widens, closes the gap, and presses on the housing.

A quarter of a thick tube a < r < b is computed in plane strain. The pressure p(t) acts inside, and a rigid housing
surrounds the tube at the distance `gap`. Let q be the pressure between tube and housing. Then (Lame 1852)

$$
\sigma_r = A - B / r^2, \qquad \sigma_\theta = A + B / r^2, \qquad u_r = (1 + \nu) / E ((1 - 2 \nu) A r + B / r), \\
A = (p a^2 - q b^2) / (b^2 - a^2), \qquad B = (p - q) a^2 b^2 / (b^2 - a^2).
$$

Until u_r(b) reaches the gap, q is zero. From then on u_r(b) = gap, and q grows in proportion to the further increase of
p. On a mesh the circles are polygons, which makes an error O(h^2).

    vemcvx run problems/liner_in_housing.py --n 8 --steps 10 --plot
"""

import numpy as np

import vemcvx as vx

INNER, OUTER, YOUNG, POISSON, GAP, PRESSURE = 1.0, 1.8, 100.0, 0.3, 0.01, 3.0
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 10, "steps": 10}


def lame_constants(p, q):
    """Return A and B under the pressures p and q."""
    a2, b2 = INNER**2, OUTER**2
    return (p * a2 - q * b2) / (b2 - a2), (p - q) * a2 * b2 / (b2 - a2)


def radial_displacement(r, p, q):
    """Return u_r at the radius r."""
    A, B = lame_constants(p, q)
    return (1 + POISSON) / YOUNG * ((1 - 2 * POISSON) * A * r + B / r)


def contact_pressure(p, gap=GAP):
    """Return q under the pressure p: zero while the gap is open, then the pressure with which u_r(b) = gap."""
    return np.maximum((gap - radial_displacement(OUTER, p, 0.0)) / radial_displacement(OUTER, 0.0, 1.0), 0.0)


def closing_pressure(gap=GAP):
    return gap / radial_displacement(OUTER, 1.0, 0.0)


def scene(gap=GAP, pressure=PRESSURE):
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.Symmetry(on=["first", "last"]),
        vx.Pressure(lambda x, t: np.full(len(x), pressure * t), on="inner"),
        vx.UnilateralContact(on="outer", gap=gap),
    )


def mesh(n, family="ring"):
    return vx.meshes.ring(np.linspace(INNER, OUTER, n + 1), 2 * n, angles=(0.0, np.pi / 2))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the tube that presses on its housing, and the pressure on the housing against the pressure inside."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    mirrors = [(-1, 1), (1, -1), (-1, -1)]
    vx.plots.stressed_body(history, ax=body, stress="shear", mirrors=mirrors, units=UNITS)
    line = np.linspace(0, PRESSURE, 200)
    graph.plot(line, contact_pressure(line), "k-", label="Lame 1852")
    graph.plot(PRESSURE * history.times, history.contact.pressure.mean(axis=1), "C0o", label="computed")
    graph.axvline(closing_pressure(), color="0.6", linestyle=":")
    graph.text(closing_pressure() - 0.05, 1.0, "the gap closes", rotation=90, ha="right", va="center", color="0.4")
    graph.set(xlabel="pressure inside (MPa)", ylabel="pressure on the housing (MPa)")
    graph.grid()
    graph.legend()
    return figure
