r"""Two plates lapped and clamped together by two bolts, in space: the joint slips at mu times their tension, and bears.

The bolts go through holes of both plates, which they fit in the lower one and have the clearance c in the upper one;
half of all, y > 0, is computed. Up to t = 1 they are tightened: by turns of the nuts that would bring heads and plates
into each other by delta, which is posed as the gap -delta t under the heads. Then the end of the upper plate is moved
along x. Heads, nuts and walls are greased, so that bolts bear no shear before walls do, and at each instant

$$
\text{pull } = \text{ friction between the plates } + \text{ pressure of the bolts on the walls of the upper
plate}, \qquad \text{friction } \le \mu N, \\
N, \text{ which presses the plates together } = \text{ tension of the bolts } + \text{ what the ends of the plates
bear across},
$$

to rounding. At friction = mu N the plates slip by c at one pull, and the bolts bear what comes on top of it.

    vemcvx run problems/bolted_lap_joint.py --n 4 --steps 20 --accuracy 1e-6 --plot
"""

import numpy as np

import vemcvx as vx
from hertz_contact import grid
from problem_pictures import MM
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots import deformed_body
from vemcvx.plots.style import COMPUTED, SECOND

YOUNG, POISSON, FRICTION = 210e3, 0.3, 0.2
THICK, SHANK, HOLE, HEAD, HALF, END = 6.0, 3.0, 4.0, 7.0, 12.0, 42.0
"""Of a plate; radii of shank, hole and head; half the distance of the bolts; how far the plates reach."""
TIGHTENED, CLEARANCE, PULLED = 0.05, 0.1, 0.16
LAP, BOLTS = "lower|upper", ("left", "right")
NUTS, HEADS = ([f"{plate}|{bolt}" for bolt in BOLTS] for plate in ("lower", "upper"))
UNITS = MM
SMALL = {"n": 4, "steps": 20, "accuracy": 1e-6}


def scene(friction=FRICTION):
    def gap(x, t):
        return np.where(x[:, 2] > 0.9 * THICK, -TIGHTENED * min(t, 1.0), CLEARANCE)

    def pulled(x, t):
        return np.tile([PULLED * max(t - 1.0, 0.0), 0.0, 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.Symmetry(on=[f"{body}.front" for body in ("lower", "upper", *BOLTS)]),
        vx.Clamp(on="lower.left"),
        vx.PrescribedDisplacement(pulled, on="upper.right"),
        vx.BilateralContact(on=NUTS),
        vx.UnilateralContact(on=HEADS, gap=gap),
        vx.UnilateralContact(on=LAP),
        vx.CoulombFriction(friction, on=LAP),
    )


def joined(parts):
    """Meshes that lie side by side, as one, with one node a place."""
    points, number = np.unique(np.concatenate([part.points for part in parts]).round(9), axis=0, return_inverse=True)
    numbers = np.split(number, np.cumsum([part.n_nodes for part in parts])[:-1])
    cells = [[new[face] for face in cell] for part, new in zip(parts, numbers, strict=True) for cell in part.cells]
    return vx.PolyhedralMesh(points, cells)


def tube(radii, n, heights):
    """Half of one, 4n sectors around."""
    return vx.meshes.ring(radii, 4 * n, angles=(0.0, np.pi)).extruded(THICK * np.array(heights))


def plate(n, side, heights):
    """Two holes in squares, and rectangles from there to the end on the side -1 or 1."""
    made = tube([HOLE, HEAD, HALF], n, heights)
    outer = np.hypot(*made.points[:, :2].T) > 0.5 * (HEAD + HALF)
    blown_up = np.where(outer, HALF / np.abs(made.points[:, :2]).max(axis=1), 1.0)[:, None] ** [1, 1, 0]
    holes = [vx.PolyhedralMesh(np.add(made.points * blown_up, [x, 0, 0]), made.cells) for x in (-HALF, HALF)]
    x, y = np.linspace(2 * HALF, END, n + 1), HALF * np.tan(np.arange(n + 1) * np.pi / (4 * n))
    return joined([*holes, grid(x if side > 0 else -x[::-1], y).extruded(THICK * np.array(heights))])


def bolt(n, x):
    """Shank, head and nut, and a collar in the hole of each plate."""
    head, collar = (1.0, 1.6), (1 / 3, 2 / 3)
    parts = [tube([0.0, SHANK], n, [-1.6, -1.0, -2 / 3, -1 / 3, 0.0, 1 / 3, 2 / 3, 1.0, 1.6])]
    for radii, heights in (([SHANK, HOLE, HEAD], head), ([SHANK, HOLE], collar)):
        parts += tube(radii, n, heights), tube(radii, n, [-z for z in heights[::-1]])
    made = joined(parts)
    return vx.PolyhedralMesh(np.add(made.points, [x, 0.0, 0.0]), made.cells)


def mesh(n, family="ring"):
    """4n sectors around half a bolt, three layers of the plates."""
    lower, upper = plate(n, -1, [-1, -2 / 3, -1 / 3, 0]), plate(n, 1, [0, 1 / 3, 2 / 3, 1])
    return vx.meshes.bodies({"lower": lower, "upper": upper} | {BOLTS[k]: bolt(n, (2 * k - 1) * HALF) for k in (0, 1)})


def times(steps):
    """A fifth of the steps, one at least, tighten; the others pull."""
    first = max(1, steps // 5)
    return np.append(np.linspace(0.0, 1.0, first + 1), np.linspace(1.0, 2.0, steps - first + 1)[1:])


def on_the_upper_plate(history):
    """Forces of lower plate, heads and collars on half the upper plate, at the stored instants, (3, S, 3)."""
    contact = history.contact
    friction = contact.traction * contact.friction_lengths[:, None]
    force = friction - contact.pressure[:, :, None] * (contact.lengths[:, None] * contact.normals)
    z = contact.points[:, 2] / THICK
    lap, head, wall = np.abs(z) < 0.1, z > 0.9, (z > 0.1) & (z < 0.9)
    return np.stack([-force[:, lap].sum(axis=1), force[:, head].sum(axis=1), force[:, wall].sum(axis=1)])


def picture(history):
    """Section and half of the joint as the bolts bear, and the pull over the way of the end, beside mu N."""
    figure = new_figure(8.4, 3.4)
    body, graph = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    deformed_body(history, ax=body, view=(-0.35, -1.0, 0.4), magnify=20, units=UNITS)
    lap, _, wall = 2e-3 * on_the_upper_plate(history)
    way = 1000 * PULLED * np.maximum(history.times - 1.0, 0.0)
    pull, bound = 2e-3 * history.reaction("upper.right")[:, 0], FRICTION * lap[:, 2]
    pulled = history.times >= 1.0
    graph.plot(way[pulled], pull[pulled], "o-", color=COMPUTED, markersize=4, linewidth=1.0, label="pull")
    graph.plot(
        way[pulled], -wall[pulled, 0], "s-", color=SECOND, markersize=4, linewidth=1.0, label="of it, bolts on walls"
    )
    graph.plot(way[pulled], bound[pulled], "--", color="0.5", linewidth=1.2, label=r"$\mu N$")
    light_grid(graph)
    graph.legend(frameon=False, fontsize="small", loc="upper left")
    graph.set(xlabel="way of the end (\u00b5m)", ylabel="force (kN)")
    return figure
