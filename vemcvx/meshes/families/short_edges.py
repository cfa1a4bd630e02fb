"""Vertices of a Voronoi mesh that (almost) coincide, made one.

Four seeds on a circle give two Voronoi vertices a rounding error apart, or one short edge; at a straight side, where
seeds meet their mirror images, this is the rule. `merge_coincident` makes points out of vertices that differ by
round-off; `collapse_short_edges` shrinks the short edges that are left, as PolyMesher does.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.polygons.search import close_pairs, nearest
from vemcvx.meshes.polygons.segments import cross
from vemcvx.meshes.polygons.shapes import areas_and_centroids
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    directed_edges,
    next_corner,
    next_vertex,
    offsets_of,
    smallest_linked,
)

# Circumcentres of nearly collinear triples carry 1e-12 of a cell; true edges below 1e-9 are as rare as 1e-9.
ROUND_OFF = 1e-9


def merge_coincident(points: Floats, offsets: Ints, vertices: Ints, size: Floats) -> tuple[Floats, Ints, Ints]:
    """Put points near the sides of [0, size] on them and give points within round-off one number.

    Lengths are in cell widths. Returns points, offsets, vertices; unused points are dropped.
    """
    for side in (np.zeros(2), size):
        points = np.where(np.abs(points - side) < ROUND_OFF, side, points)
    return _renumbered(points, offsets, smallest_linked(close_pairs(points, ROUND_OFF), len(points))[vertices])


def collapse_short_edges(
    points: Floats, offsets: Ints, vertices: Ints, size: Floats, shortest: float
) -> tuple[Floats, Ints, Ints]:
    """Collapse edges shorter than ``shortest``, each to its middle (or to its corner or side of [0, size]).

    An edge stays if a triangle would vanish with it, or a cell would stop being star-shaped about its centroid.
    A round takes edges of which no cell touches two, the shortest first, until none is left.
    """
    refused = np.empty((0, 2))  # middles of edges that cannot go; numbers change from round to round
    while True:
        edges = _short_edges(points, offsets, vertices, size, shortest)
        middles = points[edges].mean(axis=1)
        if len(refused) and len(edges):
            edges = edges[nearest(refused, middles)[0] > ROUND_OFF]
        if not len(edges):
            return points, offsets, vertices
        edges, cells = _far_apart(points, offsets, vertices, edges)
        moved = points.copy()
        moved[edges] = _meeting_points(points[edges], size)[:, None]
        bad = cells[:, _not_star_shaped(points, moved, offsets, vertices)].sum(axis=1) > 0
        refused = np.concatenate([refused, points[edges[bad]].mean(axis=1)])
        moved[edges[bad]] = points[edges[bad]]
        number = np.arange(len(points))
        number[edges[~bad, 1]] = edges[~bad, 0]
        points, offsets, vertices = _renumbered(moved, offsets, number[vertices])


def _renumbered(points: Floats, offsets: Ints, vertices: Ints) -> tuple[Floats, Ints, Ints]:
    """Drop vertices that repeat their successor, then points that no cell uses."""
    keep = vertices != next_vertex(offsets, vertices)
    counts = np.add.reduceat(keep.astype(np.int64), offsets[:-1])
    used, vertices = np.unique(vertices[keep], return_inverse=True)
    return points[used], offsets_of(counts), vertices


def _on_sides(points: Floats, size: Floats) -> Bools:
    """Which coordinates are those of a side of [0, size], bool like points."""
    on_low: Bools = points == 0.0
    on_high: Bools = points == size
    return on_low | on_high


def _short_edges(points: Floats, offsets: Ints, vertices: Ints, size: Floats, shortest: float) -> Ints:
    """Edges (m, 2) to collapse, the shortest first."""
    edges = directed_edges(offsets, vertices)
    length = np.hypot(*(points[edges[:, 0]] - points[edges[:, 1]]).T)
    triangle = np.repeat(np.diff(offsets) == 3, np.diff(offsets))
    forbidden = np.unique(np.sort(edges[(length < shortest) & triangle], axis=1), axis=0)
    edges = edges[length < shortest]
    ends = points[edges]
    on = _on_sides(ends, size)
    # Two nodes of the boundary may become one along a side, but not across the box, and corners stay corners.
    same_side = (on[:, 0] & on[:, 1] & (ends[:, 0] == ends[:, 1])).any(axis=1)
    bridge = np.all(on.any(axis=2), axis=1) & ~same_side
    edges = np.unique(np.sort(edges[~bridge & ~on.all(axis=(1, 2))], axis=1), axis=0)
    edges = edges[~np.isin(edges @ [len(points), 1], forbidden @ [len(points), 1])]
    return edges[np.argsort(np.hypot(*(points[edges[:, 0]] - points[edges[:, 1]]).T), kind="stable")]


def _far_apart(points: Floats, offsets: Ints, vertices: Ints, edges: Ints) -> tuple[Ints, csr_array]:
    """Edges that come first in every cell they touch, and the cells they touch (edges x cells)."""
    corner_cells = cell_of_corner(offsets)
    shape = (len(points), len(offsets) - 1)
    incidence = csr_array((np.ones(len(vertices)), (vertices, corner_cells)), shape=shape)
    touched = (incidence[edges[:, 0]] + incidence[edges[:, 1]]).tocsr()
    rank = np.repeat(np.arange(len(edges)), np.diff(touched.indptr))
    best = np.full(shape[1], len(edges))
    np.minimum.at(best, touched.indices, rank)
    taken = np.minimum.reduceat((best[touched.indices] == rank).astype(np.int64), touched.indptr[:-1]) == 1
    return edges[taken], touched[np.flatnonzero(taken)]


def _meeting_points(ends: Floats, size: Floats) -> Floats:
    """Where the two ends (m, 2, 2) of each edge become one: a side or corner keeps its coordinates."""
    on = _on_sides(ends, size)
    middle: Floats = ends.mean(axis=1)
    for end in (0, 1):
        middle = np.where(on[:, end], ends[:, end], middle)
    return middle


def _not_star_shaped(points: Floats, moved: Floats, offsets: Ints, vertices: Ints) -> Ints:
    """Cells that, once their vertices moved, are not star-shaped about the centroid they had."""
    _, centroids = areas_and_centroids(points, offsets, vertices)
    here = moved[vertices] - np.repeat(centroids, np.diff(offsets), axis=0)
    after = here[next_corner(offsets)]
    collapsed = (here == after).all(axis=1)
    fan = np.where(collapsed, np.inf, cross(here, after))
    return np.flatnonzero(np.minimum.reduceat(fan, offsets[:-1]) <= 0.0)
