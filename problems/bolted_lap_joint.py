r"""Two lapped plates clamped by two bolts, in space: friction transmits the pull until the plates slip.

Each bolt goes through a hole in each plate. The bolt fits the hole of the lower plate and has the clearance c in the
upper hole. Half of the joint, y > 0, is computed. Up to t = 1 the bolts are tightened: the shank between head and nut
shortens by t times TIGHTENING. In the model, the gap under the head is minus this length. Then the end of the upper
plate is moved along x.
Heads, nuts and walls of the holes are smooth, so that the bolts transmit no shear before they touch the walls of the
upper holes. Let N be the force that presses the plates together. At each instant, up to rounding,

$$
\text{pull } = \text{ friction between the plates } + \text{ pressure of the bolts on the walls of the upper
plate}, \qquad \text{friction } \le \mu N, \\
N = \text{ tension of the bolts } + \text{ transverse forces at the ends of the plates}.
$$

When friction reaches mu N, the plates slip by c at constant pull. Then the bolts press on the walls and transmit the
rest of the pull.

    vemcvx run problems/bolted_lap_joint.py --n 4 --steps 20 --accuracy 1e-6 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, FRICTION = 210e3, 0.3, 0.2
THICK, SHANK, HOLE, HEAD, HALF, END = 6.0, 3.0, 4.0, 7.0, 12.0, 42.0
"""Thickness of a plate; radii of shank, hole and head; distances of a bolt and of a plate's end from the middle of the
joint."""
TIGHTENING, CLEARANCE, PULL = 0.05, 0.1, 0.16
LAP, BOLTS = "lower|upper", ("left", "right")
NUTS, HEADS = ([f"{plate}|{bolt}" for bolt in BOLTS] for plate in ("lower", "upper"))
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 20, "accuracy": 1e-6}


def scene(friction=FRICTION):
    def gap(x, t):
        return np.where(x[:, 2] > 0.9 * THICK, -TIGHTENING * min(t, 1.0), CLEARANCE)

    def pull(x, t):
        return np.tile([PULL * max(t - 1.0, 0.0), 0.0, 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.Symmetry(on=[f"{body}.front" for body in ("lower", "upper", *BOLTS)]),
        vx.Clamp(on="lower.left"),
        vx.PrescribedDisplacement(pull, on="upper.right"),
        vx.BilateralContact(on=NUTS),
        vx.UnilateralContact(on=HEADS, gap=gap),
        vx.UnilateralContact(on=LAP),
        vx.CoulombFriction(friction, on=LAP),
    )


def join_meshes(parts):
    """Return one mesh of adjacent meshes, with one node per place."""
    points, number = np.unique(np.concatenate([part.points for part in parts]).round(9), axis=0, return_inverse=True)
    numbers = np.split(number, np.cumsum([part.n_nodes for part in parts])[:-1])
    cells = [[new[face] for face in cell] for part, new in zip(parts, numbers, strict=True) for cell in part.cells]
    return vx.PolyhedralMesh(points, cells)


def tube(radii, n, heights):
    """Return half a tube with 4n sectors."""
    return vx.meshes.ring(radii, 4 * n, angles=(0.0, np.pi)).extruded(THICK * np.array(heights))


def grid(x, y):
    """Return the mesh of rectangles between the lines x and y."""
    lattice = vx.meshes.squares((len(x) - 1, len(y) - 1), box=((0, len(x) - 1), (0, len(y) - 1)))
    i, j = lattice.points.round().astype(int).T
    return vx.PolygonMesh(np.column_stack([x[i], y[j]]), lattice.cells)


def plate(n, side, heights):
    """Return a plate: two squares with holes, then rectangles up to the left (side -1) or right (side 1) end."""
    around = tube([HOLE, HEAD, HALF], n, heights)
    outer = np.hypot(*around.points[:, :2].T) > 0.5 * (HEAD + HALF)
    widening = np.where(outer, HALF / np.abs(around.points[:, :2]).max(axis=1), 1.0)[:, None] ** [1, 1, 0]
    holes = [vx.PolyhedralMesh(np.add(around.points * widening, [x, 0, 0]), around.cells) for x in (-HALF, HALF)]
    x, y = np.linspace(2 * HALF, END, n + 1), HALF * np.tan(np.arange(n + 1) * np.pi / (4 * n))
    return join_meshes([*holes, grid(x if side > 0 else -x[::-1], y).extruded(THICK * np.array(heights))])


def bolt(n, x):
    """Return a bolt: shank, head, nut, and a collar in each hole. Only the collars can touch the walls."""
    head, collar = (1.0, 1.6), (1 / 3, 2 / 3)
    parts = [tube([0.0, SHANK], n, [-1.6, -1.0, -2 / 3, -1 / 3, 0.0, 1 / 3, 2 / 3, 1.0, 1.6])]
    for radii, heights in (([SHANK, HOLE, HEAD], head), ([SHANK, HOLE], collar)):
        parts += tube(radii, n, heights), tube(radii, n, [-z for z in heights[::-1]])
    made = join_meshes(parts)
    return vx.PolyhedralMesh(np.add(made.points, [x, 0.0, 0.0]), made.cells)


def mesh(n, family="ring"):
    """Return the joint with 4n sectors around half a bolt and three layers in each plate."""
    lower, upper = plate(n, -1, [-1, -2 / 3, -1 / 3, 0]), plate(n, 1, [0, 1 / 3, 2 / 3, 1])
    return vx.meshes.bodies({"lower": lower, "upper": upper} | {BOLTS[k]: bolt(n, (2 * k - 1) * HALF) for k in (0, 1)})


def times(steps):
    """Return the instants: a fifth of the steps tighten the bolts, the others move the end."""
    first = max(1, steps // 5)
    return np.append(np.linspace(0.0, 1.0, first + 1), np.linspace(1.0, 2.0, steps - first + 1)[1:])


def forces_on_upper_plate(history):
    """Return the forces on half of the upper plate: from the lower plate, the heads and the collars."""
    contact = history.contact
    friction = contact.traction * contact.friction_lengths[:, None]
    force = friction - contact.pressure[:, :, None] * (contact.lengths[:, None] * contact.normals)
    z = contact.points[:, 2] / THICK
    lap, head, wall = np.abs(z) < 0.1, z > 0.9, (z > 0.1) & (z < 0.9)
    return np.stack([-force[:, lap].sum(axis=1), force[:, head].sum(axis=1), force[:, wall].sum(axis=1)])


def picture(history):
    """Draw a section of the joint when the bolts touch the walls, and the pull against the displacement of the end."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 3.4), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    vx.plots.deformed_body(history, ax=body, view=(-0.35, -1.0, 0.4), magnify=20, units=UNITS)
    pulled = history.times >= 1.0
    lap, _, wall = 2e-3 * forces_on_upper_plate(history)[:, pulled]
    end = 1000 * PULL * (history.times[pulled] - 1.0)
    graph.plot(end, 2e-3 * history.reaction("upper.right")[pulled, 0], "C0o-", linewidth=1.0, label="pull")
    graph.plot(end, -wall[:, 0], "C1s-", linewidth=1.0, label="carried by the bolts")
    graph.plot(end, FRICTION * lap[:, 2], "--", color="0.5", label=r"$\mu N$")
    graph.set(xlabel="displacement of the end (µm)", ylabel="force (kN)")
    graph.grid()
    graph.legend(loc="upper left")
    return figure
