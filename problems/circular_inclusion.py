r"""A round fibre in a softer matrix: two materials, and a stress that is the same everywhere inside the fibre.

A large plate (plane strain, E1, nu1) with a bonded round inclusion of radius R (E2, nu2) is pulled by S along x. With
kappa = 3 - 4 nu and m = mu2 / mu1, outside it is the field of :mod:`plate_with_hole` with

$$
a = S R^2 / 2 (1 - m) / (1 + m \kappa_1), \qquad b = R^2 (2 d - S / 2), \qquad c = a R^2, \\
d = m S (\kappa_1 + 1) / (4 (\kappa_2 - 1 + 2 m)),
$$

and inside sigma_xx + sigma_yy = 4 d, sigma_yy - sigma_xx = -S m (1 + kappa1) / (1 + m kappa1), sigma_xy = 0, at every
point (Goodier, Trans. ASME 55, 1933; Eshelby 1957 for all ellipses; m = 0 is Kirsch's hole). The mesh ends at r = 4
R, where the displacement of that solution is given. The middle of the fibre is one polygon of many sides.

    vemcvx run problems/circular_inclusion.py --n 6 --steps 1 --plot
"""

import numpy as np

import vemcvx as vx
from plate_with_hole import complex_potentials, displacement_of, polar, stress_of
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import COMPUTED, SECOND

RADIUS, REACH, PULL = 1.0, 4.0, 1.0
MATRIX, FIBRE = (1000.0, 0.3), (10000.0, 0.2)
UNITS = MM
SMALL = {"n": 12, "steps": 1}


def constants(fibre=FIBRE):
    """a, b, c, and the uniform stress (3,) inside."""
    mu1, mu2 = (E / (2 * (1 + nu)) for E, nu in (MATRIX, fibre))
    kappa1, kappa2 = 3 - 4 * MATRIX[1], 3 - 4 * fibre[1]
    m = mu2 / mu1
    d = m * PULL * (kappa1 + 1) / (4 * (kappa2 - 1 + 2 * m))
    e = -PULL / 2 * m * (1 + kappa1) / (1 + m * kappa1)
    a = PULL * RADIUS**2 / 2 * (1 - m) / (1 + m * kappa1)
    return a, RADIUS**2 * (2 * d - PULL / 2), a * RADIUS**2, np.array([2 * d - e, 2 * d + e, 0.0])


def outside(x, fibre=FIBRE):
    """Displacements (m, 2) and stresses (m, 3) in the matrix at the points x (m, 2)."""
    z, (E, nu) = x[:, 0] + 1j * x[:, 1], MATRIX
    potentials = complex_potentials(z, *constants(fibre)[:3], pull=PULL)
    return displacement_of(z, potentials, 3 - 4 * nu, E / (2 * (1 + nu))), stress_of(z, potentials)


def scene(fibre_young=FIBRE[0], fibre_poisson=FIBRE[1]):
    fibre = fibre_young, fibre_poisson
    return vx.Scene(
        vx.Elasticity(*MATRIX, on="matrix"),
        vx.Elasticity(*fibre, on="fibre"),
        vx.PrescribedDisplacement(lambda x, t: t * outside(x, fibre)[0], on="outer"),
    )


def mesh(n, family="polar"):
    """4 n rays; circles at distances like theirs, one of them the interface."""
    ratio = np.exp(np.pi / (2 * n))
    inside = np.linspace(0.25, 1.0, max(2, round(0.75 * n * 2 / np.pi)) + 1) * RADIUS
    beyond = np.geomspace(RADIUS, REACH, max(2, round(np.log(REACH / RADIUS) / np.log(ratio))) + 1)
    made = polar(np.concatenate([inside, beyond[1:]]), np.linspace(0, 2 * np.pi, 4 * n + 1), centre=True)
    fibre = np.linalg.norm(made.centroids, axis=1) < RADIUS * np.cos(np.pi / (4 * n))
    return made.with_cell_data("fibre", fibre).with_cell_data("matrix", ~fibre)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The fibre in its matrix, and the stress along the line through both."""
    window = ((-2.5, 2.5), (-2.5, 2.5))
    figure, graph = body_and_graph(history, stress="xx", window=window)
    x, sigma = history.mesh.centroids, history.stress(-1)
    place = np.angle(x[:, 0] + 1j * x[:, 1]) * 180 / np.pi
    fibre = history.mesh.cell_data["fibre"] != 0
    near = (np.abs(place) < 10) & (x[:, 0] > 0)
    row = near & (np.abs(place - place[near & ~fibre].min(where=place[near & ~fibre] > 0, initial=90)) < 1e-6)
    ray = np.deg2rad(place[row][0])
    r = np.linspace(RADIUS, REACH, 200)
    exact = outside(np.column_stack([r * np.cos(ray), r * np.sin(ray)]))[1]
    inside = constants()[3]
    far = np.linalg.norm(x[row], axis=1)
    for part, colour, name in ((0, COMPUTED, "11"), (1, SECOND, "22")):
        line = np.append([inside[part]] * 2, exact[:, part])
        label = rf"$\sigma_{{{name}}}$ in the cells"
        marks, known = (far, sigma[row, part]), (np.append([0.0, RADIUS], r), line)
        words = "Goodier 1933" if part == 0 else None
        beside_closed_form(graph, marks, known, colour=colour, label=label, exact_label=words)
    graph.set(xlabel="distance from the middle of the fibre (mm)", ylabel="stress / pull", xlim=(0, REACH))
    graph.set_title("along a ray in the direction of the pull", fontsize="small")
    return figure
