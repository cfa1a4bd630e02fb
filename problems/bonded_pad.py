r"""A rubber pad, clamped below and squeezed by a smooth plate: what cannot flow out presses back.

Half of a pad |x| < a, 0 < y < h (x = 0 is a line of symmetry, x = a is free), nearly incompressible, plane strain. It
is bonded to its base, u = 0, and a smooth plate presses its top down by d. What the plate displaces must flow out
past the clamp: lubrication's parabola across the thickness, with the volume that compression saves, gives the
pressure

$$
p'' = 3 \mu p / (h^2 \lambda) - 3 \mu d / h^3, \qquad p(a) = 0: \\
p = \lambda d / h (1 - \cosh(b x) / \cosh(b a)), \qquad b^2 = 3 \mu / (\lambda h^2),
$$

(Gent and Lindley, Proc. Inst. Mech. Eng. 173, 1959; with compressibility Chalhoub and Kelly, J. Eng. Mech. 117, 1991;
one side bonded: the pressure of a pad of twice the height between two clamps). A free pad would bear 4 mu d/h: the
clamp makes it (a/h)^2 / 4 times as stiff, until its volume gives way. The thin layer is a model: under the plate
-sigma_yy is p + 3/2 mu d/h, and the free edge, where the mean of sigma_xx vanishes and not p, adds up to 3 mu d/h
more.

    vemcvx run problems/bonded_pad.py --n 12 --steps 1 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph

HALF_WIDTH, HEIGHT, MU, POISSON, PRESSED = 8.0, 1.0, 1.0, 0.499, 0.001
UNITS = MM
SMALL = {"n": 12, "steps": 1}


def pressure(x, poisson=POISSON):
    """Of the plate on the pad."""
    lam = 2 * MU * poisson / (1 - 2 * poisson)
    b = np.sqrt(3 * MU / lam) / HEIGHT
    return lam * PRESSED / HEIGHT * (1 - np.cosh(b * x) / np.cosh(b * HALF_WIDTH))


def force(poisson=POISSON):
    """Of the plate on half of the pad."""
    lam = 2 * MU * poisson / (1 - 2 * poisson)
    b = np.sqrt(3 * MU / lam) / HEIGHT
    return lam * PRESSED / HEIGHT * (HALF_WIDTH - np.tanh(b * HALF_WIDTH) / b)


def scene(poisson=POISSON):
    def down(x, t):
        return np.full(len(x), -PRESSED * t)

    return vx.Scene(
        vx.Elasticity(young=2 * MU * (1 + poisson), poisson=poisson),
        vx.Clamp(on="bottom"),
        vx.PrescribedDisplacement(down, on="top", direction="normal"),
        vx.Symmetry(on="left"),
    )


def mesh(n, family="squares"):
    return vx.meshes.FAMILIES[family](n, box=((0, HALF_WIDTH), (0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The pad bulging out of its gap, and the pressure under the plate."""
    figure, graph = body_and_graph(history, stress="yy", stretch=1.4)
    centres, sigma = history.mesh.centroids, history.stress(-1)
    under = centres[:, 1] > centres[:, 1].max() - 1e-9
    x = np.linspace(0, HALF_WIDTH, 200)
    marks = (centres[under, 0], -sigma[under, 1])
    beside_closed_form(graph, marks, (x, pressure(x)), label="in the cells under the plate", exact_label="thin layer")
    free = 4 * MU * PRESSED / HEIGHT
    graph.axhline(free, color="0.5", linestyle="--", linewidth=1.2, label="without the clamp")
    graph.legend(frameon=False, fontsize="small")
    graph.set(xlabel="distance from the middle (mm)", ylabel="pressure (MPa)", ylim=(0, None))
    return figure
