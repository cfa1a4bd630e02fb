"""Meshes of a box in space: all families, prisms over nonconvex polygons, faces with hanging nodes."""

from __future__ import annotations

from functools import cache

import numpy as np
from refined_cubes import refined_cubes

import vemcvx as vx

SOLIDS = (*vx.meshes.SPACE_FAMILIES, "nonconvex prisms", "hanging faces")
SIDES = ("left", "right"), ("front", "back"), ("bottom", "top")


@cache
def solid(name, n, box):
    """Return a read-only mesh of a box, with about n cells per side."""
    if name == "nonconvex prisms":
        return vx.meshes.nonconvex(n, box[:2]).extruded(np.linspace(*box[2], n + 1))
    if name != "hanging faces":
        return vx.meshes.SPACE_FAMILIES[name](n, box)
    cubes, (low, high) = refined_cubes(n), np.transpose(box)
    mesh = vx.PolyhedralMesh(low + cubes.points / cubes.points.max() * (high - low), cubes.cells)
    for axis, names in enumerate(SIDES):
        for side, place in zip(names, box[axis], strict=True):
            mesh = mesh.with_boundary(side, lambda x, axis=axis, place=place: np.abs(x[:, axis] - place) < 1e-12)
    return mesh
