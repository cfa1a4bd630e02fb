r"""A block that is found slipping, and stops in the middle of a step: u_0 != 0, and an error of the steps beside h.

The displacement is that of :mod:`manufactured_full_slip` in another course of time,

$$ u = \phi(t) w(x), \qquad \phi(t) = 1 / 2 + \min(t, 1 / 2), \qquad 0 \le t \le 1, $$

in units of 1e-3 of a length. At t = 0 the block is strained and slips, at the bound of friction: u_0 = w / 2 is no
state of rest, and obeys (2.1), for loads and friction at the bound balance its stresses. At t = 1/2 it stops. Then the
bound rises with b (t - 1/2) above what friction bears, and everything sticks.

Runs begin from P^h u_0, (2.11). With N steps, N odd, the stop is in the middle of one. At its end the bound is b / (2
N) too large, and backward Euler slips less than the block did until it stopped: u is off by O(k) from then on. With N
even it makes no error in time, and what is left is h.

    vemcvx run problems/manufactured_start_and_stop.py --mesh voronoi --n 16 --steps 17
"""

import numpy as np

import manufactured_full_slip as full_slip
import vemcvx as vx
from problem_pictures import beside_closed_form, body_and_graph

SIZE, STOP, RISE = 1e-3, 0.5, 3.0
UNITS = full_slip.UNITS
SMALL = {"n": 12, "steps": 13}


def course(t):
    """The displacement, as part of w."""
    return SIZE * (0.5 + min(t, STOP))


def scene(poisson=0.3, rise=RISE, stabilisation="shear"):
    lam = full_slip.lame(poisson)
    whole = full_slip.scene(poisson, course, stabilisation=stabilisation).without(vx.TrescaFriction)

    def bound(x, t):
        borne = course(t) * full_slip.MU * x[:, 0] ** 2 * (lam + 2) / (6 * (lam + 1))
        return borne + SIZE * rise * max(t - STOP, 0.0)

    return whole.with_(vx.TrescaFriction(bound, on="bottom"))


def displacement(x, t, poisson=0.3):
    """u at points (m, 2)."""
    return full_slip.displacement(x[:, 0], x[:, 1], course(t), full_slip.lame(poisson))


def strain(x, t, poisson=0.3):
    """e_xx, e_yy, 2 e_xy at points (m, 2)."""
    return full_slip.strain(x[:, 0], x[:, 1], course(t), full_slip.lame(poisson))


initial = vx.projected(displacement)


def mesh(n, family="voronoi"):
    return full_slip.mesh(n, family)


def times(steps):
    return full_slip.times(steps)


def picture(history):
    """The block at the end, and the place of a node of its contact: found slipping, it stops inside a step."""
    figure, graph = body_and_graph(history, step=-1, stress="mean", forces="friction", magnify=100)
    outer = int(np.argmax(history.contact.points[:, 0] * (history.contact.points[:, 0] < 1)))
    place = history.contact.points[outer]
    line = np.linspace(0, 1, 201)
    exact = [displacement(place[None], s)[0, 0] for s in line]
    found = history.times, history.contact.slip[:, outer, 0]
    beside_closed_form(graph, found, (line, exact), label="computed")
    graph.set(xlabel="time (s)", ylabel=f"$u_1$ at $x_1$ = {place[0]:.2f} (mm)")
    return figure
