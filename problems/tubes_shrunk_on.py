r"""A tube shrunk on another tube, in space and without friction: the pressure between the tubes is Lame's.

Two tubes a < r < b and b < r < c have the length L; a quarter of the section is computed. The outer radius of the inner
tube exceeds the inner radius of the outer tube by the interference delta, which is modelled as the gap -delta t. The
bottom z = 0 is a plane of symmetry, the upper ends are free and the joint has no friction. So both tubes are in plane
stress. Radial and hoop stresses are the same as in `press_fit.py` (Lame 1852; Timoshenko and Goodier, *Theory of
Elasticity*, article 28). With E and nu of each tube and the pressure p, the axial strains are

$$
e_z = -\nu(\sigma_r + \sigma_\theta) / E, \qquad \sigma_r + \sigma_\theta = -2 p b^2 / (b^2 - a^2)
\text{ (inner tube)}, \qquad 2 p b^2 / (c^2 - b^2) \text{ (outer tube)}.
$$

The inner tube becomes longer and the outer tube shorter: they slide on each other by z times the difference of their
strains e_z. Both tubes have 3n sectors in the quarter, so they approximate the circle r = b by the same polygon. The
layers of the tubes do not match: n/2 in the inner tube, 3n/4 in the outer tube. With n = 8 the mean pressure agrees
with Lame's within .6 %. Nodal pressures have errors O(h) and scatter by 4 %; the recovered pressures
(`contact.pressure_recovered`) scatter by 1 %.

    vemcvx run problems/tubes_shrunk_on.py --n 8 --steps 2 --accuracy 1e-7 --plot
"""

import numpy as np

import vemcvx as vx

RADII, YOUNG, POISSON, INTERFERENCE = (1.0, 1.6, 2.4), (200.0, 70.0), (0.3, 0.33), 0.004
LENGTH, JOINT = 0.8, "inner|outer"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 2, "accuracy": 1e-7}


def pressure():
    """Return Lame's pressure p for the interference delta."""
    a, b, c = RADII
    inner = ((b**2 + a**2) / (b**2 - a**2) - POISSON[0]) / YOUNG[0]
    outer = ((c**2 + b**2) / (c**2 - b**2) + POISSON[1]) / YOUNG[1]
    return INTERFERENCE / (b * (inner + outer))


def stresses(r):
    """Return radial and hoop stress at the radii r."""
    a, b, c = RADII
    mean = pressure() * b**2 * np.where(r < b, -1 / (b**2 - a**2), 1 / (c**2 - b**2))
    deviation = mean * np.where(r < b, a, c) ** 2 / r**2
    return mean - deviation, mean + deviation


def axial_strains():
    """Return the strains e_z of the inner and the outer tube."""
    a, b, c = RADII
    sums = -2 * pressure() * b**2 / (b**2 - a**2), 2 * pressure() * b**2 / (c**2 - b**2)
    return tuple(-nu * both / young for nu, both, young in zip(POISSON, sums, YOUNG, strict=True))


def scene(interference=INTERFERENCE):
    walls = [f"{tube}.{side}" for tube in ("inner", "outer") for side in ("first", "last", "bottom")]
    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON[0], on="inner"),
        vx.Elasticity(YOUNG[1], POISSON[1], on="outer"),
        vx.Symmetry(on=walls),
        vx.UnilateralContact(on=JOINT, gap=lambda x, t: np.full(len(x), -interference * t)),
    )


def mesh(n, family="ring"):
    """Return hexahedra in 3n sectors, with n/2 layers in the inner tube and 3n/4 layers in the outer tube."""
    tubes, layers = {}, max(1, n // 2)
    for name, ends, high in (("inner", RADII[:2], layers), ("outer", RADII[1:], 3 * layers // 2)):
        rings = max(2, round(6 * n * np.log(ends[1] / ends[0]) / np.pi))
        flat = vx.meshes.ring(np.geomspace(*ends, rings + 1), 3 * n, angles=(0.0, np.pi / 2))
        tubes[name] = flat.extruded(np.linspace(0.0, LENGTH, high + 1))
    return vx.meshes.bodies(tubes)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def mean_pressure(history):
    """Return the mean pressure on the joint at every step."""
    contact = history.contact
    return contact.pressure @ contact.lengths / contact.lengths.sum()


def picture(history):
    """Draw the tubes, and the radial and hoop stresses along the radius."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.2, 3.3), layout="constrained")
    body, graph = figure.subplots(1, 2)
    vx.plots.deformed_body(history, ax=body, stress="von_mises", units=UNITS)
    x, sigma = history.mesh.centroids[:, :2].T, history.stress(-1)
    r, (c, s) = np.hypot(*x), x / np.hypot(*x)
    xx, yy, xy = sigma[:, [0, 1, 3]].T
    radial, hoop = xx * c**2 + yy * s**2 + 2 * xy * c * s, xx * s**2 + yy * c**2 - 2 * xy * c * s
    cells, line = np.abs(np.arctan2(s, c) - np.pi / 4) < np.pi / 16, np.linspace(RADII[0], RADII[2], 600)
    exact = stresses(line)
    graph.plot(line, exact[0], "C0-", line, exact[1], "C1-")
    graph.plot(r[cells], radial[cells], "C0o", label=r"$\sigma_r$")
    graph.plot(r[cells], hoop[cells], "C1s", label=r"$\sigma_\theta$")
    graph.set(xlabel="radius (mm)", ylabel="stress (MPa)")
    graph.set_title("marks: cells near 45 degrees; lines: Lame 1852", fontsize="small")
    graph.grid()
    graph.legend()
    return figure
