r"""A block dragged along a figure of eight: its friction has a constant magnitude and turns with the path.

A block 2 x 2 x 1/2 with E = 1000, nu = 1/4 lies on a rigid floor with Coulomb friction of the coefficient mu. A plate
is bonded to the top of the block. Before t = 0 the plate goes down by 1/500 of the height of the block. Then the plate
is dragged, with R = 0.1, along

$$ U(t) = R (\sin t, \sin(2 t) / 2), \qquad 0 \le t \le 2 \pi. $$

Let P be the normal force on the sole, the bottom of the block. In full slip, the friction force on the sole is

$$ F = -\mu P U' / |U'|, $$

opposite to the velocity U'. Backward Euler replaces U' by the step U_n - U_{n-1}. Let H be the height of the block, G
its shear modulus and p = P / 4 the pressure. The sole lags behind the plate by the shear displacement r = mu p H / G.
Friction opposes the velocity of the sole. The direction of this velocity differs from the direction of U' by an angle
O(r / R_c), where R_c is the radius of curvature of the path. The formula for F neglects this angle.

    vemcvx run problems/block_dragged_along_a_curve.py --n 3 --steps 48 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, SIDE, HEIGHT = 1000.0, 0.25, 2.0, 0.5
DEPTH, FRICTION, RADIUS = HEIGHT / 500, 0.3, 0.1
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 2, "steps": 32}


def top(t):
    """Return the displacement U(t) of the plate, (..., 2)."""
    return RADIUS * np.stack([np.sin(t), 0.5 * np.sin(2 * np.asarray(t))], axis=-1)


def friction(instants):
    """Return F / P in each step, (N, 2); F is opposite to the motion in the step."""
    steps = np.diff(top(instants), axis=0)
    return -FRICTION * steps / np.linalg.norm(steps, axis=1, keepdims=True)


def scene(coefficient=FRICTION, crown=0.0):
    """Return the scene; the floor is a paraboloid that falls by `crown` at the distance SIDE / 2 from its middle."""

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


def sole_friction(history):
    """Return the computed F / P, (N + 1, 2)."""
    contact = history.contact
    force = np.einsum("smd,m->sd", contact.traction, contact.friction_lengths)[:, :2]
    return force / (contact.pressure @ contact.lengths)[:, None]


def picture(history):
    """Draw the path with the friction on the block, and the components of friction against time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    path, graph = figure.subplots(1, 2)
    t, dense = history.times, np.linspace(0.0, 2 * np.pi, 801)
    force, exact = sole_friction(history), friction(dense)
    path.plot(*top(dense).T, color="0.7", linewidth=0.8, label="path of the plate")
    arrows = {"color": "C1", "angles": "xy", "width": 0.006, "scale": 3.5}
    path.quiver(*top(t[1::2]).T, *force[1::2].T, **arrows, label="friction on the block")
    path.set(xlabel="$x_1$ (mm)", ylabel="$x_2$ (mm)", aspect="equal")
    path.margins(0.16)
    path.legend(loc="upper center", bbox_to_anchor=(0.5, -0.22), ncols=2)
    for axis, style in enumerate(("C0o", "C1s")):
        graph.plot(dense[1:], exact[:, axis], f"C{axis}-", label=f"$F_{axis + 1}$, closed form")
        graph.plot(0.5 * (t[1:] + t[:-1]), force[1:, axis], style, label=f"$F_{axis + 1}$")
    graph.set(xlabel="t (s)", ylabel="friction on the block / P", ylim=(-0.38, 0.5))
    graph.legend(ncols=2, loc="upper center")
    for ax in (path, graph):
        ax.grid()
    return figure
