"""Points at which an estimate looks at data: closer together than nodes and quadrature points, by a declared number.

On the boundary 1/512 of the size of the body apart and at least four an edge, inside 1/128 and at least four a
triangle. What is narrower than that, and between these points, is not seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.estimate.budget.skeleton import Skeleton
from vemcvx.estimate.measures.convex_parts import convex_pieces
from vemcvx.meshes.polygons.topology import positions
from vemcvx.meshes.polygons.triangles import fans, places
from vemcvx.vem import Space

ON_BOUNDARY, INSIDE = 512, 128
LEAST = 4


@dataclass(frozen=True)
class SamplePoints:
    """Points (q, 2) with the weights (q,) of a midpoint rule: lengths, or areas."""

    x: Floats
    weights: Floats
    owner: Ints
    """(q,) the boundary edge of the skeleton, or the cell"""
    along: Floats
    """(q,) in (0, 1), from the first end of the edge to the second; empty inside"""


def on_edges(edges: Skeleton, points: Floats, chosen: Ints) -> SamplePoints:
    """SamplePoints on boundary edges that are given by their nodes (m, 2)."""
    which = positions(chosen, edges.outer_edges, len(points))
    length = edges.lengths[which]
    size = np.ptp(points, axis=0).max()
    counts = np.maximum(np.ceil(length * ON_BOUNDARY / size).astype(np.int64), LEAST)
    row = np.repeat(np.arange(len(which)), counts)
    place = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    along = (place + 0.5) / counts[row]
    start, stop = (points[edges.outer_edges[which, side]][row] for side in range(2))
    return SamplePoints(start + along[:, None] * (stop - start), (length / counts)[row], which[row], along)


def in_cells(space: Space) -> SamplePoints:
    """SamplePoints in all cells: centroids of the triangles into which those of a cell are cut, in halves."""
    pieces = convex_pieces(space)
    triangles, areas, owner = fans(pieces.corners, pieces.owner)
    spacing = np.ptp(space.mesh.points, axis=0).max() / INSIDE
    halved = np.maximum(np.ceil(0.5 * np.log2(2.0 * areas / spacing**2)), 1).astype(np.int64)
    parts = []
    for times in np.unique(halved):
        these = np.flatnonzero(halved == times)
        x = places(triangles[these], _centroids(int(times)))
        count = x.shape[1]
        parts.append((x.reshape(-1, 2), np.repeat(areas[these] / count, count), np.repeat(owner[these], count)))
    x, weights, cells = (np.concatenate(part) for part in zip(*parts, strict=True))
    return SamplePoints(x, weights, cells, np.zeros(0))


def _centroids(times: int) -> Floats:
    """Barycentric coordinates (4^times, 3) of the centroids of a triangle that was cut in four so many times."""
    corners = np.eye(3)[None]
    for _ in range(times):
        middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
        tips = [np.stack([corners[:, k], middles[:, k], middles[:, k - 1]], axis=1) for k in range(3)]
        corners = np.concatenate([*tips, middles])
    centroids: Floats = corners.mean(axis=1)
    return centroids
