r"""A block that slips from the start and stops in the middle of a step: errors of mesh and time step.

Let w(x) be the displacement of `manufactured_full_slip.py` at t = 1. The block here has the displacement

$$ u = \phi(t) w(x), \qquad \phi(t) = 1 / 2 + \min(t, 1 / 2), \qquad 0 \le t \le 1, $$

in thousandths of the unit of length. Stresses are in thousandths of the shear modulus. Equations are numbered as in the
paper by Feng, Han and Huang (`feng_han_huang.py`). At t = 0 the block is strained and slips, with friction at its
bound. So the initial displacement u_0 = w / 2 is not a state of rest. But u_0 satisfies the condition (2.1): loads and
friction at the bound balance the stresses. At t = 1/2 the block stops. From then on all nodes stick: the bound exceeds
the friction by b (t - 1/2) with b = `rise`.

Runs begin from the projection P^h u_0 of (2.11). With an odd number N of steps of length k = 1 / N, the block stops in
the middle of a step. At the end of that step the bound exceeds the friction of the exact solution by b / (2 N), so that
backward Euler lets the block slip too little in this step. The error of u is O(k) from then on. With N even, steps make
no error.

    vemcvx run problems/manufactured_start_and_stop.py --mesh voronoi --n 16 --steps 17
"""

import numpy as np

import vemcvx as vx

SIZE, STOP, RISE = 1e-3, 0.5, 3.0
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 12, "steps": 13}


def course(t):
    """Return the factor of w at the instant t: phi(t) / 1000."""
    return SIZE * (0.5 + min(t, STOP))


def lame(poisson):
    """Return Lame's constant lambda for mu = 1."""
    return 2 * poisson / (1 - 2 * poisson)


def body_force(x, t, poisson=0.3):
    """Return -div sigma(u), (m, 2)."""
    lam, (x, y) = lame(poisson), x.T
    q = lam * y**2 / 2 - x**2 * (lam / 2 + 1)
    first = 2 * (lam + 1) * y * (x * y + 2) - lam * y - x * q
    second = x * (lam + 2) - y * q
    return (-course(t) * np.exp(x * y) / (3 * (1 + lam)) * np.stack([first, second])).T


def scene(poisson=0.3, rise=RISE, stabilisation="shear"):
    lam = lame(poisson)

    def bound(x, t):
        friction = course(t) * x[:, 0] ** 2 * (lam + 2) / (6 * (lam + 1))
        return friction + SIZE * rise * max(t - STOP, 0.0)

    return vx.Scene(
        vx.Elasticity(young=2 * (1 + poisson), poisson=poisson, stabilisation=stabilisation),
        vx.BodyForce(lambda x, t: body_force(x, t, poisson)),
        vx.PrescribedDisplacement(lambda x, t: displacement(x, t, poisson), on=["left", "right", "top"]),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound, on="bottom"),
    )


def displacement(x, t, poisson=0.3):
    """Return u at points x (m, 2)."""
    c, e = 1 / (1 + lame(poisson)), course(t) * np.exp(x[:, 0] * x[:, 1]) / 6
    return np.column_stack([e * x[:, 0] * (1 + c), e * x[:, 1] * (c - 1)])


def strain(x, t, poisson=0.3):
    """Return e_xx, e_yy, 2 e_xy of u at points x (m, 2)."""
    c, e = 1 / (1 + lame(poisson)), course(t) * np.exp(x[:, 0] * x[:, 1]) / 6
    growth = 1 + x[:, 0] * x[:, 1]
    shear = x[:, 0] ** 2 * (1 + c) + x[:, 1] ** 2 * (c - 1)
    return np.column_stack([e * growth * (1 + c), e * growth * (c - 1), e * shear])


initial = vx.projected(displacement)


def mesh(n, family="voronoi"):
    return vx.meshes.FAMILIES[family](n)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the block at the end, and the displacement of a contact node, which stops inside a step."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    how = {"stress": "mean", "forces": "friction", "magnify": 100, "units": UNITS}
    vx.plots.stressed_body(history, step=-1, ax=body, **how)
    outer = int(np.argmax(history.contact.points[:, 0] * (history.contact.points[:, 0] < 1)))
    place, line = history.contact.points[outer], np.linspace(0, 1, 201)
    graph.plot(line, [displacement(place[None], t)[0, 0] for t in line], "k-", label="closed form")
    graph.plot(history.times, history.contact.slip[:, outer, 0], "C0o", label="computed")
    graph.set(xlabel="time (s)", ylabel=f"$u_1$ at $x_1$ = {place[0]:.2f} (mm)")
    graph.grid()
    graph.legend()
    return figure
