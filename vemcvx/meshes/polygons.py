"""Many polygons at once, in flat arrays: who touches whom, and geometry in the plane.

Cells are rows of different lengths, laid end to end: row c is ``flat[offsets[c]:offsets[c + 1]]``. With the vertices of
cells as rows, corner k of that flat list starts the directed edge from ``vertices[k]`` to the next vertex of the same
cell. Packing an undirected edge {a, b}, a < b, into the one integer a * n_nodes + b makes "which corners share an edge"
a single sort.

The sign of (b - a) x (p - a) says on which side of the line through a and b the point p lies. Differences of
coordinates are exact up to the rounding of the coordinates themselves, so distances below `TOLERANCE` times the
coordinates mean nothing and count as zero. Areas and centroids take coordinates relative to the first vertex o of each
cell (d_i = x_i - o):

    area     = 1/2 sum_i d_i x d_{i+1}                          (counter-clockwise positive)
    centroid = o + 1/(6 area) sum_i (d_i + d_{i+1}) (d_i x d_{i+1})

so a mesh far from the origin loses nothing, whereas products of coordinates near 1e6 would leave four digits of the
area of a cell of size 1e-3.

Shapely and SciPy's spatial structures are imported when somebody looks: they take .1 and .3 s.
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
    """The numbers starts[0], starts[0] + 1, ... (counts[0] of them), then those from starts[1] and so on."""
    before = np.cumsum(counts) - counts
    return np.repeat(starts - before, counts) + np.arange(counts.sum())


def offsets_of(counts: Ints) -> Ints:
    """The offsets at which rows of these lengths begin, and the last one's end."""
    return np.concatenate([[0], np.cumsum(counts)])


def rows_in_order(offsets: Ints, flat: Ints, order: Ints) -> tuple[Ints, Ints]:
    """Offsets and entries of the rows with the given numbers, in this order."""
    counts = np.diff(offsets)[order]
    return offsets_of(counts), flat[spans(offsets[order], counts)]


def turned(offsets: Ints, vertices: Ints, backwards: Bools) -> Ints:
    """Vertices with the given rows listed the other way round, each from the same first vertex."""
    counts = np.repeat(np.diff(offsets), np.diff(offsets))
    start = np.repeat(offsets[:-1], np.diff(offsets))
    place = np.arange(len(vertices)) - start
    mirrored = start + (counts - place) % counts
    return np.where(np.repeat(backwards, np.diff(offsets)), vertices[mirrored], vertices)


def distinct(numbers: Ints) -> Ints:
    """The different numbers of (k,), ascending.

    Sorting takes a third of the time of np.unique, which looks up whole numbers in a table from numpy 2.3 on.
    """
    ordered = np.sort(numbers)
    return ordered[np.concatenate([[True], ordered[1:] != ordered[:-1]])] if len(ordered) else ordered


def among(numbers: Ints, known: Ints) -> Bools:
    """Return True if each of the numbers (k,) is one of those known."""
    ordered = distinct(known)
    if not len(ordered):
        return np.zeros(len(numbers), dtype=bool)
    found: Bools = ordered[np.minimum(np.searchsorted(ordered, numbers), len(ordered) - 1)] == numbers
    return found


def found_in(keys: Ints, wanted: Ints) -> Ints:
    """The place of each of the wanted numbers among the keys (k,), the first of equal ones; -1 where it is missing."""
    if not len(keys):
        return np.full(len(wanted), -1)
    order = np.argsort(keys, kind="stable")
    at = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
    return np.where(keys[at] == wanted, at, -1)


def all_found_in(keys: Ints, wanted: Ints) -> tuple[Ints, Ints]:
    """All pairs (i, j) of one of the wanted numbers and a place where it stands among the keys (k,), by i."""
    order = np.argsort(keys, kind="stable")
    begin, end = (np.searchsorted(keys[order], wanted, side=side) for side in ("left", "right"))
    return np.repeat(np.arange(len(wanted)), end - begin), order[spans(begin, end - begin)]


def least_of_each(keys: Ints, values: Floats) -> Ints:
    """The place of the least of the values (k,) that go with each of the different keys, by key."""
    order = np.lexsort((values, keys))
    return order[np.unique(keys[order], return_index=True)[1]]


def same_rows(offsets: Ints, vertices: Ints) -> tuple[Ints, Ints]:
    """Rows of the same entries, in any order, are one: the first of each, and which of these each row is."""
    counts = np.diff(offsets)
    leader = np.arange(len(counts))
    for count in np.unique(counts):
        listed = np.flatnonzero(counts == count)
        rows = np.sort(vertices[offsets[listed, None] + np.arange(count)], axis=1)
        order = np.lexsort(rows.T[::-1])
        rows = rows[order]
        starts = np.concatenate([[True], (rows[1:] != rows[:-1]).any(axis=1)])
        leader[listed[order]] = listed[order[np.flatnonzero(starts)]][np.cumsum(starts) - 1]
    first = distinct(leader)
    return first, np.searchsorted(first, leader)


