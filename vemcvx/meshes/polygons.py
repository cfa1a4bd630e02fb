"""Polygons in flat arrays: shared edges and vertices, and geometry in the plane.

Rows of different lengths are stored end to end in one array: row c is ``flat[offsets[c]:offsets[c + 1]]``. The array
``vertices`` has one row per cell. Entry k of ``vertices`` is called corner k. An edge goes from each corner to the next
vertex of the cell. An undirected edge {a, b}, a < b, has the key a * n_nodes + b.

Let d_i be the vector from the first vertex o of a cell to vertex i, and a x b = a_1 b_2 - a_2 b_1. A cell has

    area     = 1/2 sum_i d_i x d_{i+1}                          (counter-clockwise positive)
    centroid = o + 1/(6 area) sum_i (d_i + d_{i+1}) (d_i x d_{i+1})
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from vemcvx.base.arrays import Bools, Floats, Ints


def spans(starts: Ints, counts: Ints) -> Ints:
    """Return the ranges starts[i], ..., starts[i] + counts[i] - 1, end to end."""
    before = np.cumsum(counts) - counts
    return np.repeat(starts - before, counts) + np.arange(counts.sum())


def offsets_of(counts: Ints) -> Ints:
    """Return the offsets of rows with the given lengths."""
    return np.concatenate([[0], np.cumsum(counts)])


def rows_in_order(offsets: Ints, flat: Ints, order: Ints) -> tuple[Ints, Ints]:
    """Return the offsets and entries of rows in the given order."""
    counts = np.diff(offsets)[order]
    return offsets_of(counts), flat[spans(offsets[order], counts)]


def reverse_rows(offsets: Ints, vertices: Ints, backwards: Bools) -> Ints:
    """Return the vertices, with the marked rows reversed after the first vertex."""
    row, counts = cell_of_corner(offsets), np.diff(offsets)
    place = np.arange(len(vertices)) - offsets[row]
    mirrored = offsets[row] + -place % counts[row]
    return np.where(backwards[row], vertices[mirrored], vertices)


def find_in(keys: Ints, wanted: Ints) -> Ints:
    """Return the first positions of wanted numbers among the keys, or -1."""
    if not len(keys):
        return np.full(len(wanted), -1)
    order = np.argsort(keys, kind="stable")
    at = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
    return np.where(keys[at] == wanted, at, -1)


def find_all_in(keys: Ints, wanted: Ints) -> tuple[Ints, Ints]:
    """Return all pairs (i, j) with wanted[i] == keys[j], sorted by i."""
    order = np.argsort(keys, kind="stable")
    begin, end = (np.searchsorted(keys[order], wanted, side=side) for side in ("left", "right"))
    return np.repeat(np.arange(len(wanted)), end - begin), order[spans(begin, end - begin)]


def least_of_each(keys: Ints, values: Floats) -> Ints:
    """Return, for each distinct key, the position of the least value."""
    order = np.lexsort((values, keys))
    return order[np.unique(keys[order], return_index=True)[1]]


def same_rows(offsets: Ints, vertices: Ints) -> tuple[Ints, Ints]:
    """Group rows with the same entries. Return the first row of each group, and the group of each row."""
    counts = np.diff(offsets)
    leader = np.arange(len(counts))
    for count in np.unique(counts):
        listed = np.flatnonzero(counts == count)
        rows = np.sort(vertices[offsets[listed, None] + np.arange(count)], axis=1)
        order = np.lexsort(rows.T[::-1])
        rows = rows[order]
        starts = np.concatenate([[True], (rows[1:] != rows[:-1]).any(axis=1)])
        leader[listed[order]] = listed[order[np.flatnonzero(starts)]][np.cumsum(starts) - 1]
    first = np.unique(leader)
    return first, np.searchsorted(first, leader)


def matching_rows(offsets: Ints, flat: Ints, wanted_offsets: Ints, wanted: Ints) -> Ints:
    """Return the rows that equal wanted rows up to order, or -1."""
    count = len(offsets) - 1
    whole = np.append(offsets, offsets[-1] + wanted_offsets[1:])
    first, number = same_rows(whole, np.append(flat, wanted))
    found = first[number[count:]]
    return np.where(found < count, found, -1)


def rotation(flags: Bools, offsets: Ints) -> Ints:
    """Return an order in which rows begin at the first True flag."""
    row, none = cell_of_corner(offsets), len(flags)
    first = np.minimum.reduceat(np.where(flags, np.arange(none), none), offsets[:-1])
    first = np.where(first == none, 0, first - offsets[:-1])
    place = np.arange(none) - offsets[row]
    return offsets[row] + (place + first[row]) % np.diff(offsets)[row]


def backwards(offsets: Ints) -> Ints:
    """Return an order of entries that reverses each row."""
    return np.repeat(offsets[:-1] + offsets[1:] - 1, np.diff(offsets)) - np.arange(offsets[-1])


def next_corner(offsets: Ints) -> Ints:
    """Return the next corner in the cell, for each corner."""
    follow = np.arange(1, offsets[-1] + 1)
    follow[offsets[1:] - 1] = offsets[:-1]
    return follow


def previous_corner(offsets: Ints) -> Ints:
    """Return the previous corner in the cell, for each corner."""
    before = np.arange(-1, offsets[-1] - 1)
    before[offsets[:-1]] = offsets[1:] - 1
    return before


def next_vertex(offsets: Ints, vertices: Ints) -> Ints:
    """Return the next vertex in the cell, for each corner."""
    return vertices[next_corner(offsets)]


def cell_of_corner(offsets: Ints) -> Ints:
    """Return the cell of each corner."""
    return np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))


def corner_edges(offsets: Ints, vertices: Ints) -> Ints:
    """Return the edges (n_corners, 2) that start at the corners."""
    return np.column_stack([vertices, next_vertex(offsets, vertices)])


def edge_keys(edges: Ints, n_nodes: int) -> Ints:
    """Return the key of each undirected edge."""
    return np.minimum(edges[:, 0], edges[:, 1]) * n_nodes + np.maximum(edges[:, 0], edges[:, 1])


def positions(wanted: Ints, edges: Ints, n_nodes: int) -> Ints:
    """Return the positions of wanted undirected edges among the edges."""
    return find_in(edge_keys(edges, n_nodes), edge_keys(wanted, n_nodes))


def insert_hanging(outlines: tuple[Ints, Ints], ends: Ints, rows: Ints, nodes: Ints) -> tuple[Ints, Ints]:
    """Return outlines with row k of `nodes` inserted into the edge `ends[k]`."""
    offsets, vertices = outlines
    count = int(max(vertices.max(initial=0), ends.max(initial=0))) + 1
    touched = np.zeros(count, dtype=bool)
    touched[ends] = True
    edges = corner_edges(offsets, vertices)
    corner = np.flatnonzero(touched[edges].all(axis=1))
    line = find_in(edge_keys(ends, count), edge_keys(edges[corner], count))
    corner, line = corner[line >= 0], line[line >= 0]
    begin, new = rows_in_order(rows, nodes, line)
    counts, against = np.diff(begin), ends[line, 0] != edges[corner, 0]
    new = np.where(np.repeat(against, counts), new[backwards(begin)], new)
    more = np.bincount(cell_of_corner(offsets)[corner], counts, len(offsets) - 1).astype(np.int64)
    return offsets_of(np.diff(offsets) + more), np.insert(vertices, np.repeat(corner + 1, counts), new)


@dataclass(frozen=True, eq=False)
class SharedEdges:
    """The corners of a mesh, sorted by undirected edge."""

    corners: Ints  # (n_corners,) sorted by edge, then by cell
    first: Ints  # (n_edges,) first position of the edge in `corners`
    counts: Ints  # (n_edges,) number of adjacent cells
    outlines: tuple[Ints, Ints]  # offsets and vertices of the cells

    @cached_property
    def ends(self) -> Ints:
        """The nodes (n_edges, 2) of the edges, the smaller node first."""
        return np.sort(corner_edges(*self.outlines)[self.corners[self.first]], axis=1)

    @cached_property
    def number(self) -> Ints:
        """The number of the edge at each corner."""
        number = np.empty_like(self.corners)
        number[self.corners] = np.repeat(np.arange(len(self.first)), self.counts)
        return number

    @property
    def alone(self) -> Ints:
        """The corners where boundary edges start, ordered by cell."""
        return np.sort(self.corners[self.first[self.counts == 1]])


def sort_edges(offsets: Ints, vertices: Ints, n_nodes: int) -> SharedEdges:
    """Sort the corners by undirected edge."""
    keys = edge_keys(corner_edges(offsets, vertices), n_nodes)
    corners = np.argsort(keys, kind="stable")  # keeps the order of cells
    _, first, counts = np.unique(keys[corners], return_index=True, return_counts=True)
    return SharedEdges(corners, first, counts, (offsets, vertices))


def smallest_linked(pairs: Ints, count: int) -> Ints:
    """Return, for each number, the smallest number in its connected component."""
    links = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    label = connected_components(links, directed=False)[1]
    return np.unique(label, return_index=True)[1][label]


TOLERANCE = 4.0 * np.finfo(float).eps  # relative rounding error of coordinates


def cross(a: Floats, b: Floats) -> Floats:
    """Return a x b for vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def right_of(vectors: Floats) -> Floats:
    """Rotate vectors clockwise by 90 degrees."""
    return np.stack([vectors[..., 1], -vectors[..., 0]], axis=-1)


