"""Partial slip under a cylinder, pressed and then dragged: the contact sticks inside and slips at its edges.

After Hertz' P a tangential force Q < mu P acts. Where Dundurs' beta vanishes (a rigid obstacle and a body with nu =
1/2: pressure then causes no slip), the solution of Cattaneo (1938) and Mindlin (1949) is a difference of two
half-ellipses:

    |traction| = mu p0 ( sqrt(1 - x^2/a^2) - c/a sqrt(1 - x^2/c^2) ),     c / a = sqrt(1 - Q / (mu P)),

with stick in |x| < c (Johnson, *Contact Mechanics*, 7.2). The top of a wide block is pressed down on the obstacle and
then moved sideways without turning; P and Q are measured.

    vemcvx run problems/cattaneo_mindlin.py --n 20 --steps 8 --plot
"""

import numpy as np

import vemcvx as vx
from hertz_contact import HALF_WIDTH, RADIUS, REACH, YOUNG, fitted, graded, grid

POISSON, FRICTION = 0.4999, 0.4
PRESS, DRAG = 7e-4, 4.5e-4


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
