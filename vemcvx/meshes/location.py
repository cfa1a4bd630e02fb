"""Points inside cells, and the cells that points are inside of.

A point is inside a polygon if the edges pass it once more upwards than downwards on its right.
"""

from __future__ import annotations

import numpy as np

from vemcvx.meshes.geometry import Floats
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.ragged import offsets_of, spans
from vemcvx.meshes.segments import cross, overlapping_boxes
from vemcvx.meshes.topology import Ints, next_vertex, previous_corner
from vemcvx.meshes.triangulation import clip_ears

# Barycentric coordinates that no subdivision of the triangle has an edge through.
UNUSUAL = np.array([0.5318, 0.2903, 0.1779])


def inner_points(mesh: PolygonMesh) -> Floats:
    """A point inside of every cell, (n_cells, 2), on no line that refinement draws through cells."""
    x = mesh.points[mesh.vertices]
    edge = mesh.points[next_vertex(mesh.offsets, mesh.vertices)] - x
    right = cross(edge[previous_corner(mesh.offsets)], edge) < 0.0
    points = UNUSUAL[0] * mesh.centroids
    for place, weight in enumerate(UNUSUAL[1:]):
        points += weight * x[mesh.offsets[:-1] + place]
    # Rounding makes right turns of straight angles; their cells only take the longer way.
    others = np.flatnonzero(np.logical_or.reduceat(right, mesh.offsets[:-1]))
    counts = np.diff(mesh.offsets)[others]
    for count in np.unique(counts):
        cells = others[counts == count]
        corners = x[mesh.offsets[cells, None] + np.arange(count)]
        ears = clip_ears(corners - corners[:, :1])
        triangles = corners[np.arange(len(cells))[:, None, None], ears]
        sides = triangles[:, :, 1:] - triangles[:, :, :1]
        areas = sides[..., 0, 0] * sides[..., 1, 1] - sides[..., 0, 1] * sides[..., 1, 0]
        largest = triangles[np.arange(len(cells)), np.argmax(areas, axis=1)]
        points[cells] = np.einsum("v,cva->ca", UNUSUAL, largest)
    return points


def cells_around(mesh: PolygonMesh, points: Floats) -> Ints:
    """The cell that each point (m, 2) is inside of, -1 if none."""
    corners = mesh.points[mesh.vertices]
    low = np.minimum.reduceat(corners, mesh.offsets[:-1], axis=0)
    high = np.maximum.reduceat(corners, mesh.offsets[:-1], axis=0)
    point, cell = overlapping_boxes(points, points, low, high)
    found = np.full(len(points), -1)
    if len(point):
        counts = np.diff(mesh.offsets)[cell]
        edge = spans(mesh.offsets[cell], counts)
        start, end = corners[edge], mesh.points[next_vertex(mesh.offsets, mesh.vertices)[edge]]
        at = np.repeat(points[point], counts, axis=0)
        left = cross(end - start, at - start)
        upward = (start[:, 1] <= at[:, 1]) & (at[:, 1] < end[:, 1])
        downward = (end[:, 1] <= at[:, 1]) & (at[:, 1] < start[:, 1])
        passes = np.where(upward & (left > 0.0), 1, 0) - np.where(downward & (left < 0.0), 1, 0)
        inside = np.add.reduceat(passes, offsets_of(counts)[:-1]) == 1
        found[point[inside]] = cell[inside]
    return found
