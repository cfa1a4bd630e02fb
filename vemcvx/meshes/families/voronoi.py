"""Centroidal Voronoi meshes of a box in the plane, without edges that are too short."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.box import (
    UNIT_BOX,
    Corners,
    Count,
    cell_counts,
    check_box,
    check_fraction,
    check_total,
    check_whole,
    placed,
)
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons.geometry import areas_and_centroids, close_pairs, cross, delaunay, nearest
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    directed_edges,
    next_corner,
    next_vertex,
    offsets_of,
    smallest_linked,
)

# Vertices of a Voronoi mesh that (almost) coincide, made one.
#
# Four seeds on a circle give two Voronoi vertices a rounding error apart, or one short edge; at a straight side,
# where seeds meet their mirror images, this is the rule. `merge_coincident` makes points out of vertices that differ
# by round-off; `collapse_short_edges` shrinks the short edges that are left, as PolyMesher does.


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
    """A mask, shaped like points, of the coordinates on a side of [0, size]."""
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
    """The points where the two ends (m, 2, 2) of each edge become one: a side or corner keeps its coordinates."""
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


# Centroidal Voronoi cells of random seeds, clipped at the box.
#
# Seeds near a side are mirrored in it, so that the side is itself a Voronoi edge and no cell needs cutting; Lloyd's
# iteration then moves every seed to the centroid of its cell. Both ideas, and the collapse of short edges at the end,
# follow PolyMesher (C. Talischi, G. H. Paulino, A. Pereira, I. F. M. Menezes, Struct. Multidiscip. Optim. 45, 2012,
# 309-328). Cells are read off the Delaunay triangulation: the corners of a seed's cell are the circumcentres of its
# triangles, in the order of their directions from the seed.


def voronoi(
    n: Count | None = None,
    box: Corners = UNIT_BOX,
    seed: int = 0,
    *,
    size: float | None = None,
    cells: int | None = None,
    relaxations: int = 50,
    shortest: float = 0.02,
) -> PolygonMesh:
    """Mesh a box with rounded irregular polygons.

    Parameters
    ----------
    n, box, seed, size : as of `squares`
        Which has as many cells.
    cells : int, optional
        Number of cells, instead of n or size.
    relaxations : int
        Lloyd iterations; 0 keeps the raw Voronoi cells of the random seeds.
    shortest : float
        Edges shorter than this part of the root of the mean cell area are collapsed; 0 keeps them all.

    Returns
    -------
    PolygonMesh
        Convex cells (up to the collapse).

    Raises
    ------
    MeshError
        As `squares`, or ``shortest`` not in [0, 0.1].
    """
    rectangle = check_box(box)
    nx, ny = cell_counts(n, rectangle, size) if cells is None else (check_total(check_whole("cells", cells)), 1)
    count = nx * ny
    relaxations = check_whole("relaxations", relaxations, 0, 10_000)
    shortest = check_fraction("shortest", shortest, 0.1, closed=True)
    # Lengths below are in roots of the mean cell area, whatever the units of the rectangle.
    scale = np.sqrt(rectangle.lengths[0] / count) * np.sqrt(rectangle.lengths[1])
    sides = np.array(rectangle.lengths) / scale
    seeds = np.random.default_rng(check_whole("seed", seed, 0)).random((count, 2)) * sides
    seeds = seeds[_by_rows(seeds)]
    for _ in range(relaxations):
        seeds = areas_and_centroids(*_cells_of(seeds, sides))[1]
    points, offsets, vertices = merge_coincident(*_cells_of(seeds, sides), sides)
    if shortest > 0.0:
        points, offsets, vertices = collapse_short_edges(points, offsets, vertices, sides, shortest)
    rows = _by_rows(points)
    number = np.empty_like(rows)
    number[rows] = np.arange(len(rows))
    low, high = np.array(rectangle.low), np.array(rectangle.high)
    return PolygonMesh.unchecked(placed(points[rows], sides, low, high), offsets, number[vertices], box=rectangle)


def _by_rows(points: Floats) -> Ints:
    """An order of points by rows one cell high: neighbours lie near in memory, and assembly is a quarter faster."""
    return np.lexsort((points[:, 0], np.floor(points[:, 1])))


def _cells_of(seeds: Floats, size: Floats) -> tuple[Floats, Ints, Ints]:
    """Voronoi cells of the seeds in [0, size]: points, offsets, vertices; one point a Delaunay triangle."""
    # A relaxed cell is about one unit wide; random ones can be wider, then all of this is done again. A handful of
    # seeds may lie in one line with the first images, which is no triangulation.
    reach = 3.0 if len(seeds) > 50 else np.inf
    while True:
        points, offsets, vertices = _mirrored_cells(seeds, size, reach)
        if reach > size.max() or _fill_the_box(points, offsets, vertices, size):
            return np.clip(points, 0.0, size), offsets, vertices
        reach *= 2.0


def _fill_the_box(points: Floats, offsets: Ints, vertices: Ints, size: Floats) -> bool:
    """Return True if cells fill the box: without mirrored seeds near its sides they leave it, or are open."""
    if np.max(np.abs(points - 0.5 * size) - 0.5 * size) > 1e-6:
        return False
    return bool(abs(areas_and_centroids(points, offsets, vertices)[0].sum() - size.prod()) < 1e-6)


def _mirrored_cells(seeds: Floats, size: Floats, reach: float) -> tuple[Floats, Ints, Ints]:
    images = [seeds]
    for axis in (0, 1):
        for place in (0.0, size[axis]):
            image = seeds[np.abs(seeds[:, axis] - place) < reach]
            image[:, axis] = 2.0 * place - image[:, axis]
            images.append(image)
    sites = np.concatenate(images)
    triangles = delaunay(sites)
    triangles = triangles[(triangles < len(seeds)).any(axis=1)]
    centres = _circumcentres(sites[triangles])
    site, centre = triangles.ravel(), np.repeat(np.arange(len(triangles)), 3)
    inner = site < len(seeds)
    site, centre = site[inner], centre[inner]
    direction = centres[centre] - sites[site]
    order = np.lexsort((np.arctan2(direction[:, 1], direction[:, 0]), site))
    return centres, offsets_of(np.bincount(site, minlength=len(seeds))), centre[order]


def _circumcentres(corners: Floats) -> Floats:
    """Circumcentres of triangles (m, 3, 2) with sides b, c from corner a; J turns by a quarter, J (x, y) = (y, -x).

    a + [ |b|^2 J c - |c|^2 J b ] / (2 b x c)
    """
    b, c = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    bb, cc = (b * b).sum(axis=1), (c * c).sum(axis=1)
    shift = np.column_stack([c[:, 1] * bb - b[:, 1] * cc, b[:, 0] * cc - c[:, 0] * bb])
    return corners[:, 0] + shift / (2.0 * cross(b, c)[:, None])
