r"""A block that slips everywhere, in closed form for every Poisson ratio up to 1/2: what incompressibility costs.

On the unit square, with mu = 1 and c = 1 / (1 + lambda),

$$ u = t e^{xy} / 6 (x (1 + c), y (c - 1)), $$

whose divergence is 1 / lambda of its gradient: stresses stay bounded as lambda grows. On y = 0 the normal
displacement vanishes and the whole contact slips to the right against the bound g(x) = t mu x^2 (lambda + 2) / (6
(lambda + 1)); body forces are what u calls for, and on the other sides u is prescribed. Data grow with t alone, so
backward Euler makes no error: what is left is that of the mesh. With any increasing phi(t) in place of t the same holds
for phi(t) u, in as many steps as one likes. (At t = 1 strains are of the order of one, of which a run warns; they are
formal, and as good as a thousandth in a linear theory. The picture shows a tenth of the displacements.)

Prescribed on all the other sides, the nodal values of u let a little more flow out of the body than div u says, by
O(h^2) unless nodes lie alike on two sides; that much volume costs lambda. At lambda = 1e6 and h = 1/8 it triples the
error on hexagons. With the traction sigma(u) n on top instead (``pulled=True``) the volume is free, and errors are the
same for all lambda.

    vemcvx run problems/manufactured_full_slip.py --mesh voronoi --n 32 --steps 4
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.plots.style import SECOND

MU = 1.0
UNITS = MM
SMALL = {"n": 12, "steps": 2}


def displacement(x, y, t, lam):
    """u (..., 2)."""
    c = 1.0 / (1.0 + lam)
    return t * np.exp(x * y)[..., None] / 6 * np.stack([x * (1 + c), y * (c - 1)], axis=-1)


def strain(x, y, t, lam):
    """(..., 3): e_xx, e_yy and 2 e_xy of u."""
    c, e = 1.0 / (1.0 + lam), np.exp(x * y) * t / 6
    return np.stack(
        [e * (1 + x * y) * (1 + c), e * (1 + x * y) * (c - 1), e * (x * x * (1 + c) + y * y * (c - 1))], axis=-1
    )


def body_force(x, y, t, lam):
    """-div sigma(u), (..., 2)."""
    q = lam * y**2 / 2 - x**2 * (lam / 2 + 1)
    first = -MU * (lam * y + x * q) + y * (lam + MU * (lam + 2)) * (x * y + 2)
    second = -lam * x * (MU - 1) * (x * y + 2) + MU * (x * (lam + 2) - y * q)
    return -t * np.exp(x * y)[..., None] / (3 * (1 + lam)) * np.stack([first, second], axis=-1)


def traction_on_top(x, y, t, lam):
    """sigma(u) (0, 1), (..., 2)."""
    _, yy, xy = np.moveaxis(strain(x, y, t, lam), -1, 0)
    # lambda div u = lambda c (1 + xy) e^{xy} / 3, where e_xx + e_yy would cancel.
    pressure = lam / (1.0 + lam) * (1 + x * y) * np.exp(x * y) * t / 3
    return np.stack([MU * xy, 2 * MU * yy + pressure], axis=-1)


def lame(poisson):
    """lambda for mu = 1."""
    return 2 * MU * poisson / (1 - 2 * poisson)


def scene(poisson=0.3, phi=lambda t: t, pulled=False, stabilisation="shear"):
    lam = lame(poisson)

    def of(field):
        return lambda x, t: field(x[:, 0], x[:, 1], phi(t), lam)

    held = ["left", "right"] if pulled else ["left", "right", "top"]
    return vx.Scene(
        vx.Elasticity(young=2 * MU * (1 + poisson), poisson=poisson, stabilisation=stabilisation),
        vx.BodyForce(of(body_force)),
        vx.PrescribedDisplacement(of(displacement), on=held),
        *([vx.Traction(of(traction_on_top), on="top")] if pulled else []),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(lambda x, t: phi(t) * MU * x[:, 0] ** 2 * (lam + 2) / (6 * (lam + 1)), on="bottom"),
    )


def mesh(n, family="voronoi"):
    return vx.meshes.FAMILIES[family](n)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The slipping block, and what contact bears along it: pressure of either sign, and friction at its bound."""
    figure, graph = body_and_graph(history, stress="mean", forces="friction", magnify=0.1)
    contact, lam = history.contact, lame(0.3)
    order = np.argsort(contact.points[:, 0])
    x, line = contact.points[order, 0], np.linspace(0, 1, 200)
    exact = strain(line, 0 * line, 1.0, lam)
    pressure = -(lam * (exact[:, 0] + exact[:, 1]) + 2 * MU * exact[:, 1])
    inner = (x > 0) & (x < 1)
    marks = (x[inner], contact.pressure[-1][order][inner])
    beside_closed_form(graph, marks, (line, pressure), label="pressure", exact_label="closed form")
    marks = (x, np.abs(contact.traction[-1][order, 0]))
    friction = MU * exact[:, 2]
    beside_closed_form(graph, marks, (line, friction), colour=SECOND, label="friction", exact_label=None)
    graph.set(xlabel="$x_1$ (mm)", ylabel="on the body (MPa)")
    return figure
