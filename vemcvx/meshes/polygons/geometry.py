"""Geometry of segments, polygons and triangles in the plane: crossings, distances, areas, centroids, diameters.

The sign of (b - a) x (p - a) says on which side of the line through a and b the point p lies. Differences of
coordinates are exact up to the rounding of the coordinates themselves, so distances below `TOLERANCE` times the
coordinates mean nothing and count as zero. Areas and centroids take coordinates relative to the first vertex o of each
cell (d_i = x_i - o):

    area     = 1/2 sum_i d_i x d_{i+1}                          (counter-clockwise positive)
    centroid = o + 1/(6 area) sum_i (d_i + d_{i+1}) (d_i x d_{i+1})

so a mesh far from the origin loses nothing, whereas products of coordinates near 1e6 would leave four digits of the
area of a cell of size 1e-3.

Convex polygons are cut into fans of triangles, simple ones by clipping ears. An ear is a vertex whose triangle with its
two neighbours turns left and holds no other vertex; every simple polygon of more than three vertices has two (Meisters,
Amer. Math. Monthly 82 (1975)). The ear taken is the one that other vertices stay away from most, which needs no
tolerance, and takes vertices on straight sides first.

Shapely and SciPy's spatial structures are imported when somebody looks: they take .1 and .3 s.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.polygons.topology import cell_of_corner, next_corner

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


def overlapping_boxes(low: Floats, high: Floats, tree_low: Floats, tree_high: Floats) -> tuple[Ints, Ints]:
    """Pairs (i, j) where the box [low_i, high_i] meets the box [tree_low_j, tree_high_j], by i; boxes are (m, d).

    A tree finds the pairs that meet along the two longest axes of all boxes together.
    """
    from shapely import STRtree, box, points

    if not len(low) or not len(tree_low):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    u, v = np.argsort(tree_low.min(axis=0) - tree_high.max(axis=0), kind="stable")[:2]
    tree = box(tree_low[:, u], tree_low[:, v], tree_high[:, u], tree_high[:, v])
    boxes = points(low[:, [u, v]]) if low is high else box(low[:, u], low[:, v], high[:, u], high[:, v])
    i, j = STRtree(tree).query(boxes)
    meet = ((low[i] <= tree_high[j]) & (high[i] >= tree_low[j])).all(axis=1)
    return i[meet], j[meet]


def outlines(points: Floats, offsets: Ints, vertices: Ints) -> NDArray[Any]:
    """The polygons (n_cells,) as objects of Shapely."""
    import shapely

    rings = shapely.linearrings(points[vertices], indices=cell_of_corner(offsets))
    return np.asarray(shapely.polygons(rings))


def holding(polygons: NDArray[Any], places: Floats) -> tuple[Ints, Ints]:
    """Pairs (i, j) where place i of (n, 2) lies in the closed polygon j, by i."""
    import shapely

    i, j = shapely.STRtree(polygons).query(shapely.points(places), predicate="intersects")
    return i, j


def overlaps(first: NDArray[Any], second: NDArray[Any]) -> tuple[Ints, Ints, NDArray[Any]]:
    """Pairs (i, j) of polygons that share an area, and the polygons that they share, some pairs several.

    A polygon that another covers is what they share: refined meshes need no intersections.
    """
    import shapely

    one = np.stack(shapely.STRtree(second).query(first, predicate="covers"))
    other = np.stack(shapely.STRtree(first).query(second, predicate="covers"))[::-1]
    inside = np.zeros(len(first), dtype=bool), np.zeros(len(second), dtype=bool)
    inside[0][other[0]], inside[1][one[1]] = True, True
    other = other[:, ~inside[1][other[1]]]
    i, j = np.flatnonzero(~inside[0]), np.flatnonzero(~inside[1])
    pairs = np.array([i[:0], j[:0]]) if not (len(i) and len(j)) else shapely.STRtree(second[j]).query(first[i])
    pairs = np.stack([i[pairs[0]], j[pairs[1]]])
    shared, pair = shapely.get_parts(shapely.intersection(first[pairs[0]], second[pairs[1]]), return_index=True)
    cut = shapely.area(shared) > 0.0
    found = np.concatenate([one, other, pairs[:, pair[cut]]], axis=1)
    return found[0], found[1], np.concatenate([second[one[1]], first[other[0]], shared[cut]])


def triangulated(polygons: NDArray[Any]) -> Triangles:
    """The triangles of simple polygons, between their own vertices."""
    import shapely

    cut, owner = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons), return_index=True)
    corners = shapely.get_coordinates(shapely.get_exterior_ring(cut)).reshape(-1, 4, 2)[:, 2::-1]
    areas = signed_areas(corners)
    return Triangles(np.where(areas[:, None, None] < 0.0, corners[:, ::-1], corners), np.abs(areas), owner)


def fans(polygons: NDArray[Any]) -> Triangles:
    """The triangles from the first corner of each polygon to all its sides, those that turn right with negative areas.

    They need not lie in the polygon, but what is a polynomial on it has the sum of their integrals.
    """
    import shapely

    x, owner = shapely.get_coordinates(shapely.get_exterior_ring(shapely.orient_polygons(polygons)), return_index=True)
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    side = np.setdiff1d(np.arange(len(x) - 1), np.append(first, first - 1))
    corners = np.stack([x[first][owner[side]], x[side], x[side + 1]], axis=1)
    areas = signed_areas(corners)
    return Triangles(corners, areas, owner[side])


def close_pairs(points: Floats, distance: float) -> Ints:
    """Pairs (m, 2) of points (n, dim) that are no farther apart than a distance."""
    from scipy.spatial import cKDTree

    return cKDTree(points).query_pairs(distance, output_type="ndarray").astype(np.int64)


def nearest(points: Floats, places: Floats) -> tuple[Floats, Ints]:
    """Distance (m,) from each place (m, dim) to the nearest of the points (n, dim), and its number (m,)."""
    from scipy.spatial import cKDTree

    distance, number = cKDTree(points).query(places)
    return np.asarray(distance, dtype=float), np.asarray(number, dtype=np.int64)


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
    c, n, _ = corners.shape
    return areas_and_centroids(corners.reshape(-1, 2), np.arange(c + 1) * n, np.arange(c * n))


def diameters(points: Floats, offsets: Ints, vertices: Ints) -> Floats:
    """Largest distance of two vertices of each cell, (n_cells,); each cell's vertices as a row, in any order."""
    counts = np.diff(offsets)
    squared = np.zeros(len(counts))
    for count in np.unique(counts):
        cells = np.flatnonzero(counts == count)
        corner = points[vertices[offsets[cells, None] + np.arange(count)]]
        for step in range(1, count // 2 + 1):  # in a ring, every pair is at most half a turn apart
            apart = corner - np.roll(corner, -step, axis=1)
            squared[cells] = np.maximum(squared[cells], np.einsum("cij,cij->ci", apart, apart).max(axis=1))
    return np.sqrt(squared)


# Barycentric coordinates of the inner three-point rule of degree 2; its weights are equal.
INNER = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)
# Those of Radon's seven points (Monatsh. Math. 52 (1948)), exact for degree 5, and their weights, which add up to one:
# the centroid with 9/40, and for r = -+ sqrt 15 the points (s, s, 1 - 2s), s = (6 + r) / 21, with (155 + r) / 1200.
RADON_POINTS = np.concatenate(
    [np.full((1, 3), 1.0 / 3.0)]
    + [np.full((3, 3), (6.0 + r) / 21.0) + (1.0 - r) / 7.0 * np.eye(3) for r in (-np.sqrt(15.0), np.sqrt(15.0))]
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