def matching_rows(offsets: Ints, flat: Ints, wanted_offsets: Ints, wanted: Ints) -> Ints:
    """Number of the row that has the same entries as each wanted row, in any order; -1 where there is none."""
    count = len(offsets) - 1
    whole = np.concatenate([offsets, offsets[-1] + wanted_offsets[1:]])
    first, number = same_rows(whole, np.concatenate([flat, wanted]))
    found: Ints = first[number[count:]]
    return np.where(found < count, found, -1)


def first_in_row(flags: Bools, offsets: Ints) -> Ints:
    """Place of the first True in each row, counted from the beginning of the row; 0 if there is none."""
    place = np.arange(len(flags)) - np.repeat(offsets[:-1], np.diff(offsets))
    none = len(flags)
    first = np.minimum.reduceat(np.where(flags, place, none), offsets[:-1])
    return np.where(first == none, 0, first)


def rotation(offsets: Ints, first: Ints) -> Ints:
    """Positions of all entries with every row turned so that it begins with its entry number ``first``."""
    counts = np.diff(offsets)
    begin, count = np.repeat(offsets[:-1], counts), np.repeat(counts, counts)
    turned: Ints = (np.arange(offsets[-1]) - begin + np.repeat(first, counts)) % count
    return begin + turned


def backwards(offsets: Ints) -> Ints:
    """Positions of all entries with every row from its last to its first."""
    return np.repeat(offsets[:-1] + offsets[1:] - 1, np.diff(offsets)) - np.arange(offsets[-1])


def next_corner(offsets: Ints) -> Ints:
    """Position of the corner that follows each corner in its own cell."""
    follow = np.arange(1, offsets[-1] + 1)
    follow[offsets[1:] - 1] = offsets[:-1]
    return follow


def previous_corner(offsets: Ints) -> Ints:
    """Position of the corner that precedes each corner in its own cell."""
    before = np.arange(-1, offsets[-1] - 1)
    before[offsets[:-1]] = offsets[1:] - 1
    return before


def next_vertex(offsets: Ints, vertices: Ints) -> Ints:
    """Vertex that follows each corner's vertex in its own cell."""
    return vertices[next_corner(offsets)]


def cell_of_corner(offsets: Ints) -> Ints:
    """Cell that each corner belongs to."""
    return np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))


def directed_edges(offsets: Ints, vertices: Ints) -> Ints:
    """The edge (a, b) that starts at each corner, (n_corners, 2)."""
    return np.column_stack([vertices, next_vertex(offsets, vertices)])


def edge_keys(edges: Ints, n_nodes: int) -> Ints:
    """One integer for each undirected edge (m, 2): min * n_nodes + max (exact below 3e9 nodes)."""
    return np.minimum(edges[:, 0], edges[:, 1]) * n_nodes + np.maximum(edges[:, 0], edges[:, 1])


def positions(wanted: Ints, edges: Ints, n_nodes: int) -> Ints:
    """The positions of wanted edges (k, 2) among the edges (m, 2), in either direction; all must be there."""
    return found_in(edge_keys(edges, n_nodes), edge_keys(wanted, n_nodes))


def with_hanging(outlines: tuple[Ints, Ints], ends: Ints, rows: Ints, nodes: Ints) -> tuple[Ints, Ints]:
    """Offsets and vertices of outlines with more nodes on some of their edges, whichever way these run.

    On the edges with the given ends (k, 2) there are, from the first end to the second, ``nodes[rows[k]:rows[k + 1]]``.
    """
    offsets, vertices = outlines
    count = int(max(vertices.max(initial=0), ends.max(initial=0))) + 1
    touched = np.zeros(count, dtype=bool)
    touched[ends] = True
    edges = directed_edges(offsets, vertices)
    corner = np.flatnonzero(touched[edges].all(axis=1))  # only these are looked up
    line = found_in(edge_keys(ends, count), edge_keys(edges[corner], count))
    corner, line = corner[line >= 0], line[line >= 0]
    begin, new = rows_in_order(rows, nodes, line)
    counts, against = np.diff(begin), ends[line, 0] != edges[corner, 0]
    new = np.where(np.repeat(against, counts), new[backwards(begin)], new)
    more = np.bincount(cell_of_corner(offsets)[corner], counts, len(offsets) - 1).astype(np.int64)
    return offsets_of(np.diff(offsets) + more), np.insert(vertices, np.repeat(corner + 1, counts), new)


