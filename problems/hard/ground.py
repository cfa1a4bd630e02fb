"""Scenes and meshes of the cases: the block of Feng, Han and Huang, and a sheared block with a closed form."""

from __future__ import annotations

from functools import cache

import numpy as np

import frictional_hysteresis as hysteresis
import vemcvx as vx
from hard.case import Setting

TIMES = np.linspace(0.0, 1.0, 9)
HYSTERESIS_STEPS = 10


@cache
def voronoi(n):
    """Return the unit square in n x n Voronoi cells; the mesh is cached."""
    return vx.meshes.voronoi(n)


def cyclic(t):
    return np.sin(2 * np.pi * t)


def block(course=cyclic, *, young=200.0, poisson=0.3, bound=4.0, clamp="right", contact="bottom", plane="strain"):
    """Return the block of Feng, Han and Huang, with the load multiplied by `course(t)`."""

    def pull(x, t):
        return np.column_stack([8 * (1.25 - x[:, 1]) * course(t), np.full(len(x), -0.01 * course(t))])

    effects = [vx.Elasticity(young=young, poisson=poisson, plane=plane), vx.Traction(pull, on="left")]
    if clamp:
        effects.append(vx.Clamp(on=clamp))
    if contact:
        effects.append(vx.BilateralContact(on=contact))
    if bound is not None:
        effects.append(vx.TrescaFriction(bound=bound, on="bottom"))
    return vx.Scene(*effects)


def on(mesh, course=cyclic, *, times=TIMES, **settings):
    """Return the setting of `block` on a mesh."""
    return Setting(block(course, **settings), mesh, times)


def shear_block(mesh, origin=(0.0, 0.0)):
    """Return a setting with a block that is sheared back and forth; `mesh` covers (0, 2) x (0, 1/2)."""
    instants = hysteresis.times(HYSTERESIS_STEPS)
    exact = hysteresis.exact(mesh.points, instants, floor=origin[1])
    return Setting(hysteresis.scene(), name_sides(mesh), instants, exact)


def name_sides(mesh):
    """Return a mesh of a rectangle with names for its sides."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    for name, axis, value in (("left", 0, low), ("right", 0, high), ("bottom", 1, low), ("top", 1, high)):
        mesh = mesh.with_boundary(name, lambda x, axis=axis, value=value: x[:, axis] == value[axis])
    return mesh


def fit_box(points, cells):
    """Return a mesh of the unit square stretched to (0, 2) x (0, 1/2)."""
    return vx.PolygonMesh(np.asarray(points) * [2.0, 0.5], cells)


def draw_cells(*rows):
    """Return points and cells of the unit square: the small squares with the same letter in `rows` form one cell."""
    picture = np.array([list(row) for row in rows[::-1]])
    height, width = picture.shape
    number = np.arange((width + 1) * (height + 1)).reshape(height + 1, width + 1)
    cells = []
    for letter in np.unique(picture):
        edges = set()
        for j, i in np.argwhere(picture == letter):
            corners = number[j, i], number[j, i + 1], number[j + 1, i + 1], number[j + 1, i]
            for a, b in zip(corners, (*corners[1:], corners[0]), strict=True):
                edges ^= {(a, b)} if (b, a) not in edges else {(b, a)}
        cells.append(trace_outline(dict(edges)))
    used, renumbered = np.unique(np.concatenate(cells), return_inverse=True)
    points = np.column_stack([used % (width + 1) / width, used // (width + 1) / height])
    return points, np.split(renumbered, np.cumsum([len(cell) for cell in cells])[:-1])


def trace_outline(follows):
    """Return the outline of a cell; `follows` maps each of its nodes to the next one."""
    start = node = next(iter(follows))
    outline = []
    while not outline or node != start:
        outline.append(node)
        node = follows[node]
    return outline


def split_nodes(n, part):
    """Return squares in which each inner node is a pair of nodes, at x and at x + (part, part) / n."""
    mesh = vx.meshes.squares(n)
    inside = np.flatnonzero((np.abs(mesh.points - 0.5) < 0.5 - 0.25 / n).all(axis=1))
    twin = np.full(mesh.n_nodes, -1)
    twin[inside] = mesh.n_nodes + np.arange(len(inside))
    points = np.vstack([mesh.points, mesh.points[inside] + part / n])
    cells = []
    for lower_left, lower_right, upper_right, upper_left in mesh.cells:
        # Around a split node, the lower left cell keeps the node and the upper right cell has its twin. The other two
        # cells have both nodes.
        corners = [
            [lower_left if twin[lower_left] < 0 else twin[lower_left]],
            [lower_right],
            [upper_right],
            [upper_left],
        ]
        if twin[lower_right] >= 0:
            corners[1] = [lower_right, twin[lower_right]]
        if twin[upper_left] >= 0:
            corners[3] = [twin[upper_left], upper_left]
        cells.append([node for corner in corners for node in corner])
    return points, cells
