r"""A strip of two metals, heated: it bends (Timoshenko, Analysis of bi-metal thermostats, 1925).

Half of a strip of length 2 L, x = 0 being its middle, of two layers of heights h1 (below) and h2, Young's moduli E1, E2
and expansions alpha1, alpha2, is heated by theta. Sections stay plane and bear neither force nor moment:

$$
\kappa = 6 E_1 E_2 h_1 h_2 (h_1 + h_2) (\alpha_1 - \alpha_2) \theta \\
\quad / (E_1^2 h_1^4 + 4 E_1 E_2 h_1^3 h_2 + 6 E_1 E_2 h_1^2 h_2^2 + 4 E_1 E_2 h_1 h_2^3 + E_2^2 h_2^4),
$$

and the end deflects by kappa L^2 / 2 against the middle, exactly in plane stress away from the free end; within about
one height of it the stresses differ, an error of the order (H / L)^2. Nothing is in contact; a soft foundation holds
the strip in its height, with no force, for the strip is in equilibrium with itself.

With grain=ANGLE the upper layer is wood, E2 along a grain at the angle a (in radians) to the strip, E2 / 10 across it
and G = E2 / 15. Its Young's modulus along the strip, 1 / E = c^4 / E2 + (1 / G - 2 nu / E2) c^2 s^2 + 10 s^4 / E2 with
c = cos a, s = sin a, takes the place of E2 in the formula. (A grain aslant couples shear to the pull, so that
x = 0 is then no plane of symmetry but a row of rollers: an error of the order of H / L.)

    vemcvx run problems/bimetallic_strip.py --n 8 --steps 4
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph

LENGTH, LOWER, UPPER = 4.0, 0.25, 0.25
YOUNG, POISSON, EXPANSIONS, RISE = (100.0, 200.0), 0.3, (2e-5, 1e-5), 50.0
ACROSS, SHEAR = 10.0, 15.0  # of the wood: how many times smaller than E2 are its modulus across the grain, and G
UNITS = MM
SMALL = {"n": 24, "steps": 4}


def upper_modulus(grain=None):
    """Young's modulus of the upper layer along the strip."""
    if grain is None:
        return YOUNG[1]
    c, s = np.cos(grain), np.sin(grain)
    return YOUNG[1] / (c**4 + (SHEAR - 2 * POISSON) * c**2 * s**2 + ACROSS * s**4)


def curvature(grain=None):
    """Of the strip as a beam."""
    one, two, a, b = YOUNG[0], upper_modulus(grain), LOWER, UPPER
    stiffness = one**2 * a**4 + one * two * (4 * a**3 * b + 6 * a**2 * b**2 + 4 * a * b**3) + two**2 * b**4
    return 6 * one * two * a * b * (a + b) * (EXPANSIONS[0] - EXPANSIONS[1]) * RISE / stiffness


def deflection(grain=None):
    """Of the end against the middle, upwards where the lower layer expands more."""
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
    """The heated strip, and the bow of its middle line beside Timoshenko's parabola."""
    figure, graph = body_and_graph(history, stress="xx")
    points, u = history.mesh.points, history.displacement[-1]
    middle = np.abs(points[:, 1] - LOWER) < 1e-9
    order = np.argsort(points[middle, 0])
    x, bow = points[middle, 0][order], u[middle, 1][order]
    line = np.linspace(0, LENGTH, 200)
    beside_closed_form(graph, (x, bow - bow[0]), (line, curvature() * line**2 / 2), exact_label="Timoshenko 1925")
    graph.set(xlabel="distance from the middle (mm)", ylabel="interface moved up by (mm)")
    return figure