def rounding(*points: Floats) -> Floats:
    """Return the rounding errors of distances between points."""
    return TOLERANCE * np.max([np.abs(point).max(axis=1) for point in points], axis=0)


def overlapping_boxes(low: Floats, high: Floats, tree_low: Floats, tree_high: Floats) -> tuple[Ints, Ints]:
    """Return pairs (i, j), sorted by i, of boxes that intersect."""
    import shapely

    if not len(low) or not len(tree_low):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    u, v = np.argsort(tree_low.min(axis=0) - tree_high.max(axis=0), kind="stable")[:2]
    boxes = shapely.box(tree_low[:, u], tree_low[:, v], tree_high[:, u], tree_high[:, v])
    i, j = shapely.STRtree(boxes).query(shapely.box(low[:, u], low[:, v], high[:, u], high[:, v]))
    meet = ((low[i] <= tree_high[j]) & (high[i] >= tree_low[j])).all(axis=1)
    return i[meet], j[meet]


def outlines(points: Floats, offsets: Ints, vertices: Ints) -> NDArray[Any]:
    """Return the polygons as Shapely objects."""
    import shapely

    rings = shapely.linearrings(points[vertices], indices=cell_of_corner(offsets))
    return np.asarray(shapely.polygons(rings))


def find_containing(polygons: NDArray[Any], places: Floats) -> tuple[Ints, Ints]:
    """Return pairs (i, j) with point i in the closed polygon j, sorted by i."""
    import shapely

    return tuple(shapely.STRtree(polygons).query(shapely.points(places), predicate="intersects"))


