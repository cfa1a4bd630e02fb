"""A block that slips everywhere, in closed form for every Poisson ratio up to 1/2: what incompressibility costs.

On the unit square, with mu = 1 and c = 1 / (1 + lambda),

    u = t e^{xy} / 6 (x (1 + c), y (c - 1)),

whose divergence is 1 / lambda of its gradient: stresses stay bounded as lambda grows. On y = 0 the normal
displacement vanishes and the whole contact slips to the right against the bound g(x) = t mu x^2 (lambda + 2) / (6
(lambda + 1)); body forces are what u calls for, and on the other sides u is prescribed. Data grow with t alone, so
backward Euler makes no error: what is left is that of the mesh.

    vemcvx run problems/manufactured_full_slip.py --mesh voronoi --n 32 --steps 4
"""

import numpy as np

import vemcvx as vx

MU = 1.0


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


def lame(poisson):
    """lambda for mu = 1."""
    return 2 * MU * poisson / (1 - 2 * poisson)


def scene(poisson=0.3):
    lam = lame(poisson)
    return vx.Scene(
        vx.Elasticity(young=2 * MU * (1 + poisson), poisson=poisson),
        vx.BodyForce(lambda x, t: body_force(x[:, 0], x[:, 1], t, lam)),
        vx.PrescribedDisplacement(lambda x, t: displacement(x[:, 0], x[:, 1], t, lam), on=["left", "right", "top"]),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(lambda x, t: t * MU * x[:, 0] ** 2 * (lam + 2) / (6 * (lam + 1)), on="bottom"),
    )


def mesh(n, family="voronoi"):
    return vx.meshes.FAMILIES[family](n)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)
