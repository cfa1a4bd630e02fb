"""A block that slips everywhere, in closed form for all Poisson's ratios up to 1/2.

On the unit square, with Lame's constants lambda and mu = 1, and with c = 1 / (1 + lambda), let

$$ u = (t / 6) e^{xy} (x (1 + c), y (c - 1)) . $$

For large lambda the divergence of u is of the size 1 / lambda, so that stresses stay bounded. On y = 0 the normal
displacement vanishes. The whole contact slips to the right, and friction is at its bound t mu x^2
(lambda + 2) / (6 (lambda + 1)). The body force is -div sigma(u), and u is prescribed on the other three sides. All data
are proportional to t, so only the mesh causes errors. The same holds with any increasing phi(t) in place of t. At t = 1
strains are of the order of 1, and a run warns about these strains. The picture shows a tenth of the displacements.

The nodal values of u on the three sides prescribe a change of volume. This change differs from the integral of div u by
O(h^2). The wrong volume causes an energy that is proportional to lambda: at lambda = 1e6 and h = 1/8, this energy
triples the error on hexagons. With ``pulled=True`` the traction sigma(u) n acts on top. Then the volume is free, and
errors are the same for all lambda.

    vemcvx run problems/manufactured_full_slip.py --mesh voronoi --n 32 --steps 4
"""

import numpy as np

import vemcvx as vx

MU = 1.0
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 12, "steps": 2}


def displacement(x, y, t, lam):
    """Return u (..., 2)."""
    c = 1.0 / (1.0 + lam)
    return t * np.exp(x * y)[..., None] / 6 * np.stack([x * (1 + c), y * (c - 1)], axis=-1)


def strain(x, y, t, lam):
    """Return e_xx, e_yy and 2 e_xy of u, (..., 3)."""
    c, e = 1.0 / (1.0 + lam), np.exp(x * y) * t / 6
    return np.stack(
        [e * (1 + x * y) * (1 + c), e * (1 + x * y) * (c - 1), e * (x * x * (1 + c) + y * y * (c - 1))], axis=-1
    )


def body_force(x, y, t, lam):
    """Return -div sigma(u), (..., 2)."""
    q = lam * y**2 / 2 - x**2 * (lam / 2 + 1)
    first = -MU * (lam * y + x * q) + y * (lam + MU * (lam + 2)) * (x * y + 2)
    second = -lam * x * (MU - 1) * (x * y + 2) + MU * (x * (lam + 2) - y * q)
    return -t * np.exp(x * y)[..., None] / (3 * (1 + lam)) * np.stack([first, second], axis=-1)


def traction_on_top(x, y, t, lam):
    """Return sigma(u) (0, 1), (..., 2)."""
    _, yy, xy = np.moveaxis(strain(x, y, t, lam), -1, 0)
    # We use lambda div u = lambda c t (1 + xy) e^{xy} / 3, because rounding spoils the sum e_xx + e_yy.
    pressure = lam / (1.0 + lam) * (1 + x * y) * np.exp(x * y) * t / 3
    return np.stack([MU * xy, 2 * MU * yy + pressure], axis=-1)


def lame(poisson):
    """Return Lame's constant lambda for mu = 1."""
    return 2 * MU * poisson / (1 - 2 * poisson)


def scene(poisson=0.3, phi=lambda t: t, pulled=False, stabilisation="shear"):
    lam = lame(poisson)

    def evaluate(field):
        return lambda x, t: field(x[:, 0], x[:, 1], phi(t), lam)

    held = ["left", "right"] if pulled else ["left", "right", "top"]
    return vx.Scene(
        vx.Elasticity(young=2 * MU * (1 + poisson), poisson=poisson, stabilisation=stabilisation),
        vx.BodyForce(evaluate(body_force)),
        vx.PrescribedDisplacement(evaluate(displacement), on=held),
        *([vx.Traction(evaluate(traction_on_top), on="top")] if pulled else []),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(lambda x, t: phi(t) * MU * x[:, 0] ** 2 * (lam + 2) / (6 * (lam + 1)), on="bottom"),
    )


def mesh(n, family="voronoi"):
    return vx.meshes.FAMILIES[family](n)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the slipping block, and friction and pressure along the contact."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    vx.plots.stressed_body(history, ax=body, stress="mean", forces="friction", magnify=0.1, units=UNITS)
    contact, lam, line = history.contact, lame(0.3), np.linspace(0, 1, 200)
    xx, yy, xy = strain(line, 0 * line, 1.0, lam).T
    x = contact.points[:, 0]
    inner = (x > 0) & (x < 1)
    graph.plot(line, -(lam * (xx + yy) + 2 * MU * yy), "C0-", label="pressure, closed form")
    graph.plot(x[inner], contact.pressure[-1][inner], "C0o", label="pressure")
    graph.plot(line, MU * xy, "C1-", label="friction, closed form")
    graph.plot(x, np.abs(contact.traction[-1][:, 0]), "C1s", label="friction")
    graph.set(xlabel="$x_1$ (mm)", ylabel="pressure, friction (MPa)")
    graph.grid()
    graph.legend()
    return figure
