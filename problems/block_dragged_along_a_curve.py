r"""A block dragged along a figure of eight: its friction has one size, and turns with the way.

A block 2 x 2 x 1/2, E = 1000, nu = 1/4, is pressed on a rigid floor with Coulomb friction, coefficient mu, by a plate
that is bonded to its top. The plate goes down by a five-hundredth of the height and is then dragged along

$$ U(t) = R (\sin t, \sin(2 t) / 2), \qquad 0 \le t \le 2 \pi. $$

In full slip the friction of the whole sole, which bears the force P, is

$$ F = -\mu P U' / |U'|, $$

against the velocity; in a step of backward Euler, against the step U_n - U_{n-1}. One thing is small beside that: the
sole lags behind the plate by the shear of the block, r = mu p H / G with p = P / 4, and friction opposes the velocity
of the sole, which is an angle of the order of r / R_c off, R_c the radius of curvature of the way.

    vemcvx run problems/block_dragged_along_a_curve.py --n 3 --steps 48 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form
from vemcvx.base.canvas import legend_under, light_grid, new_figure
from vemcvx.plots.style import SLIP

YOUNG, POISSON, SIDE, HEIGHT = 1000.0, 0.25, 2.0, 0.5
DEPTH, FRICTION, RADIUS = HEIGHT / 500, 0.3, 0.1
UNITS = MM
SMALL = {"n": 2, "steps": 32}


def top(t):
    """U(t), (..., 2)."""
    return RADIUS * np.stack([np.sin(t), 0.5 * np.sin(2 * np.asarray(t))], axis=-1)


def friction(instants):
    """The friction of the whole sole on the block in each step as a part of P, (N, 2): against the step."""
    moved = np.diff(top(instants), axis=0)
    return -FRICTION * moved / np.linalg.norm(moved, axis=1, keepdims=True)


def scene(coefficient=FRICTION, crown=0.0):
    """The floor lies `crown` lower than in its middle at a distance SIDE / 2 from there."""

    def plate(x, t):
        return np.tile([*top(t), -DEPTH], (len(x), 1))

    def gap(x, t):
        return crown * ((2 * x[:, :2] / SIDE - 1) ** 2).sum(axis=1)

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.PrescribedDisplacement(plate, on="top"),
        vx.UnilateralContact(on="bottom", gap=gap if crown else 0.0),
        vx.CoulombFriction(coefficient, on="bottom"),
    )


initial = "settled"


def mesh(n, family="cubes"):
    return vx.meshes.SPACE_FAMILIES[family](n, box=((0, SIDE), (0, SIDE), (0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 2 * np.pi, steps + 1)


def computed(history):
    """The friction of the whole sole on the block as a part of P, (N + 1, 2)."""
    contact = history.contact
    force = np.einsum("smd,m->sd", contact.traction, contact.friction_lengths)[:, :2]
    return force / (contact.pressure @ contact.lengths)[:, None]


def picture(history):
    """The way with the friction on the block, and the components of friction."""
    figure = new_figure(9.4, 3.9)
    way, graph = figure.subplots(1, 2)
    t, dense = history.times, np.linspace(0.0, 2 * np.pi, 801)
    force, line = computed(history), friction(dense)
    way.plot(*top(dense).T, color="0.7", linewidth=0.8, label="way of the top")
    way.quiver(*top(t[1::2]).T, *force[1::2].T, color=SLIP, angles="xy", width=0.006, scale=3.5, label="friction")
    way.set(xlabel="$x_1$ (mm)", ylabel="$x_2$ (mm)", aspect="equal")
    way.margins(0.16)
    legend_under(way)
    light_grid(way)
    for axis, (colour, mark) in enumerate((("#0072B2", "o"), ("#D55E00", "s"))):
        label = f"$F_{axis + 1}$"
        marks, exact = (0.5 * (t[1:] + t[:-1]), force[1:, axis]), (dense[1:], line[:, axis])
        beside_closed_form(graph, marks, exact, colour=colour, marker=mark, label=label, exact_label=None)
    graph.set(xlabel="t (s)", ylabel="friction on the block / P", ylim=(-0.38, 0.45))
    return figure
