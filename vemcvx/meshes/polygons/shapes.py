"""Areas and centroids of polygons, and diameters of cells.

Shoelace formula with coordinates taken relative to the first vertex o of each cell (d_i = x_i - o):

    area     = 1/2 sum_i d_i x d_{i+1}                          (counter-clockwise positive)
    centroid = o + 1/(6 area) sum_i (d_i + d_{i+1}) (d_i x d_{i+1})

so a mesh far from the origin loses nothing: the differences of neighbouring coordinates are exact, whereas products
of coordinates near 1e6 would leave four digits of the area of a cell of size 1e-3.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.polygons.segments import cross
from vemcvx.meshes.polygons.topology import next_corner

ENTRIES_AT_ONCE = 2_000_000  # about 50 MB of temporaries


def areas_and_centroids(points: Floats, offsets: Ints, vertices: Ints) -> tuple[Floats, Floats]:
    """Signed areas (n_cells,) and centroids (n_cells, 2); the centroid of a cell without area is its first vertex."""
    origin = points[vertices[offsets[:-1]]]
    here = points[vertices] - np.repeat(origin, np.diff(offsets), axis=0)
    after = here[next_corner(offsets)]
    part = cross(here, after)
    doubled = np.add.reduceat(part, offsets[:-1])
    moments = np.add.reduceat((here + after) * part[:, None], offsets[:-1], axis=0)
    shift = np.divide(moments, 3.0 * doubled[:, None], out=np.zeros_like(moments), where=doubled[:, None] != 0.0)
    return 0.5 * doubled, origin + shift


def polygon_centroids(corners: Floats) -> tuple[Floats, Floats]:
    """Signed areas (c,) and centroids (c, 2) of polygons of n vertices each, (c, n, 2)."""
    arms = corners - corners[:, :1]
    after = np.roll(arms, -1, axis=1)
    part = cross(arms, after)
    doubled: Floats = part.sum(axis=1)
    moments = np.einsum("ci,cia->ca", part, arms + after)
    shift = np.divide(moments, 3.0 * doubled[:, None], out=np.zeros_like(moments), where=doubled[:, None] != 0.0)
    return 0.5 * doubled, corners[:, 0] + shift


def diameters(points: Floats, offsets: Ints, vertices: Ints) -> Floats:
    """Largest distance of two vertices of each cell, (n_cells,); each cell's vertices as a row, in any order."""
    counts = np.diff(offsets)
    result = np.empty(len(counts))
    for count in np.unique(counts):
        members = np.flatnonzero(counts == count)
        for cells in np.array_split(members, 1 + len(members) * count // ENTRIES_AT_ONCE):
            corner = points[vertices[offsets[cells, None] + np.arange(count)]]
            squared = np.zeros(len(cells))
            for step in range(1, count // 2 + 1):  # in a ring, every pair is at most half a turn apart
                apart = corner - np.roll(corner, -step, axis=1)
                np.maximum(squared, np.einsum("cij,cij->ci", apart, apart).max(axis=1), out=squared)
            result[cells] = np.sqrt(squared)
    return result
