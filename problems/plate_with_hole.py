r"""A pulled plate with a hole: the stress at the rim of the hole is three times the pull.

A large plate with a hole of radius R is under the tension S along x (Kirsch, Z. VDI 42, 1898). Let z = x + iy, let mu
be the shear modulus, and let kappa = (3 - nu) / (1 + nu), as in plane stress. The potentials phi and psi give
displacements (u, v) and stresses (Muskhelishvili 1953):

$$
\phi = \tfrac S4 z + a / z, \qquad \psi = -\tfrac S2 z + b / z + c / z^3, \qquad a = S R^2 / 2,
\qquad b = -S R^2 / 2, \qquad c = S R^4 / 2, \\
2 \mu (u + iv) = \kappa \phi - z \operatorname{conj}(\phi') - \operatorname{conj}(\psi), \\
\sigma_{xx} + \sigma_{yy} = 4 \operatorname{Re} \phi',
\qquad \sigma_{yy} - \sigma_{xx} + 2i \sigma_{xy} = 2 (\operatorname{conj}(z) \phi'' + \psi').
$$

The plate is cut off at r = |z| = 5 R, where the tractions of this solution pull it. Both axes are lines of symmetry,
with rollers. On the y-axis above the hole, sigma_xx = S/2 (2 + R^2/r^2 + 3 R^4/r^4), which is 3 S at the rim r = R. The
rollers on this axis bear the integral of sigma_xx from R to r = 5 R, the force S (r - R^2 / (2 r) - R^4 / (2 r^3)).

    vemcvx run problems/plate_with_hole.py --n 8 --steps 1 --plot
"""

import numpy as np

import vemcvx as vx

RADIUS, REACH, YOUNG, POISSON, PULL = 1.0, 5.0, 100.0, 0.3, 1.0
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 12, "steps": 1}


def complex_potentials(z, a, b, c, pull=PULL):
    """Return phi, phi', phi'', psi and psi' of the plate around a hole or an inclusion."""
    phi = pull / 4 * z + a / z, pull / 4 - a / z**2, 2 * a / z**3
    return *phi, -pull / 2 * z + b / z + c / z**3, -pull / 2 - b / z**2 - 3 * c / z**4


def stresses(z, potentials):
    """Return the stresses xx, yy, xy (m, 3) at the points z (m,)."""
    _, first, second, _, psi = potentials
    mean, rest = 2 * first.real, np.conj(z) * second + psi
    return np.column_stack([mean - rest.real, mean + rest.real, rest.imag])


def displacements(z, potentials, kappa, shear):
    """Return the displacements (m, 2) at the points z (m,)."""
    phi, first, _, psi, _ = potentials
    w = (kappa * phi - z * np.conj(first) - np.conj(psi)) / (2 * shear)
    return np.column_stack([w.real, w.imag])


def kirsch(x):
    """Return displacements (m, 2) and stresses (m, 3) at the points x (m, 2)."""
    z = x[:, 0] + 1j * x[:, 1]
    potentials = complex_potentials(z, PULL * RADIUS**2 / 2, -PULL * RADIUS**2 / 2, PULL * RADIUS**4 / 2)
    kappa, shear = (3 - POISSON) / (1 + POISSON), YOUNG / (2 * (1 + POISSON))
    return displacements(z, potentials, kappa, shear), stresses(z, potentials)


def roller_force():
    """Return the force on the rollers above the hole: the integral of sigma_xx."""
    r = REACH
    return PULL * (r - RADIUS**2 / (2 * r) - RADIUS**4 / (2 * r**3))


def scene():
    def pull(x, t):
        n = x / np.linalg.norm(x, axis=1)[:, None]
        s = t * kirsch(x)[1]
        return np.column_stack([s[:, 0] * n[:, 0] + s[:, 2] * n[:, 1], s[:, 2] * n[:, 0] + s[:, 1] * n[:, 1]])

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON, plane="stress"),
        vx.Symmetry(on=["first", "last"]),
        vx.Traction(pull, on="outer"),
    )


def mesh(n, family="ring"):
    """Return rings of 2n cells; the side "first" is the ray beside the hole, "last" the ray above the hole."""
    rings = max(2, round(4 * n / np.pi * np.log(REACH / RADIUS)))
    return vx.meshes.ring(np.geomspace(RADIUS, REACH, rings + 1), 2 * n, angles=(0.0, np.pi / 2))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the computed quarter with its mirror images, and the stresses along the rollers above the hole."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    window, mirrors = ((-2.6, 2.6), (-2.6, 2.6)), [(-1, 1), (1, -1), (-1, -1)]
    vx.plots.stressed_body(history, ax=body, stress="xx", window=window, mirrors=mirrors, units=UNITS)
    x, sigma = history.mesh.centroids, history.stress(-1)
    above = x[:, 0] < 0.05 * x[:, 1]
    r = np.linspace(RADIUS, REACH, 200)
    exact = kirsch(np.column_stack([0 * r, r]))[1]
    for part, marks, name in ((0, "C0o", "11"), (1, "C1s", "22")):
        graph.plot(r, exact[:, part], "k-", label=None if part else "Kirsch 1898")
        graph.plot(
            np.linalg.norm(x[above], axis=1), sigma[above, part], marks, label=rf"$\sigma_{{{name}}}$ in the cells"
        )
    graph.set(xlabel="height $x_2$ above the middle of the hole (mm)", ylabel="stress / pull", ylim=(-0.2, 3.2))
    graph.set_title("on the line of symmetry above the hole", fontsize="small")
    graph.grid()
    graph.legend()
    return figure
