"""Cells in convex pieces: convex cells as they are, others cut into triangles.

A cell counts as convex if every vertex lies left of the line through every edge, up to CONVEX times the size of the
cell: that is what clipping by these lines relies on. (Neighbouring edges alone would not do: an edge of 1e-12 h has a
direction that round-off turns by 1e-4, and its line would cut off as much of the cell.)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.polygons.segments import cross
from vemcvx.meshes.polygons.triangles import clip_ears, signed_areas
from vemcvx.vem import CellGroup, Space

CONVEX = 1e-12
# All pieces share one array as wide as the widest; few cells have more vertices than this, and those are cut.
WIDEST = 12
# Numbers in one temporary array of the tests below.
CHUNK = 2**20


@dataclass(frozen=True, eq=False)
class Pieces:
    """Convex pieces of the cells of a mesh."""

    corners: Floats
    """(p, w, 2) vertices, counter-clockwise, the last one repeated up to the width w"""
    owner: Ints
    """(p,) the cell of each piece"""


def convex_pieces(space: Space) -> Pieces:
    """The cells of a mesh in convex pieces."""
    corners, owner = zip(*[part for group in space.groups for part in _of_group(group)], strict=True)
    width = max(part.shape[1] for part in corners)
    wide = [np.pad(part, ((0, 0), (0, width - part.shape[1]), (0, 0)), mode="edge") for part in corners]
    return Pieces(np.concatenate(wide), np.concatenate(owner))


def _of_group(group: CellGroup) -> Iterator[tuple[Floats, Ints]]:
    for chunk in group.chunks(CHUNK):
        corners, cells = chunk.points[chunk.nodes], chunk.cells
        n = corners.shape[1]
        convex = np.full(len(cells), n <= WIDEST)
        if 3 < n <= WIDEST:
            about = chunk.corners
            convex = inside(about, about)
        yield corners[convex], cells[convex]
        if not convex.all():
            ears = clip_ears(chunk.corners[~convex])
            triangles = corners[~convex][np.arange(len(ears))[:, None, None], ears].reshape(-1, 3, 2)
            # Ears on a straight side are flat, up to round-off of either sign.
            kept = signed_areas(triangles) > 0.0
            yield triangles[kept], np.repeat(cells[~convex], n - 2)[kept]


def inside(points: Floats, corners: Floats) -> Bools:
    """Whether all points (c, p, 2) lie left of all edges of the polygons (c, n, 2), up to CONVEX of their size."""
    edge = np.roll(corners, -1, axis=1) - corners
    size = np.ptp(corners, axis=1).max(axis=1)
    reach = CONVEX * size[:, None] * np.hypot(edge[..., 0], edge[..., 1])
    left = cross(edge[:, :, None], points[:, None] - corners[:, :, None])
    within: Bools = np.all(left >= -reach[:, :, None], axis=(1, 2))
    return within
