"""Segments in the plane, and boxes: which cross, how far a point is from one, which boxes overlap.

The sign of (b - a) x (p - a) says on which side of the line through a and b the point p lies. Differences of
coordinates are exact up to the rounding of the coordinates themselves, so distances below `TOLERANCE` times the
coordinates mean nothing and count as zero.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints

# Four units in the last place: the middle and the thirds of an edge, computed in any order, stay below two.
TOLERANCE = 4.0 * np.finfo(float).eps


def cross(a: Floats, b: Floats) -> Floats:
    """a x b of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def right_of(vectors: Floats) -> Floats:
    """Vectors (m, 2) turned clockwise by a quarter: outward normals of counter-clockwise edges, as long as these."""
    return np.column_stack([vectors[:, 1], -vectors[:, 0]])


def rounding(*points: Floats) -> Floats:
    """Length below which a distance between the given points (m, 2) is rounding of their coordinates, (m,)."""
    largest: Floats = np.max([np.abs(point).max(axis=1) for point in points], axis=0)
    return TOLERANCE * largest


def beside(point: Floats, start: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Distance (m,) of points from segments, and its sign: left of the segment positive."""
    edge = end - start
    length = np.hypot(edge[:, 0], edge[:, 1])
    along = np.einsum("ij,ij->i", point - start, edge)
    # Coordinates relative to the nearer end: the far end would bring in its own rounding.
    near = np.where((along > 0.5 * length**2)[:, None], end, start)
    away = point - near
    signed = cross(edge, away) / length
    inside = (along >= 0.0) & (along <= length**2)
    return np.where(inside, np.abs(signed), np.hypot(away[:, 0], away[:, 1])), np.sign(signed)


def crossing(points: Floats, first: Ints, second: Ints) -> Bools:
    """Whether edges (m, 2) and edges (m, 2), as node numbers, cross in inner points of both, beyond rounding."""
    a, b, c, d = (points[nodes] for nodes in (first[:, 0], first[:, 1], second[:, 0], second[:, 1]))
    slack = rounding(a, b, c, d)

    def parted(start: Floats, end: Floats, one: Floats, other: Floats) -> Bools:
        edge = end - start
        margin = slack * np.hypot(edge[:, 0], edge[:, 1])
        left, right = cross(edge, one - start), cross(edge, other - start)
        return ((left > margin) & (right < -margin)) | ((left < -margin) & (right > margin))

    return parted(a, b, c, d) & parted(c, d, a, b)


def overlapping_boxes(low: Floats, high: Floats, tree_low: Floats, tree_high: Floats) -> tuple[Ints, Ints]:
    """Pairs (i, j) where the box [low_i, high_i] meets the box [tree_low_j, tree_high_j]; boxes are (m, d).

    The second set goes into a balanced binary tree of enclosing boxes, halved by turns along the axes; all queries
    descend it together. Cost near (m + pairs) log m also for meshes graded over many orders of length.
    """
    order, levels = _box_tree(tree_low, tree_high)
    query, node = np.arange(len(low)), np.zeros(len(low), dtype=np.int64)
    for depth, (lower, upper) in enumerate(levels):
        if depth:
            query, node = np.repeat(query, 2), np.repeat(2 * node, 2)
            node[1::2] += 1
        meets = ((low[query] <= upper[node]) & (high[query] >= lower[node])).all(axis=1)
        query, node = query[meets], node[meets]
    return query, order[node]


def _box_tree(low: Floats, high: Floats) -> tuple[Ints, list[tuple[Floats, Floats]]]:
    """Order of the leaves, and the enclosing boxes of each level from the root down."""
    dimension = low.shape[1]
    depth = max(0, int(np.ceil(np.log2(max(1, len(low))))))
    empty = 2**depth - len(low)  # boxes that meet nothing fill the tree up
    low = np.concatenate([low, np.full((empty, dimension), np.inf)])
    high = np.concatenate([high, np.full((empty, dimension), -np.inf)])
    place = np.where(np.isfinite(low), low, np.inf)
    order = np.arange(2**depth)
    for level in range(depth):
        blocks = order.reshape(2**level, -1)
        order = np.take_along_axis(blocks, np.argsort(place[blocks, level % dimension], axis=1), axis=1).ravel()
    levels = [(low[order], high[order])]
    while len(levels[0][0]) > 1:
        lower, upper = (pair.reshape(-1, 2, dimension) for pair in levels[0])
        levels.insert(0, (lower.min(axis=1), upper.max(axis=1)))
    return order, levels
