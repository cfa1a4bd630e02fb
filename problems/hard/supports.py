"""Supports: a short clamp, friction alone, no support at all; bodies in two parts and bodies with hinges."""

from __future__ import annotations

import numpy as np

import vemcvx as vx
from hard.case import REFUSAL, WARNING, Case, Setting
from hard.ground import TIMES, cyclic, on, voronoi

MESH = voronoi(10)
ALONE = "nothing but friction or one-sided contact holds the body against the translation (1, 0)"


def slab(force, bound=4.0, course=cyclic):
    def pull(x, t):
        return np.tile([force * course(t), 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=bound, on="bottom"),
    )


def is_balanced(setting, history):
    """Return "" if friction alone balances the load, else the fault."""
    load = 3.8 * cyclic(TIMES)
    left = np.abs(history.force("bottom")[:, 0] + load).max()
    return "" if left <= 1e-5 * 3.8 else f"friction is {left:.1e} off balance"


def clamp_one_edge():
    """Return a body clamped at the two nodes of one edge."""
    mesh = vx.meshes.squares(10).with_boundary("spot", lambda x: (x[:, 0] > 0.999) & (x[:, 1] > 0.9))
    return on(mesh, clamp="spot")


def parts(**second):
    mesh = vx.meshes.squares(4)
    points = np.vstack([mesh.points, mesh.points + np.array([2.0, 0.0])])
    both = vx.PolygonMesh(points, [*mesh.cells, *(cell + mesh.n_nodes for cell in mesh.cells)])
    for name, here in (
        ("left", lambda x: x[:, 0] == 0),
        ("right", lambda x: x[:, 0] == 1),
        ("bottom", lambda x: (x[:, 1] == 0) & (x[:, 0] < 1)),
        ("second", lambda x: x[:, 0] == 3),
    ):
        both = both.with_boundary(name, here)
    return on(both, **second)


def hinge():
    points = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 1), (2, 2), (1, 2)]
    mesh = vx.PolygonMesh(points, [[0, 1, 2, 3], [2, 4, 5, 6]])
    for name, axis, value in (("left", 0, 0), ("bottom", 1, 0), ("right", 0, 1)):
        mesh = mesh.with_boundary(name, lambda x, axis=axis, value=value: (x[:, axis] == value) & (x[:, 1] < 1))
    return on(mesh)


CASES = (
    Case("no clamp, friction holds", lambda: Setting(slab(3.8), MESH, TIMES), WARNING, ALONE, is_balanced),
    Case("no clamp, friction just holds", lambda: Setting(slab(4 - 1e-9), MESH, TIMES), WARNING, ALONE),
    Case(
        "no clamp, friction cannot hold",
        lambda: Setting(slab(4.5), MESH, TIMES),
        REFUSAL,
        "The load pushes it in this motion with a force of 4.5, and friction resists with at most 4: 0.5 is missing",
    ),
    Case(
        "no clamp, no friction",
        lambda: on(MESH, clamp=None, bound=None),
        REFUSAL,
        "floats: neither a support nor friction prevents 1 rigid motion: the translation (1, 0)",
    ),
    Case(
        "no support at all", lambda: on(MESH, clamp=None, contact=None, bound=None), REFUSAL, "its loads do not balance"
    ),
    Case("a clamp of one edge", clamp_one_edge),
    Case("a second part without support", parts, REFUSAL, "part 2 of 2 of the body floats"),
    Case("two parts, both held", lambda: parts(clamp=["right", "second"])),
    Case("a hinge", hinge, REFUSAL, "several connected pieces"),
)
