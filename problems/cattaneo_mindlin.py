r"""Partial slip under a cylinder, pressed and then dragged: the contact sticks inside and slips at its edges.

A tangential force Q < mu P is added to the force P of Hertz' contact, where mu is the coefficient of friction. If
Dundurs' constant beta is 0, as for a rigid obstacle and a body with nu = 1/2, pressure alone causes no slip. Then the
traction of Cattaneo (1938) and Mindlin (1949) is a difference of two half-ellipses. Let a be the half-width of the
contact, c the half-width of its sticking part, and p_0 the largest pressure. Roots of negative numbers count as 0:

$$ |\text{traction}| = \mu p_0 (\sqrt{1-x^2/a^2} - \tfrac ca \sqrt{1-x^2/c^2}), \qquad c / a = \sqrt{1-Q/(\mu P)}, $$

(Johnson, *Contact Mechanics*, 7.2). The top of a wide block is pressed down on the obstacle and then moved sideways
without rotation; P and Q are the computed forces. Dragging also strains the surface of the finite block. Like a bulk
stress, this strain shifts the stick zone (Nowell and Hills, Int. J. Mech. Sci. 29, 1987) by about a/16. The width of
the stick zone does not change.

    vemcvx run problems/cattaneo_mindlin.py --n 20 --steps 8 --plot
"""

import numpy as np

import vemcvx as vx

RADIUS, YOUNG, POISSON, FRICTION, HALF_WIDTH = 1.0, 1000.0, 0.4999, 0.4, 0.02
REACH = 20 * HALF_WIDTH
PRESS, DRAG = 7e-4, 4.5e-4
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 16, "steps": 8}


def scene(friction=FRICTION, drag=DRAG):
    def move_top(x, t):
        down, aside = -PRESS * min(t, 1.0), drag * max(t - 1.0, 0.0)
        return np.tile([aside, down], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=YOUNG, poisson=POISSON),
        vx.PrescribedDisplacement(move_top, on="top"),
        vx.UnilateralContact(on="bottom", gap=lambda x, t: x[:, 0] ** 2 / (2 * RADIUS)),
        vx.CoulombFriction(friction, on="bottom"),
    )


def coordinates(n):
    """Return coordinates from 0 to `REACH`: steps of a/n up to 1.6 a, then growing steps."""
    line, step = list(np.arange(0.0, 1.6 * HALF_WIDTH, HALF_WIDTH / n)), HALF_WIDTH / n
    while line[-1] < REACH:
        step *= 1.15
        line.append(line[-1] + step)
    return np.array([*line[:-1], REACH])


def mesh(n, family="graded"):
    """Return rectangles that grow away from the contact."""
    up = coordinates(n)
    across = np.concatenate([-up[:0:-1], up])
    lattice = vx.meshes.squares((len(across) - 1, len(up) - 1), box=((0, len(across) - 1), (0, len(up) - 1)))
    i, j = lattice.points.round().astype(int).T
    return vx.PolygonMesh(np.column_stack([across[i], up[j]]), lattice.cells)


def times(steps):
    """Return the instants: a quarter of the steps press the block, the others drag it."""
    press = max(1, steps // 4)
    return np.concatenate([np.linspace(0, 1, press + 1), np.linspace(1, 2, steps - press + 1)[1:]])


def fit_half_ellipse(x, p):
    """Fit p^2 = p0^2 (1 - (x - m)^2 / a^2) to the points with p > .35 max p, by least squares; return (a, p0)."""
    inner = p > 0.35 * p.max()
    curve, tilt, level = np.polyfit(x[inner], p[inner] ** 2, 2)
    top = level - tilt**2 / (4 * curve)
    return np.sqrt(-top / curve), np.sqrt(top)


def stick_half_width(history):
    """Return c by two measures: from a fit to the friction q, and from sticking nodes.

    The fit is (mu p - |q|)^2 = (mu p0 c/a)^2 (1 - (x - m)^2 / c^2), where m is free.
    """
    contact = history.contact
    x, pressure = contact.points[:, 0], contact.pressure[-1]
    spare = FRICTION * pressure - np.abs(contact.traction[-1][:, 0])
    fit = fit_half_ellipse(x, np.maximum(spare, 0.0))[0]
    return fit, np.abs(x[contact.sticking[-1] & (pressure > 1e-6)]).max()


def picture(history):
    """Draw the block dragged over the cylinder, and its friction."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2)
    reach = 2.2 * HALF_WIDTH
    window = ((-reach, reach), (-0.3 * reach, 1.5 * reach))
    vx.plots.stressed_body(history, ax=body, stress="shear", window=window, units=UNITS)
    contact = history.contact
    order = np.argsort(contact.points[:, 0])
    order = order[np.abs(contact.points[order, 0]) < 1.5 * HALF_WIDTH]
    x, traction, sticks = contact.points[order, 0], np.abs(contact.traction[-1][order, 0]), contact.sticking[-1][order]
    Q, P = np.abs(history.force("bottom")[-1])
    a, ratio = np.sqrt(4 * P * RADIUS * (1 - POISSON**2) / (np.pi * YOUNG)), np.sqrt(1 - Q / (FRICTION * P))
    stuck = x[sticks & (contact.pressure[-1][order] > 1e-6)]
    line, shift, bound = np.linspace(-a, a, 1601), 0.5 * (stuck.min() + stuck.max()), FRICTION * 2 * P / (np.pi * a)
    hertz = bound * np.sqrt(1 - (line / a) ** 2)
    inner = bound * ratio * np.sqrt(np.maximum(1 - ((line - shift) / (ratio * a)) ** 2, 0.0))
    graph.plot(line, hertz, "--", color="0.5", label=r"bound $\mu p$ (Hertz)")
    graph.plot(line, hertz - inner, "k-", label="Cattaneo and Mindlin")
    graph.plot(x[~sticks], traction[~sticks], "C1s", fillstyle="none", label="slips")
    graph.plot(x[sticks], traction[sticks], "C0o", label="sticks")
    graph.set(xlabel="$x_1$ (mm)", ylabel="friction (MPa)", ylim=(0, 1.45 * bound))
    graph.set_title("stick zone shifted as by a bulk stress", fontsize="small")
    graph.grid()
    graph.legend(ncols=2, loc="upper center")
    return figure
