r"""A fault that slips by a given amount: the stress that it loses, and hands to the rock ahead of it.

A block |x|, |y| < 10 a in plane strain is held by nothing. The fault |x| < a, y = 0 stays closed and slips by

$$ s = \frac{4 (1 - \nu^2)}{E} \tau(a^2 - x^2)^{1/2}, $$

the slip of a crack in an infinite body that loses the shear stress tau (Starr 1928). The shear stress on the fault
therefore falls by tau. In a block of 10 a this is right to 1 %, but for cells next to the tips.

    vemcvx run problems/fault_slip.py --n 8 --steps 2 --plot
"""

import numpy as np

import vemcvx as vx
from pressurised_crack import HALF, POISSON, UNITS, YOUNG
from pressurised_crack import mesh as cracked
from problem_pictures import beside_closed_form, body_and_graph

DROP = 3.0
SMALL = {"n": 8, "steps": 2}


def slip(x, t, drop=DROP):
    """Return the slip along the fault, right-lateral, at points x (m, 2)."""
    return 4 * (1 - POISSON**2) / YOUNG * drop * t * np.sqrt(np.maximum(HALF**2 - x[:, 0] ** 2, 0.0))


def lost(history):
    """Return places x (m,) along the fault and the shear stress (S, m) that it lost there: the force that drives it."""
    contact = history.contact
    return contact.points[:, 0], history.forces[:, contact.nodes, 0] / contact.lengths


def scene(drop=DROP):
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.PrescribedSlip(lambda x, t: slip(x, t, drop), on="crack"),
    )


def mesh(n, family="squares"):
    return cracked(n, family)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The shear stress around the fault, and what the fault lost."""
    figure, graph = body_and_graph(history, window=((-3, 3), (-3, 3)), stress="xy", forces="none", units=UNITS)
    x, found = lost(history)
    order, line = np.argsort(x), np.array([-HALF, HALF])
    beside_closed_form(graph, (x[order], found[-1, order]), (line, [DROP, DROP]), exact_label="Starr 1928")
    graph.set(xlabel="x (m)", ylabel="shear stress lost (MPa)", ylim=(0.0, None))
    return figure
