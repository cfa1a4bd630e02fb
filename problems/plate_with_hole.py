r"""A plate with a hole, pulled: a quarter of it stands for the whole, and the rim bears three times the pull.

A hole of radius R in a large plate under the pull S along x (Kirsch, Z. VDI 42, 1898). With z = x + iy and kappa = (3
- nu) / (1 + nu) in plane stress (Muskhelishvili 1953),

$$
\phi = \tfrac S4 z + a / z, \qquad \psi = -\tfrac S2 z + b / z + c / z^3, \qquad a = S R^2 / 2,
\qquad b = -S R^2 / 2, \qquad c = S R^4 / 2, \\
2 \mu (u + iv) = \kappa \phi - z \operatorname{conj}(\phi') - \operatorname{conj}(\psi), \\
\sigma_{xx} + \sigma_{yy} = 4 \operatorname{Re} \phi',
\qquad \sigma_{yy} - \sigma_{xx} + 2i \sigma_{xy} = 2 (\operatorname{conj}(z) \phi'' + \psi').
$$

The plate is cut off at r = 5 R, where it is pulled by the stresses of that solution; so both axes are lines of
symmetry. Above the hole, sigma_xx = S/2 (2 + R^2/r^2 + 3 R^4/r^4): 3 S on the rim. What rollers on that line bear is
its integral from R to r, S (r - R^2 / (2 r) - R^4 / (2 r^3)).

    vemcvx run problems/plate_with_hole.py --n 8 --steps 1 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import COMPUTED, SECOND

RADIUS, REACH, YOUNG, POISSON, PULL = 1.0, 5.0, 100.0, 0.3, 1.0
UNITS = MM
SMALL = {"n": 12, "steps": 1}


def complex_potentials(z, a, b, c, pull=PULL):
    """phi, phi', phi'', psi and psi' of the matrix around a hole or an inclusion."""
    phi = pull / 4 * z + a / z, pull / 4 - a / z**2, 2 * a / z**3
    return *phi, -pull / 2 * z + b / z + c / z**3, -pull / 2 - b / z**2 - 3 * c / z**4


def stress_of(z, potentials):
    """(m, 3): xx, yy, xy."""
    _, first, second, _, psi = potentials
    mean, rest = 2 * first.real, np.conj(z) * second + psi
    return np.column_stack([mean - rest.real, mean + rest.real, rest.imag])


def displacement_of(z, potentials, kappa, shear):
    """(m, 2)."""
    phi, first, _, psi, _ = potentials
    w = (kappa * phi - z * np.conj(first) - np.conj(psi)) / (2 * shear)
    return np.column_stack([w.real, w.imag])


def kirsch(x):
    """Displacements (m, 2) and stresses (m, 3) at the points x (m, 2)."""
    z = x[:, 0] + 1j * x[:, 1]
    potentials = complex_potentials(z, PULL * RADIUS**2 / 2, -PULL * RADIUS**2 / 2, PULL * RADIUS**4 / 2)
    kappa, shear = (3 - POISSON) / (1 + POISSON), YOUNG / (2 * (1 + POISSON))
    return displacement_of(z, potentials, kappa, shear), stress_of(z, potentials)


def roller_force():
    """The integral of sigma_xx over the line above the hole."""
    r = REACH
    return PULL * (r - RADIUS**2 / (2 * r) - RADIUS**4 / (2 * r**3))


def scene():
    def pull(x, t):
        n = x / np.linalg.norm(x, axis=1)[:, None]
        s = t * kirsch(x)[1]
        return np.column_stack([s[:, 0] * n[:, 0] + s[:, 2] * n[:, 1], s[:, 2] * n[:, 0] + s[:, 1] * n[:, 1]])

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON, plane="stress"),
        vx.Symmetry(on=["above", "beside"]),
        vx.Traction(pull, on="outer"),
    )


def polar(radii, angles, centre=False):
    """Quadrilaterals between circles and rays; whole turns close, and `centre` adds a polygon in the middle."""
    turns = np.isclose(angles[-1] - angles[0], 2 * np.pi)
    used = angles[:-1] if turns else angles
    k = len(used)
    points = (radii[:, None, None] * np.column_stack([np.cos(used), np.sin(used)])).reshape(-1, 2)
    points[np.abs(points) < 1e-15 * radii[-1]] = 0.0
    this = np.arange(k if turns else k - 1)
    ring = np.column_stack([this, this + k, (this + 1) % k + k, (this + 1) % k])
    cells = [list(ring[i] + k * r) for r in range(len(radii) - 1) for i in range(len(ring))]
    made = vx.PolygonMesh(points, [list(range(k)), *cells] if centre else cells)
    middle = 0.5 * (radii[0] + radii[-1])
    size = radii[-1] * (1 - np.cos(0.5 * (angles[1] - angles[0]))) + 1e-9
    made = made.with_boundary("outer", lambda p: np.linalg.norm(p, axis=1) > radii[-1] - 1.5 * size)
    if not centre:
        sharp = radii[0] * np.cos(0.5 * (angles[1] - angles[0])) * (1 + 1e-9)
        made = made.with_boundary("inner", lambda p: np.linalg.norm(p, axis=1) < sharp)
    if not turns and middle:
        made = made.with_boundary("beside", lambda p: np.abs(p[:, 1]) < 1e-9 * middle)
        made = made.with_boundary("above", lambda p: np.abs(p[:, 0]) < 1e-9 * middle)
    return made


def mesh(n, family="polar"):
    """Rings that grow from R pi / 4n on the rim, as their cells do."""
    rings = max(2, round(4 * n / np.pi * np.log(REACH / RADIUS)))
    return polar(np.geomspace(RADIUS, REACH, rings + 1), np.linspace(0, np.pi / 2, 2 * n + 1))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The quarter that was computed, its mirror images, and the stresses along the rollers above the hole."""
    window, mirrors = ((-2.6, 2.6), (-2.6, 2.6)), [(-1, 1), (1, -1), (-1, -1)]
    figure, graph = body_and_graph(history, stress="xx", window=window, mirrors=mirrors)
    x, sigma = history.mesh.centroids, history.stress(-1)
    first = x[:, 0] < 0.05 * x[:, 1]
    r = np.linspace(RADIUS, REACH, 200)
    exact = kirsch(np.column_stack([0 * r, r]))[1]
    for part, colour, name in ((0, COMPUTED, "11"), (1, SECOND, "22")):
        beside_closed_form(
            graph,
            (np.linalg.norm(x[first], axis=1), sigma[first, part]),
            (r, exact[:, part]),
            colour=colour,
            label=rf"$\sigma_{{{name}}}$ in the cells",
            exact_label="Kirsch 1898" if part == 0 else None,
        )
    graph.set(xlabel="height $x_2$ above the middle of the hole (mm)", ylabel="stress / pull", ylim=(-0.2, 3.2))
    graph.set_title("on the line of symmetry above the hole", fontsize="small")
    return figure
