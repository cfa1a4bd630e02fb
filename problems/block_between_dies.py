r"""A block between inclined dies that close along their normals: one pressure on all of them, and on the floor.

A quadrilateral block, plane strain, lies on a smooth floor, y = 0. Three smooth dies, none of them parallel to an
axis, lie on its other sides and close along their own normals n, each by e t times its distance n . (x - c) from a
point c of the floor. Then

$$ u = -e t (x - c), \qquad \sigma = -p I, \qquad p = 2 (\lambda + \mu) e t = E e t / ((1 + \nu) (1 - 2 \nu)), $$

whatever the angles: n . (x - c) is the same all along a straight side, and what has no shear anywhere needs none from
a smooth die. Each die bears p times its length, and so does the floor, which only pushes. The field is linear: exact
on every mesh.

    vemcvx run problems/block_between_dies.py --mesh voronoi --n 8 --steps 4 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph

YOUNG, POISSON, CLOSING = 100.0, 0.3, 0.02
CORNERS = np.array([[0.0, 0.0], [2.0, 0.0], [2.5, 1.1], [0.35, 1.6]])
FOOT = np.array([1.0, 0.0])
DIES = {"right": 1, "top": 2, "left": 3}
"""which side, counted from the floor"""
MAGNIFIED = 5.0
UNITS = MM
SMALL = {"n": 10, "steps": 4}


def normal(side):
    """Outwards, (2,), and the length of the side."""
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
    """Cells of the unit square, carried over by the bilinear map."""
    flat = vx.meshes.FAMILIES[family](n)
    x, y = flat.points.T
    shares = np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=1)
    names = {name: edges for name, edges in flat.boundaries.items() if name != "boundary"}
    return vx.PolygonMesh(shares @ CORNERS, flat.cells, boundaries=names)


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def picture(history):
    """The block between its dies, and the pressure on the floor as they close."""
    figure, graph = body_and_graph(history, stress="mean", magnify=MAGNIFIED, shares=(1.2, 1.0))
    body = figure.axes[0]
    # The motion of the dies is magnified with the block's, so that they are drawn on it.
    corners = CORNERS - MAGNIFIED * CLOSING * (CORNERS - FOOT)
    for side in DIES.values():
        n, _ = normal(side)
        ends = corners[[side, (side + 1) % 4]] + 0.03 * n
        body.plot(*ends.T, color="0.3", linewidth=4, solid_capstyle="butt")
        head = ends.mean(axis=0)
        body.annotate("", head, head + 0.3 * n, arrowprops={"arrowstyle": "-|>", "color": "0.3", "linewidth": 2})
        body.update_datalim([head + 0.32 * n])
    body.autoscale_view()
    x, contact = np.linspace(0, 1, 2), history.contact
    inner = (contact.points[:, 0] > 0) & (contact.points[:, 0] < CORNERS[1, 0])
    marks = (np.repeat(history.times, inner.sum()), contact.pressure[:, inner].ravel())
    beside_closed_form(graph, marks, (x, pressure(x)), label="at every node of the floor")
    graph.set(xlabel="t (s)", ylabel="pressure on the floor (MPa)")
    return figure
