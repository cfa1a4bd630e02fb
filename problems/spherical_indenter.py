r"""A sphere pressed into an elastic block and dragged: Hertz' point contact, Cattaneo's and Mindlin's partial slip.

The obstacle lies (x_1^2 + x_2^2) / 2R below the lower side of the block and is rigid. Under the force P,

$$ a^3 = 3 P R (1 - \nu^2) / (4 E), \qquad p(r) = p_0 \sqrt{1-r^2/a^2}, \qquad p_0 = 3 P / (2 \pi a^2) $$

(Johnson, *Contact Mechanics*, 4.2). Then a tangential force Q < mu P acts: with Coulomb friction, and where pressure
causes no slip (a rigid obstacle and nu = 1/2; nearly so here, where nu = .45),

$$ |\text{traction}| = \mu p_0 (\sqrt{1-r^2/a^2} - \tfrac ca \sqrt{1-r^2/c^2}), \quad c / a = (1 - Q / \mu P)^{1/3}, $$

with stick in r < c (7.2; the small parts of slip across the direction of Q are left out there, and are in what is
computed). The block reaches 6 a to all sides and is not quite a half-space: pressing widens it. Friction therefore
begins to act when it is pressed, at t = 1. One half of the block is computed. Cells grow outwards from a/n at the
contact, downwards at once. The top is pressed down and then dragged without turning; P and Q are measured. With n = 8
the radius is Hertz' within 2 % and the peak within 5 %, 2 % where cells are even downwards, too (`quarter`), and
friction within half the stick radius is 4 to 7 % below the closed form; the stick radius, which is that of single
nodes, comes to .94 of it.

    vemcvx run problems/spherical_indenter.py --n 8 --steps 8 --plot
"""

import numpy as np

import vemcvx as vx
from hertz_contact import grid
from problem_pictures import MM, SLID, STUCK, face_and_graph
from vemcvx.base.canvas import light_grid

RADIUS, YOUNG, POISSON, FRICTION = 1.0, 1000.0, 0.45, 0.4
CONTACT = 0.05
"""About the radius of the contact."""
REACH = 6 * CONTACT
DEEPER = 1.4
"""How cells grow away from the contact, where what it does dies away."""
PRESS, DRAG = 2.05e-3, 5e-4
UNITS = MM
SMALL = {"n": 8, "steps": 4, "accuracy": 1e-6}


def hertz(force):
    """Radius of the contact and peak pressure under the force P."""
    a = np.cbrt(3 * force * RADIUS * (1 - POISSON**2) / (4 * YOUNG))
    return a, 3 * force / (2 * np.pi * a**2)


def scene(friction=FRICTION, press=PRESS, drag=DRAG):
    def moved(x, t):
        return np.tile([drag * max(t - 1.0, 0.0), 0.0, -press * min(t, 1.0)], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.Symmetry(on="front"),
        vx.PrescribedDisplacement(moved, on="top"),
        vx.UnilateralContact(on="sole", gap=lambda x, t: (x[:, 0] ** 2 + x[:, 1] ** 2) / (2 * RADIUS)),
        vx.CoulombFriction(lambda x, t: np.full(len(x), friction if t > 1 else 0.0), on="sole"),
    )


def graded(n, growth=1.6, even=1.2):
    """Lines from 0 to the reach: steps of a/n up to `even` a, then growing."""
    line = list(CONTACT / n * np.arange(even * n))
    step = CONTACT / n
    while line[-1] < REACH:
        step *= growth
        line.append(line[-1] + step)
    return np.array([*line[:-1], REACH])


def block(x, y, z):
    """Boxes between lines, with the part of the floor's face near the sphere as "sole"."""
    whole = grid(x, y).extruded(z)
    return whole.with_boundary("sole", lambda p: (p[:, 2] < 1e-12) & (np.hypot(p[:, 0], p[:, 1]) < 1.3 * CONTACT))


def mesh(n, family="graded"):
    lines = graded(n)
    return block(np.concatenate([-lines[:0:-1], lines]), lines, graded(n, DEEPER, 0.4))


def quarter(n):
    """The half of it at x_1 > 0, for what is pressed only."""
    return block(*[graded(n, 1.5, 1.3)] * 3)


def times(steps):
    """A quarter of the steps press, the rest drag."""
    press = max(1, steps // 4)
    return np.concatenate([np.linspace(0, 1, press + 1), np.linspace(1, 2, steps - press + 1)[1:]])


def forces(history):
    """P and Q of the whole contact at every step."""
    contact = history.contact
    pushed = np.einsum("smd,m->sd", contact.traction, contact.friction_lengths)
    return 2 * contact.pressure @ contact.lengths, 2 * np.abs(pushed[:, 0])


def radius(places, weights):
    """Radius of a distribution sqrt(1 - r^2 / a^2) over a circle, given by forces at places: <r^2> = 2/5 a^2."""
    share = weights / weights.sum()
    centre = [share @ places[:, 0], 0.0]
    return np.sqrt(2.5 * share @ ((places - centre) ** 2).sum(axis=1))


def pressed(history, step):
    """Radius of the contact, by the second moment of its forces, and the largest pressure."""
    contact = history.contact
    return radius(contact.points[:, :2], contact.pressure[step] * contact.lengths), contact.pressure[step].max()


def stick_radius(history):
    """c at the end, by the second moment of mu p - |q| = mu p0 c/a sqrt(1 - r^2 / c^2)."""
    contact = history.contact
    spare = FRICTION * contact.pressure[-1] - np.linalg.norm(contact.traction[-1], axis=1)
    return radius(contact.points[:, :2], np.maximum(spare, 0.0) * contact.lengths)


def picture(history):
    """The contact at the end, and pressure and friction over the radius."""
    reach = 1.3 * CONTACT
    figure, graph = face_and_graph(history, window=((-reach, reach), (0.0, reach)))
    contact = history.contact
    r = np.linalg.norm(contact.points[:, :2], axis=1)
    near, sticks = r < 1.3 * CONTACT, contact.sticking[-1]
    (P, Q), friction = np.transpose(forces(history))[-1], np.linalg.norm(contact.traction[-1], axis=1)
    (a, p0), line = hertz(P), np.linspace(0.0, 1.3 * CONTACT, 801)
    c = a * np.cbrt(1 - Q / (FRICTION * P))
    pressure, spared = (np.sqrt(np.maximum(1 - (line / radius) ** 2, 0.0)) for radius in (a, c))
    graph.plot(line, FRICTION * p0 * pressure, "--", color="0.5", linewidth=1.2, label="$\\mu p$ (Hertz)")
    graph.plot(r[near], FRICTION * contact.pressure[-1, near], "^", color="0.5", markersize=3.5, label="$\\mu p$")
    for chosen, kind, words in ((~sticks & near, SLID, "friction, slips"), (sticks & near, STUCK, "friction, sticks")):
        graph.plot(r[chosen], friction[chosen], **kind, markersize=3.5, label=words)
    mindlin = FRICTION * p0 * (pressure - c / a * spared)
    graph.plot(line, mindlin, color="black", linewidth=1.3, label="Cattaneo and Mindlin")
    graph.set(xlabel="distance $r$ from the axis (mm)", ylabel="pressure, friction (MPa)", ylim=(0, None))
    light_grid(graph)
    graph.legend(frameon=False, fontsize="small")
    return figure
