"""Centroidal Voronoi cells of random seeds, clipped at the box.

Seeds near a side are mirrored in it, so that the side is itself a Voronoi edge and no cell needs cutting; Lloyd's
iteration then moves every seed to the centroid of its cell. Both ideas, and the collapse of short edges at the end,
follow PolyMesher (C. Talischi, G. H. Paulino, A. Pereira, I. F. M. Menezes, Struct. Multidiscip. Optim. 45, 2012,
309-328). Cells are read off the Delaunay triangulation: the corners of a seed's cell are the circumcentres of its
triangles, in the order of their directions from the seed.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints
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
from vemcvx.meshes.families.short_edges import collapse_short_edges, merge_coincident
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons.search import delaunay
from vemcvx.meshes.polygons.segments import cross
from vemcvx.meshes.polygons.shapes import areas_and_centroids
from vemcvx.meshes.polygons.topology import offsets_of


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
    scale = np.sqrt(rectangle.width / count) * np.sqrt(rectangle.height)
    sides = np.array([rectangle.width, rectangle.height]) / scale
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
    low, high = np.array([rectangle.left, rectangle.bottom]), np.array([rectangle.right, rectangle.top])
    return PolygonMesh.unchecked(placed(points[rows], sides, low, high), offsets, number[vertices], rectangle)


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
    """Whether the seeds near the sides were mirrored: else cells leave the box, or are open to one side."""
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
