"""Geometry of segments, polygons and triangles in the plane: crossings, distances, areas, centroids, diameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.polygons.topology import next_corner

# Segments in the plane, and boxes: which cross, how far a point is from one, which boxes overlap.
#
# The sign of (b - a) x (p - a) says on which side of the line through a and b the point p lies. Differences of
# coordinates are exact up to the rounding of the coordinates themselves, so distances below `TOLERANCE` times the
# coordinates mean nothing and count as zero.


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
    """Return True if edges (m, 2) and edges (m, 2), as node numbers, cross in inner points of both, beyond rounding."""
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


# The door to SciPy's spatial structures, opened when somebody looks: importing them takes 0.3 s.


def close_pairs(points: Floats, distance: float) -> Ints:
    """Pairs (m, 2) of points (n, dim) that are no farther apart than a distance."""
    from scipy.spatial import cKDTree

    return cKDTree(points).query_pairs(distance, output_type="ndarray").astype(np.int64)


def nearest(points: Floats, places: Floats) -> tuple[Floats, Ints]:
    """Distance (m,) from each place (m, dim) to the nearest of the points (n, dim), and its number (m,)."""
    from scipy.spatial import cKDTree

    distance, number = cKDTree(points).query(places)
    return np.asarray(distance, dtype=float), np.asarray(number, dtype=np.int64)


def delaunay(points: Floats) -> Ints:
    """Triangles (t, 3) of the Delaunay triangulation of points (n, 2), or MeshError if these are on one line."""
    from scipy.spatial import Delaunay, QhullError

    try:
        return Delaunay(points).simplices.astype(np.int64)
    except QhullError as error:
        raise MeshError(f"{len(points)} points have no triangulation: they are all but on one line.") from error


def voronoi_faces(sites: Floats) -> tuple[Floats, Ints, list[list[int]]]:
    """Voronoi cells of sites (n, 3): corners (m, 3), and of each face the two sites (f, 2) and its corners in order.

    A corner at infinity has the number -1.
    """
    from scipy.spatial import Voronoi

    found = Voronoi(sites)
    return found.vertices, found.ridge_points.astype(np.int64), found.ridge_vertices


# Areas and centroids of polygons, and diameters of cells.
#
# Shoelace formula with coordinates taken relative to the first vertex o of each cell (d_i = x_i - o):
#
#     area     = 1/2 sum_i d_i x d_{i+1}                          (counter-clockwise positive)
#     centroid = o + 1/(6 area) sum_i (d_i + d_{i+1}) (d_i x d_{i+1})
#
# so a mesh far from the origin loses nothing: the differences of neighbouring coordinates are exact, whereas products
# of coordinates near 1e6 would leave four digits of the area of a cell of size 1e-3.


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


# Triangles (t, 3, 2), counter-clockwise: areas, places given by barycentric coordinates, and polygons cut into them.
#
# Convex polygons are cut into fans, simple ones by clipping ears. An ear is a vertex whose triangle with its two
# neighbours turns left and holds no other vertex; every simple polygon of more than three vertices has two (Meisters,
# Amer. Math. Monthly 82 (1975)). The ear taken is the one that other vertices stay away from most, which needs no
# tolerance, and takes vertices on straight sides first.


# Barycentric coordinates of the inner three-point rule of degree 2; its weights are equal.
INNER = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)
# Those of Radon's seven points (Monatsh. Math. 52 (1948)), exact for degree 5, and their weights, which add up to one:
# the centroid with 9/40, and with s = (6 -+ sqrt 15) / 21 the points (s, s, 1 - 2s) with (155 -+ sqrt 15) / 1200 each.
_NEAR, _FAR = (6.0 - np.sqrt(15.0)) / 21.0, (6.0 + np.sqrt(15.0)) / 21.0
RADON_POINTS = np.concatenate(
    [np.full((1, 3), 1.0 / 3.0), *(np.full((3, 3), s) + (1.0 - 3.0 * s) * np.eye(3) for s in (_NEAR, _FAR))]
)
RADON_WEIGHTS = np.repeat([0.225, (155.0 - np.sqrt(15.0)) / 1200.0, (155.0 + np.sqrt(15.0)) / 1200.0], [1, 3, 3])


class Triangles(NamedTuple):
    """Triangles with their areas, and what each is a part of."""

    corners: Floats
    areas: Floats
    owner: Ints


def signed_areas(corners: Floats) -> Floats:
    """Areas (...,) of triangles (..., 3, 2), counter-clockwise positive."""
    return 0.5 * cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :])


def fans(polygons: Floats, owner: Ints) -> Triangles:
    """The triangles from the first vertex of convex polygons (p, m, 2), without the flat ones where vertices repeat."""
    first = np.broadcast_to(polygons[:, :1], polygons[:, 2:].shape)
    corners = np.stack([first, polygons[:, 1:-1], polygons[:, 2:]], axis=2)
    areas = signed_areas(corners)
    kept = areas > 0.0
    return Triangles(corners[kept], areas[kept], np.repeat(owner, kept.sum(axis=1)))


def places(corners: Floats, barycentric: Floats) -> Floats:
    """The points (t, q, 2) with the given barycentric coordinates (q, 3) in each triangle."""
    # Relative to the first vertex: a body far from the origin loses no digits.
    origin = corners[:, :1]
    within: Floats = np.matmul(barycentric, corners - origin)
    return origin + within


def clip_ears(corners: Floats) -> Ints:
    """Triangles (c, n - 2, 3) of simple polygons (c, n, 2), vertices on straight sides included; counter-clockwise.

    Their signed areas add up to the polygon's.
    """
    c, n, _ = corners.shape
    left = np.broadcast_to(np.arange(n), (c, n))
    triangles = np.empty((c, n - 2, 3), dtype=np.int64)
    for step in range(n - 3):
        ear = np.argmin(_intrusion(np.take_along_axis(corners, left[:, :, None], axis=1)), axis=1)
        around = (ear[:, None] + np.array([-1, 0, 1])) % (n - step)
        triangles[:, step] = np.take_along_axis(left, around, axis=1)
        stays = np.arange(n - step) != ear[:, None]
        left = left[stays].reshape(c, n - step - 1)
    triangles[:, n - 3] = left
    return triangles


def _intrusion(x: Floats) -> Floats:
    """The depth to which other vertices reach into the triangle at each vertex, (c, m): below zero for ears only."""
    before, after = np.roll(x, 1, axis=1), np.roll(x, -1, axis=1)
    depth = np.minimum(np.minimum(_side(before, x, x), _side(x, after, x)), _side(after, before, x))
    m = x.shape[1]
    vertex = np.arange(m)
    for shift in (-1, 0, 1):
        depth[:, vertex, (vertex + shift) % m] = -np.inf
    return np.where(cross(x - before, after - x) >= 0.0, depth.max(axis=2), np.inf)


def _side(a: Floats, b: Floats, x: Floats) -> Floats:
    """Twice the area of (a_i, b_i, x_j), (c, m, m): positive where x_j lies left of the line from a_i to b_i."""
    return cross((b - a)[:, :, None], x[:, None] - a[:, :, None])