def overlaps(first: NDArray[Any], second: NDArray[Any]) -> tuple[Ints, Ints, NDArray[Any]]:
    """Return pairs (i, j) of polygons that overlap, and the common parts."""
    import shapely

    i, j = shapely.STRtree(second).query(first)
    shared, pair = shapely.get_parts(shapely.intersection(first[i], second[j]), return_index=True)
    cut = shapely.area(shared) > 0.0
    return i[pair[cut]], j[pair[cut]], shared[cut]


def triangulate(polygons: NDArray[Any]) -> Triangles:
    """Split simple polygons into triangles."""
    corners, owner = _split_into_triangles(polygons)
    return Triangles(corners[:, :, :2], triangle_areas(corners[:, :, :2]), owner)


def _split_into_triangles(polygons: NDArray[Any]) -> tuple[Floats, Ints]:
    import shapely

    parts, owner = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons), return_index=True)
    corners = shapely.get_coordinates(shapely.get_exterior_ring(parts), include_z=True).reshape(-1, 4, 3)[:, 2::-1]
    backwards = triangle_areas(corners[:, :, :2]) < 0.0
    return np.where(backwards[:, None, None], corners[:, ::-1], corners), owner


def close_pairs(points: Floats, distance: float) -> Ints:
    """Return the pairs of points that are at most `distance` apart."""
    from scipy.spatial import cKDTree

    return cKDTree(points).query_pairs(distance, output_type="ndarray").astype(np.int64)


