r"""A round fibre in a softer matrix: two materials, and a uniform stress inside the fibre.

A round fibre of the radius R with the constants E2, nu2 is bonded into a large plate with the constants E1, nu1. The
plate is in plane strain, under the tension S along x. Let m = mu2 / mu1 be the ratio of shear moduli,
kappa1 = 3 - 4 nu1 and kappa2 = 3 - 4 nu2. The solution in the matrix has the potentials of `plate_with_hole.py`, with
the constants

$$
d = \frac{m S (\kappa_1 + 1)}{4 (\kappa_2 - 1 + 2 m)}, \qquad a = \frac{S R^2 (1 - m)}{2 (1 + m \kappa_1)}, \qquad
b = R^2 (2 d - S / 2), \qquad c = a R^2 .
$$

At every point of the fibre sigma_xx + sigma_yy = 4 d, sigma_yy - sigma_xx = -S m (1 + kappa1) / (1 + m kappa1) and
sigma_xy = 0 (Goodier, Trans. ASME 55, 1933). The mesh ends at r = 4 R, where the displacement of this solution is
prescribed. The middle of the fibre is one polygon of 4n sides.

    vemcvx run problems/circular_inclusion.py --n 6 --steps 1 --plot
"""

import numpy as np

import vemcvx as vx

RADIUS, REACH, PULL = 1.0, 4.0, 1.0
MATRIX, FIBRE = (1000.0, 0.3), (10000.0, 0.2)
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 12, "steps": 1}


def constants(fibre=FIBRE):
    """Return a, b, c, and the uniform stresses xx, yy, xy of the fibre."""
    mu1, mu2 = (E / (2 * (1 + nu)) for E, nu in (MATRIX, fibre))
    kappa1, kappa2 = 3 - 4 * MATRIX[1], 3 - 4 * fibre[1]
    m = mu2 / mu1
    d = m * PULL * (kappa1 + 1) / (4 * (kappa2 - 1 + 2 * m))
    e = -PULL / 2 * m * (1 + kappa1) / (1 + m * kappa1)
    a = PULL * RADIUS**2 / 2 * (1 - m) / (1 + m * kappa1)
    return a, RADIUS**2 * (2 * d - PULL / 2), a * RADIUS**2, np.array([2 * d - e, 2 * d + e, 0.0])


def outside(x, fibre=FIBRE):
    """Return displacements and stresses in the matrix at the points x, one row per point."""
    (a, b, c, _), z, (E, nu) = constants(fibre), x[:, 0] + 1j * x[:, 1], MATRIX
    phi, first, second = PULL / 4 * z + a / z, PULL / 4 - a / z**2, 2 * a / z**3
    psi, slope = -PULL / 2 * z + b / z + c / z**3, -PULL / 2 - b / z**2 - 3 * c / z**4
    w = ((3 - 4 * nu) * phi - z * np.conj(first) - np.conj(psi)) * (1 + nu) / E
    mean, rest = 2 * first.real, np.conj(z) * second + slope
    return np.column_stack([w.real, w.imag]), np.column_stack([mean - rest.real, mean + rest.real, rest.imag])


def scene(fibre_young=FIBRE[0], fibre_poisson=FIBRE[1]):
    fibre = fibre_young, fibre_poisson
    return vx.Scene(
        vx.Elasticity(*MATRIX, on="matrix"),
        vx.Elasticity(*fibre, on="fibre"),
        vx.PrescribedDisplacement(lambda x, t: t * outside(x, fibre)[0], on="outer"),
    )


def mesh(n, family="ring"):
    """Return a polygon of 4n sides inside rings of 4n cells; a circle between two rings is the interface."""
    ratio = np.exp(np.pi / (2 * n))
    inside = np.linspace(0.25, 1.0, max(2, round(0.75 * n * 2 / np.pi)) + 1) * RADIUS
    beyond = np.geomspace(RADIUS, REACH, max(2, round(np.log(REACH / RADIUS) / np.log(ratio))) + 1)
    ring = vx.meshes.ring(np.concatenate([inside, beyond[1:]]), 4 * n)
    cells, outer = [np.arange(4 * n), *ring.cells], ring.boundaries["outer"]
    disc = vx.PolygonMesh(ring.points, cells, boundaries={"outer": outer})
    fibre = np.linalg.norm(disc.centroids, axis=1) < RADIUS * np.cos(np.pi / (4 * n))
    return disc.with_cell_data("fibre", fibre).with_cell_data("matrix", ~fibre)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the fibre in its matrix, and the stresses along a line through fibre and matrix."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    vx.plots.stressed_body(history, ax=body, stress="xx", window=((-2.5, 2.5), (-2.5, 2.5)), units=UNITS)
    x, sigma = history.mesh.centroids, history.stress(-1)
    angle, far = np.arctan2(x[:, 1], x[:, 0]), np.linalg.norm(x, axis=1)
    ray = angle[(angle > 1e-6) & (far > RADIUS)].min()  # direction of the first row of cells
    row = np.abs(angle - ray) < 1e-6
    r, inside = np.linspace(RADIUS, REACH, 200), constants()[3]
    exact = outside(np.column_stack([r * np.cos(ray), r * np.sin(ray)]))[1]
    for part, marks, name in ((0, "C0o", "11"), (1, "C1s", "22")):
        line = [inside[part], inside[part], *exact[:, part]]
        graph.plot([0.0, RADIUS, *r], line, "k-", label=None if part else "Goodier 1933")
        graph.plot(far[row], sigma[row, part], marks, label=rf"$\sigma_{{{name}}}$ in the cells")
    graph.set(xlabel="distance from the middle of the fibre (mm)", ylabel="stress / pull", xlim=(0, REACH))
    graph.set_title("along a ray in the direction of the pull", fontsize="small")
    graph.grid()
    graph.legend()
    return figure
