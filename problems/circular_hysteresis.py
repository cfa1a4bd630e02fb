r"""A block whose top moves in circles over a rough floor: rotating friction in closed form, exact on every mesh.

The block (0, 2) x (0, 1) x (0, H) has H = 1/2, E = 1000, nu = 1/4 and the shear modulus mu. The lower side, the sole,
has the area A. On the sole, contact is bilateral, and Tresca friction has the bound g. The top moves by
U(t) = (U_1, U_2, 0): straight to a circle of radius R for t < 1, then around the circle, one turn per unit of time.
Shear tractions on the sides keep the shear uniform: u = (a + gamma z, 0) with vectors a, gamma in the plane of the
floor. The shear gamma and the slip a are, step by step,

$$ \gamma_n = P((U_n - a_{n-1}) / H), \qquad a_n = U_n - \gamma_n H. $$

P is the projection on the disc of radius g / mu. With r = g H / mu < R the path of the sole tends to the circle of
radius sqrt(R^2 - r^2). The sole lags behind the top: U - a is perpendicular to a. A turn dissipates
2 pi g A sqrt(R^2 - r^2). In steps of the angle alpha the radius of the sole's path is

$$ \rho = \sqrt{R^2-r^2 \cos^2(\alpha/2)} - r \sin(\alpha / 2), $$

and a turn of N steps dissipates 2 N g A rho sin(alpha/2). The displacement is linear, so virtual elements reproduce it
on any mesh.

    vemcvx run problems/circular_hysteresis.py --mesh voronoi3 --n 3 --steps 60
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, SIDES, HEIGHT = 1000.0, 0.25, (2.0, 1.0), 0.5
MU = YOUNG / (2 * (1 + POISSON))
BOUND = 0.8
PLAY = BOUND * HEIGHT / MU
RADIUS = 2.0 * PLAY
TURNS = 2
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 2, "steps": 60}


def top(t):
    """Return U(t) without its third component, which is zero."""
    t = np.asarray(t, dtype=float)
    angle = 2 * np.pi * np.maximum(t - 1, 0)
    return RADIUS * np.minimum(t, 1)[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def exact_solution(instants):
    """Return the shear gamma and the slip a: arrays with one row per instant."""
    gamma, a = np.zeros((2, len(instants), 2))
    for n, U in enumerate(top(instants[1:]), start=1):
        trial = (U - a[n - 1]) / HEIGHT
        gamma[n] = trial * min(1.0, BOUND / MU / np.linalg.norm(trial))
        a[n] = U - gamma[n] * HEIGHT
    return gamma, a


def exact(points, instants):
    """Return displacements, of shape (instants, points, 3)."""
    gamma, a = exact_solution(instants)
    along = a[:, None] + gamma[:, None] * points[:, 2:]
    return np.concatenate([along, np.zeros((*along.shape[:2], 1))], axis=2)


def turn_dissipation(steps=None):
    """Return the dissipation of one turn of a circle; `steps=None` means continuous time."""
    area, half = np.prod(SIDES), 0.0 if steps is None else np.pi / steps
    rho = np.sqrt(RADIUS**2 - (PLAY * np.cos(half)) ** 2) - PLAY * np.sin(half)
    return BOUND * area * rho * (2 * np.pi if steps is None else 2 * steps * np.sin(half))


def scene(steps=SMALL["steps"]):
    instants = times(steps)
    gamma, _ = exact_solution(instants)

    def shear(axis, sign):
        def force(x, t):
            return np.tile([0.0, 0.0, sign * MU * np.interp(t, instants, gamma[:, axis])], (len(x), 1))

        return force

    def move_top(x, t):
        return np.tile([*top(t), 0.0], (len(x), 1))

    sides = [("left", 0, -1.0), ("right", 0, 1.0), ("front", 1, -1.0), ("back", 1, 1.0)]
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.PrescribedDisplacement(move_top, on="top"),
        *(vx.Traction(shear(axis, sign), on=side) for side, axis, sign in sides),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=BOUND, on="bottom"),
    )


def mesh(n, family="cubes"):
    return vx.meshes.SPACE_FAMILIES[family](n, box=((0, SIDES[0]), (0, SIDES[1]), (0, HEIGHT)))


def times(steps):
    """Return the instants: the path to the circle has as many steps as each turn."""
    return np.linspace(0.0, 1.0 + TURNS, steps + 1)


def picture(history):
    """Draw the friction on the floor in the last step, and the circles of top and sole."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    face, graph = figure.subplots(1, 2)
    vx.plots.contact_face(history, ax=face, units=UNITS)
    dense = np.linspace(0.0, 1.0 + TURNS, 3001)
    sole = history.contact.slip.mean(axis=1)[:, :2]
    graph.plot(*top(dense).T, color="0.6", linewidth=1.0, label="top")
    graph.plot(*exact_solution(history.times)[1].T, "k-", label="closed form")
    graph.plot(*exact_solution(dense)[1].T, ":", color="0.3", linewidth=1.0, label="in continuous time")
    graph.plot(*sole.T, "C0o", label="sole")
    graph.plot(*np.transpose([top(history.times[-1]), sole[-1]]), color="0.4", linewidth=1.0)
    graph.set(xlabel="displacement along $x_1$ (mm)", ylabel="displacement along $x_2$ (mm)", aspect="equal")
    graph.grid()
    graph.legend(loc="center", bbox_to_anchor=(0.5, 0.36))
    return figure
