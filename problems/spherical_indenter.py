r"""A sphere pressed into an elastic block, and dragged: Hertz' point contact, and partial slip by Cattaneo and Mindlin.

A rigid sphere of radius R lies below the block, with the gap (x_1^2 + x_2^2) / 2R. Under the force P, the radius a of
the contact and the pressure p(r) are

$$ a^3 = 3 P R (1 - \nu^2) / (4 E), \qquad p(r) = p_0 \sqrt{1-r^2/a^2}, \qquad p_0 = 3 P / (2 \pi a^2) $$

(Johnson, *Contact Mechanics*, 4.2). Then a tangential force Q < mu P acts, where mu is the coefficient of Coulomb
friction. For nu = 1/2, nodes stick in r < c with c / a = (1 - Q / (mu P))^(1/3), and the friction is

$$ |\text{traction}| = \mu p_0 (\sqrt{1-r^2/a^2} - \tfrac ca \sqrt{1-r^2/c^2}), $$

where the second root is replaced by 0 for r > c (Johnson, 7.2). Here nu = .45. The closed form neglects the small slip
at right angles to Q. The block extends 6 a to all sides. Unlike a half-space, the pressed block widens, so that contact
nodes move sideways. Friction therefore acts only from t = 1 on, when the block has been pressed. One half of the block
is computed. At the contact, cells are a/n wide and high; their widths and heights grow away from the contact. The top
is pressed down and then dragged without rotation; P and Q are computed.

With n = 8 the radius a is 3 % smaller, and the pressure p_0 is 4 % larger, than Hertz' values. If the cells near the
contact are cubes (`quarter`), both agree within 2 %. In r < c / 2, friction is 4 to 7 % below the closed form. The
computed c is .94 of the closed form.

    vemcvx run problems/spherical_indenter.py --n 8 --steps 8 --plot
"""

import numpy as np

import vemcvx as vx

RADIUS, YOUNG, POISSON, FRICTION = 1.0, 1000.0, 0.45, 0.4
CONTACT = 0.05
"""Approximate radius of the contact."""
REACH = 6 * CONTACT
DOWNWARD_GROWTH = 1.4
"""Growth factor of the heights of cells away from the contact."""
PRESS, DRAG = 2.05e-3, 5e-4
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 4, "accuracy": 1e-6}


def hertz(force):
    """Return the radius of the contact and the peak pressure under the force P."""
    a = np.cbrt(3 * force * RADIUS * (1 - POISSON**2) / (4 * YOUNG))
    return a, 3 * force / (2 * np.pi * a**2)


def scene(friction=FRICTION, press=PRESS, drag=DRAG):
    def move_top(x, t):
        return np.tile([drag * max(t - 1.0, 0.0), 0.0, -press * min(t, 1.0)], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.Symmetry(on="front"),
        vx.PrescribedDisplacement(move_top, on="top"),
        vx.UnilateralContact(on="sole", gap=lambda x, t: (x[:, 0] ** 2 + x[:, 1] ** 2) / (2 * RADIUS)),
        vx.CoulombFriction(lambda x, t: np.full(len(x), friction if t > 1 else 0.0), on="sole"),
    )


def lines(n, growth=1.6, even=1.2):
    """Return coordinates from 0 to `REACH`, with steps a/n up to `even` * a, then growing steps."""
    line, step = list(CONTACT / n * np.arange(even * n)), CONTACT / n
    while line[-1] < REACH:
        step *= growth
        line.append(line[-1] + step)
    return np.array([*line[:-1], REACH])


def block(x, y, z):
    """Return a mesh of boxes; "sole" is the part of the bottom near the sphere."""
    lattice = vx.meshes.squares((len(x) - 1, len(y) - 1), box=((0, len(x) - 1), (0, len(y) - 1)))
    i, j = lattice.points.round().astype(int).T
    boxes = vx.PolygonMesh(np.column_stack([x[i], y[j]]), lattice.cells).extruded(z)
    return boxes.with_boundary("sole", lambda p: (p[:, 2] < 1e-12) & (np.hypot(p[:, 0], p[:, 1]) < 1.3 * CONTACT))


def mesh(n, family="graded"):
    outwards = lines(n)
    return block(np.concatenate([-outwards[:0:-1], outwards]), outwards, lines(n, DOWNWARD_GROWTH, 0.4))


def quarter(n):
    """Return a mesh of a quarter of the block, with cubes near the contact, for pressing only."""
    return block(*[lines(n, 1.5, 1.3)] * 3)


def times(steps):
    """Return the instants: a quarter of the steps press the block, the others drag it."""
    press = max(1, steps // 4)
    return np.concatenate([np.linspace(0, 1, press + 1), np.linspace(1, 2, steps - press + 1)[1:]])


def forces(history):
    """Return P and Q of the whole contact at every step."""
    contact = history.contact
    pushed = np.einsum("smd,m->sd", contact.traction, contact.friction_lengths)
    return 2 * contact.pressure @ contact.lengths, 2 * np.abs(pushed[:, 0])


def radius(places, weights):
    """Return the radius a. For the density sqrt(1 - r^2 / a^2), the mean of r^2 is 2/5 a^2."""
    share = weights / weights.sum()
    centre = [share @ places[:, 0], 0.0]
    return np.sqrt(2.5 * share @ ((places - centre) ** 2).sum(axis=1))


def measure_contact(history, step):
    """Return the radius of the contact, by the second moment of its forces, and the largest pressure."""
    contact = history.contact
    return radius(contact.points[:, :2], contact.pressure[step] * contact.lengths), contact.pressure[step].max()


def stick_radius(history):
    """Return c at the end; the density mu p - |traction| is mu p_0 c/a sqrt(1 - r^2 / c^2)."""
    contact = history.contact
    spare = FRICTION * contact.pressure[-1] - np.linalg.norm(contact.traction[-1], axis=1)
    return radius(contact.points[:, :2], np.maximum(spare, 0.0) * contact.lengths)


def picture(history):
    """Draw the contact at the end, and pressure and friction against the radius."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    face, graph = figure.subplots(1, 2)
    reach = 1.3 * CONTACT
    vx.plots.contact_face(history, ax=face, window=((-reach, reach), (0.0, reach)), units=UNITS)
    near = np.linalg.norm(history.contact.points[:, :2], axis=1) < reach
    r = np.linalg.norm(history.contact.points[near, :2], axis=1)
    pressure, sticks = history.contact.pressure[-1][near], history.contact.sticking[-1][near]
    friction = np.linalg.norm(history.contact.traction[-1][near], axis=1)
    P, Q = np.transpose(forces(history))[-1]
    (a, p0), line = hertz(P), np.linspace(0.0, reach, 801)
    c = a * np.cbrt(1 - Q / (FRICTION * P))
    full, inner = (np.sqrt(np.maximum(1 - (line / size) ** 2, 0.0)) for size in (a, c))
    graph.plot(line, FRICTION * p0 * full, "--", color="0.5", label=r"$\mu p$ (Hertz)")
    graph.plot(r, FRICTION * pressure, "^", color="0.5", label=r"$\mu p$")
    graph.plot(line, FRICTION * p0 * (full - c / a * inner), "k-", label="Cattaneo and Mindlin")
    graph.plot(r[~sticks], friction[~sticks], "C1s", fillstyle="none", label="friction, slips")
    graph.plot(r[sticks], friction[sticks], "C0o", label="friction, sticks")
    graph.set(xlabel="distance $r$ from the axis (mm)", ylabel="pressure, friction (MPa)", ylim=(0, None))
    graph.grid()
    graph.legend()
    return figure