def nearest(points: Floats, places: Floats) -> tuple[Floats, Ints]:
    """Return the distances and numbers of the nearest points."""
    from scipy.spatial import cKDTree

    found: Any = cKDTree(points).query(places)
    return found


def areas_and_centroids(points: Floats, offsets: Ints, vertices: Ints) -> tuple[Floats, Floats]:
    """Return signed areas and centroids of cells."""
    origin = points[vertices[offsets[:-1]]]
    here = points[vertices] - np.repeat(origin, np.diff(offsets), axis=0)
    after = here[next_corner(offsets)]
    part = cross(here, after)
    doubled = np.add.reduceat(part, offsets[:-1])
    moments = np.add.reduceat((here + after) * part[:, None], offsets[:-1], axis=0)
    shift = np.divide(moments, 3.0 * doubled[:, None], out=np.zeros_like(moments), where=doubled[:, None] != 0.0)
    return 0.5 * doubled, origin + shift


def polygon_centroids(corners: Floats) -> tuple[Floats, Floats]:
    """Return signed areas and centroids of polygons with equally many vertices."""
    c, n, _ = corners.shape
    return areas_and_centroids(corners.reshape(-1, 2), np.arange(c + 1) * n, np.arange(c * n))


def diameters(points: Floats, offsets: Ints, vertices: Ints) -> Floats:
    """Return the largest distance between vertices of each cell."""
    counts = np.diff(offsets)
    squared = np.zeros(len(counts))
    for count in np.unique(counts):
        cells = np.flatnonzero(counts == count)
        corner = points[vertices[offsets[cells, None] + np.arange(count)]]
        for step in range(1, count // 2 + 1):  # larger steps repeat the same pairs
            apart = corner - np.roll(corner, -step, axis=1)
            squared[cells] = np.maximum(squared[cells], np.einsum("cij,cij->ci", apart, apart).max(axis=1))
    return np.sqrt(squared)


# A quadrature rule of degree 2: barycentric coordinates of three points with equal weights.
DEGREE_2_POINTS = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)
# Barycentric coordinates of Radon's seven-point rule of degree 5 (Monatsh. Math. 52 (1948)).
RADON_POINTS = np.concatenate(
    [np.full((1, 3), 1.0 / 3.0)]
    + [np.full((3, 3), (6.0 + r) / 21.0) + (1.0 - r) / 7.0 * np.eye(3) for r in (-np.sqrt(15.0), np.sqrt(15.0))]
)
RADON_WEIGHTS = np.repeat([0.225, (155.0 - np.sqrt(15.0)) / 1200.0, (155.0 + np.sqrt(15.0)) / 1200.0], [1, 3, 3])


class Triangles(NamedTuple):
    """Triangles that divide polygons."""

    corners: Floats  # (t, 3, 2)
    areas: Floats  # (t,)
    owner: Ints  # (t,) the polygon around the triangle


def triangle_areas(corners: Floats) -> Floats:
    """Return the areas of triangles, positive if counter-clockwise."""
    return 0.5 * cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :])


def places(corners: Floats, barycentric: Floats) -> Floats:
    """Return the points with given barycentric coordinates in each triangle."""
    origin = corners[:, :1]  # reduces rounding far from the origin
    return origin + np.matmul(barycentric, corners - origin)


def split_at_vertices(corners: Floats) -> Ints:
    """Split simple polygons into triangles (c, n - 2, 3) along diagonals."""
    c, n, _ = corners.shape
    number = np.tile(np.arange(n), c)  # Shapely keeps the number as a third coordinate
    polygons = outlines(np.column_stack([corners.reshape(-1, 2), number]), np.arange(c + 1) * n, np.arange(c * n))
    return _split_into_triangles(polygons)[0][:, :, 2].astype(np.int64).reshape(c, n - 2, 3)
