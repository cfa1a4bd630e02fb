r"""A strip of two metals bends when it is heated (Timoshenko, Analysis of bi-metal thermostats, 1925).

We compute half of a strip of length 2 L; x = 0 is the middle of the strip. The strip has two layers of heights h1
(below) and h2 (above), with Young's moduli E1, E2 and thermal expansions alpha1, alpha2. The temperature of the strip
rises by theta. Sections stay plane, and neither a force nor a moment acts on them. The curvature is

$$
\kappa = 6 E_1 E_2 h_1 h_2 (h_1 + h_2) (\alpha_1 - \alpha_2) \theta \\
\quad / (E_1^2 h_1^4 + 4 E_1 E_2 h_1^3 h_2 + 6 E_1 E_2 h_1^2 h_2^2 + 4 E_1 E_2 h_1 h_2^3 + E_2^2 h_2^4),
$$

and the end deflects by kappa L^2 / 2 relative to the middle. In plane stress this curvature is exact away from the free
end. Within about H = h1 + h2 of this end the stresses differ from beam theory, so the deflection has an error
O((H / L)^2). A soft foundation prevents a vertical translation; its force is zero.

With `--set grain=A` the upper layer is wood with a grain at the angle A (in radians) to the strip. Young's modulus of
the wood is E2 along the grain and E2 / 10 across the grain. The shear modulus is G = E2 / 15. Let c = cos A and
s = sin A. Along the strip, Young's modulus E of the wood follows from
1 / E = c^4 / E2 + (1 / G - 2 nu / E2) c^2 s^2 + 10 s^4 / E2, with Poisson's ratio nu. In the formula of the curvature,
E replaces E2. With an oblique grain, x = 0 is not a plane of symmetry, and the rollers at x = 0 make an error O(H / L).

    vemcvx run problems/bimetallic_strip.py --n 8 --steps 4
"""

import numpy as np

import vemcvx as vx

LENGTH, LOWER, UPPER = 4.0, 0.25, 0.25
YOUNG, POISSON, EXPANSIONS, RISE = (100.0, 200.0), 0.3, (2e-5, 1e-5), 50.0
ACROSS, SHEAR = 10.0, 15.0
"""For wood: E2 / (modulus across the grain), and E2 / G."""
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 24, "steps": 4}


def upper_modulus(grain=None):
    """Return Young's modulus of the upper layer along the strip."""
    if grain is None:
        return YOUNG[1]
    c, s = np.cos(grain), np.sin(grain)
    return YOUNG[1] / (c**4 + (SHEAR - 2 * POISSON) * c**2 * s**2 + ACROSS * s**4)


def curvature(grain=None):
    """Return the curvature of the strip in beam theory."""
    one, two, a, b = YOUNG[0], upper_modulus(grain), LOWER, UPPER
    stiffness = one**2 * a**4 + one * two * (4 * a**3 * b + 6 * a**2 * b**2 + 4 * a * b**3) + two**2 * b**4
    return 6 * one * two * a * b * (a + b) * (EXPANSIONS[0] - EXPANSIONS[1]) * RISE / stiffness


def deflection(grain=None):
    """Return the deflection of the end relative to the middle, upwards if the lower layer expands more."""
    return 0.5 * curvature(grain) * LENGTH**2


def upper_layer(grain):
    if grain is None:
        return vx.Elasticity(young=YOUNG[1], poisson=POISSON, plane="stress", on="upper")
    young, shear = (YOUNG[1], YOUNG[1] / ACROSS), YOUNG[1] / SHEAR
    return vx.Orthotropic(young=young, poisson=POISSON, shear=shear, angle=grain, on="upper")


def scene(grain=None):
    return vx.Scene(
        vx.Elasticity(young=YOUNG[0], poisson=POISSON, plane="stress", on="lower"),
        upper_layer(grain),
        vx.ThermalStrain(expansion="expansion", temperature=lambda x, t: np.full(len(x), RISE * t)),
        vx.Symmetry(on="left"),
        vx.ElasticFoundation(tangential=1e-3 * YOUNG[0], on="left"),
    )


def mesh(n, family="squares"):
    strip = vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, LOWER + UPPER)))
    lower = strip.centroids[:, 1] < LOWER
    strip = strip.with_cell_data("lower", lower).with_cell_data("upper", ~lower)
    return strip.with_cell_data("expansion", np.where(lower, *EXPANSIONS))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the heated strip, and the deflection of the interface beside Timoshenko's parabola."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    body, graph = figure.subplots(2, 1)
    vx.plots.stressed_body(history, ax=body, stress="xx", units=UNITS)
    points, u = history.mesh.points, history.displacement[-1]
    interface = np.flatnonzero(np.abs(points[:, 1] - LOWER) < 1e-9)
    interface = interface[np.argsort(points[interface, 0])]
    x, line = points[interface, 0], np.linspace(0, LENGTH, 200)
    graph.plot(line, curvature() * line**2 / 2, "k-", label="Timoshenko 1925")
    graph.plot(x[::4], (u[interface, 1] - u[interface[0], 1])[::4], "C0o", label="computed")
    graph.set(xlabel="distance from the middle (mm)", ylabel="deflection of the interface (mm)")
    graph.grid()
    graph.legend()
    return figure
