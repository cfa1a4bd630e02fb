r"""The dovetail root of a blade in its slot: pulled more on one end of the slot than on the other, and let go.

The root is a trapezoid in a slot along z, whose flanks lean by b from the pull; half of it, x > 0, is computed. Of the
whole blade the top bears P(t) (1 + c z / l), -l < z < l: one end of the slot is pressed harder. Forces balance exactly,
with N the normal force of a flank and T that of friction, towards the slot's floor as it slides out:

$$ N \sin b + T \cos b = P / 2, \qquad \text{moment of the flank's forces about } x = -c l P / 6. $$

Friction is at most mu N, so that N stays between the lines of full slip,

$$ P / (2 (\sin b + \mu \cos b)) \le N \le P / (2 (\sin b - \mu \cos b)), $$

on the first while the root slides out and on the second while it slides in, as far as places slip straight along the
flank. Between them it sticks, and N hardly falls with the pull (which wears the roots of turbine blades).

    vemcvx run problems/dovetail.py --n 3 --steps 16 --accuracy 1e-6 --plot
"""

import numpy as np

import vemcvx as vx
from hertz_contact import grid
from problem_pictures import MM
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots import deformed_body
from vemcvx.plots.style import COMPUTED

YOUNG, POISSON, FRICTION = 1000.0, 0.3, 0.15
LEAN = np.radians(30.0)
NECK, ROOT, BLADE, OUTER, HALF = 0.6, 1.0, 0.6, 2.4, 1.0
"""Half the width of the neck; heights of root and blade; half the width of the disc; half the length of the slot."""
PULL, SLANT = 4.0, 0.5
"""P at its largest, and c."""
OUT, IN = (0.5 / (np.sin(LEAN) + sign * FRICTION * np.cos(LEAN)) for sign in (1.0, -1.0))
JOINT = "blade|disc"
UNITS = MM
SMALL = {"n": 3, "steps": 16, "accuracy": 1e-6}


def load(t):
    """P(t): up, down to a quarter, and up again."""
    return PULL * np.interp(t, [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.25, 1.0])


def scene(friction=FRICTION, slant=SLANT):
    def pull(x, t):
        stress = 0.5 * load(t) / (2 * HALF * NECK) * (1 + slant * x[:, 2] / HALF)
        return np.column_stack([0 * stress, stress, 0 * stress])

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.Symmetry(on="blade.left"),
        vx.Clamp(on=["disc.front", "disc.right"]),
        vx.Traction(pull, on="blade.back"),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


def flank(y):
    """Half the width of root and neck at a height."""
    return NECK + np.tan(LEAN) * np.maximum(-y, 0.0)


def solid(x, y, layers, inside):
    """Hexahedra over rectangles between lines x and y, whose left or right side is moved to the flank."""
    made = grid(x, y).extruded(np.linspace(-HALF, HALF, layers + 1))
    named = {name: faces for name, faces in made.boundaries.items() if name != "boundary"}
    points, side = made.points.copy(), flank(made.points[:, 1])
    part = (points[:, 0] - x[0]) / (x[-1] - x[0])
    points[:, 0] = part * side if inside else side + part * (OUTER - side)
    return vx.PolyhedralMesh(points, made.cells, boundaries=named)


def mesh(n, family="hexahedra"):
    """The blade n cells across its neck, and 4n/3 along the slot; the disc in others."""
    across, root = np.linspace(0.0, 1.0, n + 1), np.linspace(-ROOT, 0.0, 2 * n + 1)
    blade = solid(across, np.append(root, np.linspace(0.0, BLADE, n + 1)[1:]), 2 * n, True)
    disc = solid(np.linspace(0.0, 1.0, 2 * n + 1), np.linspace(-ROOT, 0.0, 2 * n + 2), 2 * n + 1, False)
    return vx.meshes.bodies({"blade": blade, "disc": disc})


def times(steps):
    return np.linspace(0.0, 3.0, steps + 1)


def nodal_forces(history):
    """What the joint exerts on the blade at its nodes, at the stored instants, (S, m, 3)."""
    contact = history.contact
    friction = contact.traction * contact.friction_lengths[:, None]
    return friction - contact.pressure[:, :, None] * (contact.lengths[:, None] * contact.normals)


def normal_force(history):
    """N at the stored instants, (S,)."""
    return history.contact.pressure @ history.contact.lengths


def picture(history):
    """The pulled root and its slot, and the normal force of the flank over the pull, between the lines of full slip."""
    figure = new_figure(8.4, 3.4)
    body, graph = figure.subplots(1, 2)
    deformed_body(history, ax=body, view=(-0.8, 0.9, 1.6), units=UNITS)
    pull = np.array([0.0, PULL])
    for slope, words, side in ((OUT, " slides out", "left"), (IN, "slides in ", "right")):
        graph.plot(pull, slope * pull, color="0.5", linestyle="--", linewidth=1.2)
        at, above = 0.4 * PULL, "top" if slope == OUT else "bottom"
        graph.text(at, slope * at, words, fontsize="small", color="0.3", va=above, ha=side)
    graph.plot(load(history.times), normal_force(history), "o-", color=COMPUTED, markersize=4, label="computed")
    light_grid(graph)
    graph.legend(frameon=False, fontsize="small", loc="lower right")
    graph.set(xlabel="pull $P$ (N)", ylabel="normal force $N$ (N)", xlim=(0, None), ylim=(0, 1.6 * OUT * PULL))
    return figure
