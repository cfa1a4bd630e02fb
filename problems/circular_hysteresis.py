r"""A block whose top moves in circles over a rough floor: friction that turns, in closed form, exact on every mesh.

The block (0, 2) x (0, 1) x (0, 1/2), E = 1000, nu = 1/4, rests in bilateral contact with Tresca friction, bound g. Its
top is moved by U(t) = (U_1, U_2, 0): straight to a circle of radius R while t < 1, then round it, one turn in each unit
of time. The sides carry the shear tractions of a block that shears uniformly. Then so it does: u = (a + gamma z, 0)
with vectors a, gamma in the plane of the floor and, step by step,

$$ \gamma_n = P((U_n - a_{n-1}) / H), \qquad a_n = U_n - \gamma_n H, $$

P the projection on the disc of radius g / mu: a play operator. With r = g H / mu < R the sole comes to follow on the
circle of radius sqrt(R^2 - r^2), and drags behind at a right angle; a turn dissipates 2 pi g A sqrt(R^2 - r^2). In
steps of the angle alpha its radius is

$$ \rho = \sqrt{R^2-r^2 \cos^2(\alpha/2)} - r \sin(\alpha / 2), $$

and a turn of N steps dissipates 2 N g A rho sin(alpha/2). The field is linear, so virtual elements reproduce it on any
mesh. (Two absolute values, one for each axis, in place of the disc bear up to sqrt(2) g, at 45 degrees.)

    vemcvx run problems/circular_hysteresis.py --mesh voronoi3 --n 3 --steps 60
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, face_and_graph

YOUNG, POISSON, SIDES, HEIGHT = 1000.0, 0.25, (2.0, 1.0), 0.5
MU = YOUNG / (2 * (1 + POISSON))
BOUND = 0.8
PLAY = BOUND * HEIGHT / MU
RADIUS = 2.0 * PLAY
TURNS = 2
UNITS = MM
SMALL = {"n": 2, "steps": 60}


def top(t):
    """U(t), (..., 2)."""
    t = np.asarray(t, dtype=float)
    angle = 2 * np.pi * np.maximum(t - 1, 0)
    return RADIUS * np.minimum(t, 1)[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def closed_form(instants):
    """The shear gamma and the slip a, (N + 1, 2), at every instant."""
    gamma, a = np.zeros((2, len(instants), 2))
    for n, U in enumerate(top(instants[1:]), start=1):
        wanted = (U - a[n - 1]) / HEIGHT
        gamma[n] = wanted * min(1.0, BOUND / MU / np.linalg.norm(wanted))
        a[n] = U - gamma[n] * HEIGHT
    return gamma, a


def exact(points, instants):
    """The displacement (N + 1, n_nodes, 3) at points."""
    gamma, a = closed_form(instants)
    along = a[:, None] + gamma[:, None] * points[:, 2:]
    return np.concatenate([along, np.zeros((*along.shape[:2], 1))], axis=2)


def dissipated_in_a_turn(steps=None):
    """What one turn dissipates once the sole goes in a circle; in so many steps, or with none."""
    area, half = np.prod(SIDES), 0.0 if steps is None else np.pi / steps
    rho = np.sqrt(RADIUS**2 - (PLAY * np.cos(half)) ** 2) - PLAY * np.sin(half)
    return BOUND * area * rho * (2 * np.pi if steps is None else 2 * steps * np.sin(half))


def scene(steps=SMALL["steps"]):
    instants = times(steps)
    gamma, _ = closed_form(instants)

    def shear(axis, sign):
        def force(x, t):
            return np.tile([0.0, 0.0, sign * MU * np.interp(t, instants, gamma[:, axis])], (len(x), 1))

        return force

    def moved(x, t):
        return np.tile([*top(t), 0.0], (len(x), 1))

    sides = [("left", 0, -1.0), ("right", 0, 1.0), ("front", 1, -1.0), ("back", 1, 1.0)]
    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.PrescribedDisplacement(moved, on="top"),
        *(vx.Traction(shear(axis, sign), on=side) for side, axis, sign in sides),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=BOUND, on="bottom"),
    )


def mesh(n, family="cubes"):
    return vx.meshes.SPACE_FAMILIES[family](n, box=((0, SIDES[0]), (0, SIDES[1]), (0, HEIGHT)))


def times(steps):
    """As many steps for the way to the circle as for each turn."""
    return np.linspace(0.0, 1.0 + TURNS, steps + 1)


def picture(history):
    """The floor in the last step, and the circles of top and sole."""
    figure, graph = face_and_graph(history)
    sole = history.contact.slip.mean(axis=1)
    dense = np.linspace(0.0, 1.0 + TURNS, 3001)
    graph.plot(*top(dense).T, color="0.6", linewidth=1.0, label="top")
    beside_closed_form(graph, sole[:, :2].T, closed_form(history.times)[1].T, label="sole")
    graph.plot(*closed_form(dense)[1].T, ":", color="0.3", linewidth=1.0, label="in steps without end")
    graph.plot(*np.transpose([top(history.times[-1]), sole[-1, :2]]), color="0.4", linewidth=1.0)
    graph.legend(frameon=False, fontsize="small", loc="center", bbox_to_anchor=(0.5, 0.36))
    graph.set(xlabel="moved along $x_1$ (mm)", ylabel="moved along $x_2$ (mm)", aspect="equal")
    return figure
