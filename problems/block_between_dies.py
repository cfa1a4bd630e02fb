r"""A block between inclined dies that close along their normals: the same pressure on all dies and on the floor.

A quadrilateral block in plane strain lies on a smooth floor, y = 0. Three smooth dies lie on its other sides; none of
these sides is parallel to an axis. Let c be a point of the floor, and e a rate. The distance of c from a side with the
outward normal n is n . (x - c), for any point x of the side. The die on this side moves by e t times this distance,
along -n. Then

$$ u = -e t (x - c), \qquad \sigma = -p I, \qquad p = 2 (\lambda + \mu) e t = E e t / ((1 + \nu) (1 - 2 \nu)), $$

with Lame's moduli lambda and mu. The solution holds for all angles, because n . (x - c) is constant along a straight
side. The force on a die or on the floor is p times the length of its side. The floor is a unilateral contact. The
displacement is linear, hence exact on every mesh.

    vemcvx run problems/block_between_dies.py --mesh voronoi --n 8 --steps 4 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, CLOSING = 100.0, 0.3, 0.02
CORNERS = np.array([[0.0, 0.0], [2.0, 0.0], [2.5, 1.1], [0.35, 1.6]])
FOOT = np.array([1.0, 0.0])
DIES = {"right": 1, "top": 2, "left": 3}
"""Numbers of the sides; the floor is side 0."""
MAGNIFIED = 5.0
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 10, "steps": 4}


def normal(side):
    """Return the outward normal and the length of a side."""
    along = CORNERS[(side + 1) % 4] - CORNERS[side]
    length = np.linalg.norm(along)
    return np.array([along[1], -along[0]]) / length, length


def pressure(t):
    return YOUNG * CLOSING * t / ((1 + POISSON) * (1 - 2 * POISSON))


def die(name):
    n, _ = normal(DIES[name])
    distance = n @ (CORNERS[DIES[name]] - FOOT)
    return vx.PrescribedDisplacement(lambda x, t: np.full(len(x), -CLOSING * t * distance), on=name, direction="normal")


def scene(young=YOUNG, poisson=POISSON):
    return vx.Scene(vx.Elasticity(young, poisson), *map(die, DIES), vx.UnilateralContact(on="bottom"))


def mesh(n, family="voronoi"):
    """Return a mesh of the unit square, mapped bilinearly to the block."""
    flat = vx.meshes.FAMILIES[family](n)
    x, y = flat.points.T
    weights = np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=1)
    names = {name: edges for name, edges in flat.boundaries.items() if name != "boundary"}
    return vx.PolygonMesh(weights @ CORNERS, flat.cells, boundaries=names)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """Draw the block between its dies, and the pressure on the floor as the dies close."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    vx.plots.stressed_body(history, ax=body, stress="mean", magnify=MAGNIFIED, units=UNITS)
    corners = CORNERS - MAGNIFIED * CLOSING * (CORNERS - FOOT)  # the dies move with the magnified block
    for side in DIES.values():
        n, _ = normal(side)
        ends = corners[[side, (side + 1) % 4]] + 0.03 * n
        body.plot(*ends.T, color="0.3", linewidth=4, solid_capstyle="butt")
        head = ends.mean(axis=0)
        body.annotate("", head, head + 0.3 * n, arrowprops={"arrowstyle": "-|>", "color": "0.3", "linewidth": 2})
        body.update_datalim([head + 0.32 * n])
    body.autoscale_view()
    contact = history.contact
    inner = (contact.points[:, 0] > 0) & (contact.points[:, 0] < CORNERS[1, 0])
    graph.plot([0, 1], [0, pressure(1.0)], "k-", label="closed form")
    lines = graph.plot(history.times, contact.pressure[:, inner], "C0o")
    lines[0].set_label("at every node of the floor")
    graph.set(xlabel="t (s)", ylabel="pressure on the floor (MPa)")
    graph.grid()
    graph.legend()
    return figure
