r"""Partial slip under a cylinder, pressed and then dragged: the contact sticks inside and slips at its edges.

After Hertz' P a tangential force Q < mu P acts. Where Dundurs' beta vanishes (a rigid obstacle and a body with nu =
1/2: pressure then causes no slip), the solution of Cattaneo (1938) and Mindlin (1949) is a difference of two
half-ellipses:

$$ |\text{traction}| = \mu p_0 (\sqrt{1-x^2/a^2} - \tfrac ca \sqrt{1-x^2/c^2}), \qquad c / a = \sqrt{1-Q/(\mu P)}, $$

with stick in |x| < c (Johnson, *Contact Mechanics*, 7.2). The top of a wide block is pressed down on the obstacle and
then moved sideways without turning; P and Q are measured. (The block is finite:
dragging it also strains its surface, which moves the stick zone as a whole, here by a/16 whatever mesh and steps, as a
bulk stress does: Nowell and Hills, Int. J. Mech. Sci. 29, 1987. Its width stays.)

    vemcvx run problems/cattaneo_mindlin.py --n 20 --steps 8 --plot
"""

import numpy as np

import vemcvx as vx
from hertz_contact import HALF_WIDTH, RADIUS, REACH, YOUNG, fitted, graded, grid
from problem_pictures import MM, SLID, STUCK, body_and_graph
from vemcvx.base.canvas import light_grid

POISSON, FRICTION = 0.4999, 0.4
PRESS, DRAG = 7e-4, 4.5e-4
UNITS = MM
SMALL = {"n": 16, "steps": 8}


def scene(friction=FRICTION, drag=DRAG):
    def moved(x, t):
        down, aside = -PRESS * min(t, 1.0), drag * max(t - 1.0, 0.0)
        return np.tile([aside, down], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.PrescribedDisplacement(moved, on="top"),
        vx.UnilateralContact(on="bottom", gap=lambda x, t: x[:, 0] ** 2 / (2 * RADIUS)),
        vx.CoulombFriction(friction, on="bottom"),
    )


def mesh(n, family="graded"):
    half = graded(HALF_WIDTH, n, REACH)
    return grid(np.concatenate([-half[:0:-1], half]), graded(HALF_WIDTH, n, REACH))


def times(steps):
    """A quarter of the steps press, the rest drag."""
    press = max(1, steps // 4)
    return np.concatenate([np.linspace(0, 1, press + 1), np.linspace(1, 2, steps - press + 1)[1:]])


def stick_half_width(history):
    """c from the traction: (mu p - |q|)^2 = (mu p0 c/a)^2 (1 - x^2 / c^2), and from the nodes that stick."""
    contact = history.contact
    x, pressure = contact.points[:, 0], contact.pressure[-1]
    spare = FRICTION * pressure - np.abs(contact.traction[-1][:, 0])
    return fitted(x, np.maximum(spare, 0.0))[0], np.abs(x[contact.sticking[-1] & (pressure > 1e-6)]).max()


def picture(history):
    """The block dragged over the cylinder, and friction between its bounds, stuck inside and slipping at the edges."""
    reach = 2.2 * HALF_WIDTH
    window = ((-reach, reach), (-0.3 * reach, 1.5 * reach))
    figure, graph = body_and_graph(history, stress="shear", window=window)
    contact = history.contact
    order = np.argsort(contact.points[:, 0])
    order = order[np.abs(contact.points[order, 0]) < 1.5 * HALF_WIDTH]
    x, traction, sticks = contact.points[order, 0], np.abs(contact.traction[-1][order, 0]), contact.sticking[-1][order]
    Q, P = np.abs(history.force("bottom")[-1])
    a, share = np.sqrt(4 * P * RADIUS * (1 - POISSON**2) / (np.pi * YOUNG)), np.sqrt(1 - Q / (FRICTION * P))
    stuck = x[sticks & (contact.pressure[-1][order] > 1e-6)]
    line, moved, bound = np.linspace(-a, a, 1601), 0.5 * (stuck.min() + stuck.max()), FRICTION * 2 * P / (np.pi * a)
    slipping, spared = (
        bound * r / a * np.sqrt(np.maximum(1 - ((line - m) / r) ** 2, 0.0)) for r, m in ((a, 0.0), (share * a, moved))
    )
    graph.plot(line, slipping, "--", color="0.5", linewidth=1.2, label="bound $\\mu p$ (Hertz)")
    for chosen, kind, words in ((~sticks, SLID, "slips"), (sticks, STUCK, "sticks")):
        graph.plot(x[chosen], traction[chosen], **kind, markersize=4, zorder=3, label=words)
    graph.plot(line, slipping - spared, color="black", linewidth=1.3, label="Cattaneo and Mindlin")
    graph.set(xlabel="$x_1$ (mm)", ylabel="friction (MPa)", ylim=(0, 1.45 * bound))
    graph.set_title("stick zone moved as by a bulk stress", fontsize="small")
    light_grid(graph)
    graph.legend(frameon=False, fontsize="small", ncols=2, loc="upper center")
    return figure
