r"""A rigid sphere pressed on an elastic half space: Hertz' contact as a body of revolution.

The half space is a body of revolution: x_1 is the distance r from the axis, x_2 the axial coordinate, and all forces
are integrals over the full turn. Near the contact the sphere of radius R is a paraboloid: the gap is r^2 / 2R, and
decreases by the approach delta. There is no friction. Under the force P the contact has the radius a and the pressure
p(r) with the peak p_0:

$$
E^* = E / (1 - \nu^2), \qquad a^3 = 3 P R / (4 E^*), \qquad p(r) = p_0 \sqrt{1 - r^2/a^2},
\qquad p_0 = 3 P / (2 \pi a^2), \\
\sigma_z / p_0 = -(1 + \zeta^2)^{-1}, \qquad
\sigma_r / p_0 = \sigma_\theta / p_0 = -(1 + \nu) (1 - \zeta \arctan(1/\zeta)) + (1 + \zeta^2)^{-1} / 2.
$$

The stresses are given on the axis, at the depth zeta a (Johnson, *Contact Mechanics*, 3.4 and 4.2).

A cylinder of radius and height 24 a replaces the half space. The cylinder is clamped at its bottom and free at its
side. It is stiffer than the half space: its approach is 2.3 % smaller than Hertz' a^2 / R under the same force.
Therefore the approach is prescribed, P is computed, and radius and pressure are compared with Hertz' formulas for this
P. With cylinders half or twice as large, radius and peak change by at most .1 %.

Cells are squares that are halved five times towards the contact, with hanging nodes. At the contact the side of a cell
is 3 a / (4 n). The radius a is computed from the mean of r^2, weighted by the contact forces: this mean is 2/5 a^2 in
Hertz' model. The peak is the largest nodal pressure. With n = 16 (1321 cells) radius and peak agree with Hertz within
.6 %. Stresses on the axis differ from the closed form by at most 1 % of p_0.

    vemcvx run problems/sphere_on_half_space.py --n 16 --steps 4 --plot
"""

import numpy as np

import vemcvx as vx

RADIUS, YOUNG, POISSON, CONTACT = 5.0, 1000.0, 0.3, 0.1
"""CONTACT is the approximate radius of the contact."""
EFFECTIVE = YOUNG / (1 - POISSON**2)
REACH, HALVINGS = 24 * CONTACT, 5
APPROACH = CONTACT**2 / RADIUS
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 16, "steps": 4}


def hertz(force):
    """Return the radius of the contact and the peak pressure under the force P."""
    a = np.cbrt(3 * force * RADIUS / (4 * EFFECTIVE))
    return a, 3 * force / (2 * np.pi * a**2)


def stresses_on_axis(depth, force):
    """Return axial and radial stresses on the axis at the depths `depth`."""
    a, peak = hertz(force)
    zeta = np.maximum(depth / a, 1e-12)
    axial = -peak / (1 + zeta**2)
    return axial, -peak * (1 + POISSON) * (1 - zeta * np.arctan(1 / zeta)) - axial / 2


def scene(approach=APPROACH):
    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON, plane="axisymmetric"),
        vx.Clamp(on="bottom"),
        vx.UnilateralContact(on="sole", gap=lambda x, t: x[:, 0] ** 2 / (2 * RADIUS) - approach * t),
    )


def mesh(n, family="squares"):
    """Return n x n squares, halved five times towards the contact; "sole" is the top near the sphere."""
    half_space = vx.meshes.FAMILIES[family](n, box=((0.0, REACH), (-REACH, 0.0)))
    for size in REACH / 2.0 ** np.arange(1, HALVINGS + 1):
        half_space = half_space.refine(np.linalg.norm(half_space.centroids, axis=1) < size * 1.2)
    return half_space.with_boundary("sole", lambda x: (x[:, 1] > -1e-9) & (x[:, 0] < 1.5 * CONTACT))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def force(history):
    """Return P at every step."""
    return history.contact.pressure @ history.contact.lengths


def measure_contact(history, step=-1):
    """Return the radius of the contact and the largest pressure."""
    contact = history.contact
    forces = contact.pressure[step] * contact.lengths
    return np.sqrt(2.5 * forces @ contact.points[:, 0] ** 2 / forces.sum()), contact.pressure[step].max()


def stresses_near_axis(history):
    """Return the depths of the cells at the axis, and rows of their axial, radial and hoop stresses."""
    r, z = history.mesh.centroids.T
    near = (r**2 < history.mesh.areas) & (z > -3 * CONTACT)
    stress, hoop = history.stress(-1)[near], history.out_of_plane_stress(-1)[near]
    return -z[near], np.column_stack([stress[:, 1], stress[:, 0], hoop])


def picture(history):
    """Draw the body near the contact, and pressure against radius and stresses against depth, beside closed forms."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    reach = 2 * CONTACT
    window = ((-reach, reach), (-reach, 0.1 * reach))
    vx.plots.stressed_body(history, ax=body, stress="shear", window=window, mirrors=[(-1, 1)], units=UNITS)
    contact, P = history.contact, force(history)[-1]
    (a, peak), line = hertz(P), np.linspace(0.0, reach, 401)
    depth, stress = stresses_near_axis(history)
    axial, radial = stresses_on_axis(line, P)
    graph.plot(
        line, peak * np.sqrt(np.maximum(1 - (line / a) ** 2, 0)), "C0-", line, -axial, "C1-", line, -radial, "C2-"
    )
    graph.plot(contact.points[:, 0], contact.pressure[-1], "C0o", label="pressure over $r$")
    graph.plot(depth, -stress[:, 0], "C1s", label=r"$-\sigma_z$ over the depth, $r = 0$")
    graph.plot(depth, -stress[:, 2], "C2^", label=r"$-\sigma_\theta$ over the depth, $r = 0$")
    graph.set(xlabel="radius $r$, depth (mm)", ylabel="pressure (MPa)", xlim=(0, reach))
    graph.set_title("marks: computed; lines: Hertz 1882", fontsize="small")
    graph.grid()
    graph.legend()
    return figure