@dataclass(frozen=True, eq=False)
class SharedEdges:
    """Corners of a mesh sorted by the undirected edge they start."""

    corners: Ints  # (n_corners,) all corners, those of one edge side by side, in the order of their cells
    first: Ints  # (n_edges,) where in `corners` each edge begins
    counts: Ints  # (n_edges,) how many cells share it: 1 on the boundary, 2 inside, more only in broken meshes
    outlines: tuple[Ints, Ints]  # offsets and vertices of the cells

    @cached_property
    def ends(self) -> Ints:
        """(n_edges, 2) the nodes of each edge, the smaller first; edges are in the order of these pairs."""
        return np.sort(directed_edges(*self.outlines)[self.corners[self.first]], axis=1)

    @cached_property
    def number(self) -> Ints:
        """(n_corners,) the edge that starts at each corner."""
        number = np.empty_like(self.corners)
        number[self.corners] = np.repeat(np.arange(len(self.first)), self.counts)
        return number

    @property
    def alone(self) -> Ints:
        """Corners whose edge belongs to one cell only, in the order of the cells."""
        return np.sort(self.corners[self.first[self.counts == 1]])


def shared_edges(offsets: Ints, vertices: Ints, n_nodes: int) -> SharedEdges:
    """Sort the corners by undirected edge (see `SharedEdges`)."""
    keys = edge_keys(directed_edges(offsets, vertices), n_nodes)
    # Not only for the order: keys of meshes come in runs, and this takes a sixth of the time of a quicksort.
    corners = np.argsort(keys, kind="stable")
    keys = keys[corners]
    first = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
    return SharedEdges(corners, first, np.diff(np.append(first, len(keys))), (offsets, vertices))


def smallest_linked(pairs: Ints, count: int) -> Ints:
    """Connected components: for each number below `count` the smallest that pairs (m, 2) link it to, (count,)."""
    links = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    label = connected_components(links, directed=False)[1]
    first: Ints = np.unique(label, return_index=True)[1]
    return first[label]


# Four units in the last place: the middle and the thirds of an edge, computed in any order, stay below two.
TOLERANCE = 4.0 * np.finfo(float).eps


def cross(a: Floats, b: Floats) -> Floats:
    """a x b of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def right_of(vectors: Floats) -> Floats:
    """Vectors (..., 2) turned clockwise by a quarter: outward normals of counter-clockwise edges, as long as these."""
    return np.stack([vectors[..., 1], -vectors[..., 0]], axis=-1)


def rounding(*points: Floats) -> Floats:
    """Length below which a distance between the given points (m, 2) is rounding of their coordinates, (m,)."""
    largest: Floats = np.max([np.abs(point).max(axis=1) for point in points], axis=0)
    return TOLERANCE * largest


def overlapping_boxes(low: Floats, high: Floats, tree_low: Floats, tree_high: Floats) -> tuple[Ints, Ints]:
    """Pairs (i, j) where the box [low_i, high_i] meets the box [tree_low_j, tree_high_j], by i; boxes are (m, d).

    A tree finds the pairs that meet along the two longest axes of all boxes together.
    """
    from shapely import STRtree, linestrings, points

    if not len(low) or not len(tree_low):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    u, v = np.argsort(tree_low.min(axis=0) - tree_high.max(axis=0), kind="stable")[:2]

    def diagonals(low: Floats, high: Floats) -> NDArray[Any]:
        # The tree knows boxes of geometries alone; those of their diagonals take half the time of polygons to make.
        return np.asarray(linestrings(np.stack([low[:, [u, v]], high[:, [u, v]]], axis=1)))

    asked = points(low[:, u], low[:, v]) if low is high else diagonals(low, high)
    i, j = STRtree(diagonals(tree_low, tree_high)).query(asked)
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
    corners, owner = _cut_in_triangles(polygons)
    return Triangles(corners[:, :, :2], signed_areas(corners[:, :, :2]), owner)


def _cut_in_triangles(polygons: NDArray[Any]) -> tuple[Floats, Ints]:
    """Triangles (t, 3, 3) between the vertices of polygons, counter-clockwise, and the polygon of each.

    Of all triangulations they are the one nearest to Delaunay's.
    """
    import shapely

    parts, owner = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons), return_index=True)
    corners = shapely.get_coordinates(shapely.get_exterior_ring(parts), include_z=True).reshape(-1, 4, 3)[:, 2::-1]
    backwards = signed_areas(corners[:, :, :2]) < 0.0
    return np.where(backwards[:, None, None], corners[:, ::-1], corners), owner


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
    origin = corners[:, :1]  # Relative to the first vertex: a body far from the origin loses no digits.
    within: Floats = np.matmul(barycentric, corners - origin)
    return origin + within


def diagonals_of(corners: Floats) -> Ints:
    """Triangles (c, n - 2, 3) of simple polygons (c, n, 2), vertices on straight sides included; counter-clockwise."""
    c, n, _ = corners.shape
    if c == 0:
        return np.zeros((0, n - 2, 3), dtype=np.int64)
    number = np.tile(np.arange(n), c)  # corners are known by their third coordinates
    polygons = outlines(np.column_stack([corners.reshape(-1, 2), number]), np.arange(c + 1) * n, np.arange(c * n))
    return _cut_in_triangles(polygons)[0][:, :, 2].astype(np.int64).reshape(c, n - 2, 3)
