r"""A rubber pad, clamped below and squeezed by a smooth plate: the clamp makes the pad stiff.

We compute half of a pad |x| < a, 0 < y < h in plane strain: x = 0 is a line of symmetry, x = a is free. The rubber has
Lame's constants lambda >> mu. The pad is bonded to its base, u = 0, and a smooth plate presses its top down by d. The
displaced volume must flow out sideways. As in lubrication theory, assume that the horizontal displacement has a
parabolic profile across the thickness. The pressure p of the compressible pad satisfies

$$
p'' = 3 \mu p / (h^2 \lambda) - 3 \mu d / h^3, \qquad p(a) = 0: \\
p = \lambda d / h (1 - \cosh(b x) / \cosh(b a)), \qquad b^2 = 3 \mu / (\lambda h^2)
$$

(Gent and Lindley, Proc. Inst. Mech. Eng. 173, 1959; with compressibility Chalhoub and Kelly, J. Eng. Mech. 117, 1991).
Without the clamp the pressure would be 4 mu d/h. The clamp makes an incompressible pad stiffer by the factor
(a/h)^2 / 4. The formula holds for thin layers and neglects terms of the size of mu d/h. At distances of more than h
from the free edge, the computed -sigma_yy under the plate exceeds p by 2.5 to 3.4 mu d/h (n = 12 and n = 24).

    vemcvx run problems/bonded_pad.py --n 12 --steps 1 --plot
"""

import numpy as np

import vemcvx as vx

HALF_WIDTH, HEIGHT, MU, POISSON, SQUEEZE = 8.0, 1.0, 1.0, 0.499, 0.001
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 12, "steps": 1}


def pressure(x, poisson=POISSON):
    """Return p at the distances x from the middle."""
    lam = 2 * MU * poisson / (1 - 2 * poisson)
    b = np.sqrt(3 * MU / lam) / HEIGHT
    return lam * SQUEEZE / HEIGHT * (1 - np.cosh(b * x) / np.cosh(b * HALF_WIDTH))


def force(poisson=POISSON):
    """Return the integral of p over half of the pad."""
    lam = 2 * MU * poisson / (1 - 2 * poisson)
    b = np.sqrt(3 * MU / lam) / HEIGHT
    return lam * SQUEEZE / HEIGHT * (HALF_WIDTH - np.tanh(b * HALF_WIDTH) / b)


def scene(poisson=POISSON):
    def down(x, t):
        return np.full(len(x), -SQUEEZE * t)

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
    """Draw the pad, which bulges out at its free edge, and the pressure under the plate."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    body, graph = figure.subplots(2, 1)
    vx.plots.stressed_body(history, ax=body, stress="yy", stretch=1.4, units=UNITS)
    centres, sigma = history.mesh.centroids, history.stress(-1)
    under = np.flatnonzero(centres[:, 1] > centres[:, 1].max() - 1e-9)[::2]
    x = np.linspace(0, HALF_WIDTH, 200)
    graph.plot(x, pressure(x), "k-", label="thin layer")
    graph.plot(centres[under, 0], -sigma[under, 1], "C0o", label="in the cells under the plate")
    graph.axhline(4 * MU * SQUEEZE / HEIGHT, color="0.5", linestyle="--", label="without the clamp")
    graph.set(xlabel="distance from the middle (mm)", ylabel="pressure (MPa)", ylim=(0, None))
    graph.grid()
    graph.legend()
    return figure
