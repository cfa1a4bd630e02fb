"""Centroidal Voronoi meshes of a box in the plane and in space.

Seeds near a side of the box are reflected in this side, so that no cell crosses the side. Lloyd's iteration moves every
seed to the centroid of the cell. In the plane, short edges are collapsed at the end. All three steps follow PolyMesher
(C. Talischi, G. H. Paulino, A. Pereira, I. F. M. Menezes, Struct. Multidiscip. Optim. 45, 2012, 309-328).

Seeds lie in a scaled box, in which the mean area or volume of cells is one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import chain
from typing import TypeVar

import numpy as np

from vemcvx.base.arrays import SAME, SINGLE_EPS, Floats, Ints, is_real
from vemcvx.base.errors import MeshError
from vemcvx.meshes.box import (
    UNIT_BOX,
    UNIT_CUBE,
    Box,
    Corners,
    Count,
    SpaceCorners,
    SpaceCount,
    cell_counts,
    check_box,
    check_total,
    check_whole,
    move_into_box,
)
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import (
    areas_and_centroids,
    cell_of_corner,
    close_pairs,
    corner_edges,
    cross,
    next_corner,
    next_vertex,
    offsets_of,
    reverse_rows,
    smallest_linked,
)
from vemcvx.meshes.polyhedra import Faces, face_shapes, signs_of, volumes_and_centroids
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh


def voronoi(
    n: Count | None = None,
    box: Corners = UNIT_BOX,
    seed: int = 0,
    *,
    size: float | None = None,
    cells: int | None = None,
    shortest: float = 0.02,
) -> PolygonMesh:
    """Return a centroidal Voronoi mesh of a box.

    Parameters
    ----------
    n, box, seed, size : as in `squares`
        The number of cells is the same as in `squares`.
    cells : int, optional
        Number of cells, instead of n or size.
    shortest : float
        Length below which edges are collapsed, from 0 to 0.1, relative to sqrt(mean cell area).

    Returns
    -------
    PolygonMesh
        Cells are convex, except where edges were collapsed.

    Examples
    --------
    >>> vx.meshes.voronoi(cells=20, seed=1).n_cells
    20
    """
    rectangle = check_box(box)
    count = math.prod(cell_counts(n, rectangle, size)) if cells is None else check_whole("cells", cells)
    check_total(count)
    if not is_real(shortest) or not 0.0 <= shortest <= 0.1:
        raise MeshError(f"shortest must be a number in [0, 0.1]; got {shortest!r}.")
    sides = np.array(rectangle.lengths) / (np.sqrt(rectangle.lengths[0] / count) * np.sqrt(rectangle.lengths[1]))
    points, (offsets, vertices) = _relax(seed, count, sides, 50, _polygons)
    for side in (np.zeros(2), sides):
        points = np.where(np.abs(points - side) < SAME, side, points)
    place = smallest_linked(close_pairs(points, SAME), len(points))
    points, offsets, vertices, _ = _drop_repeats(points, offsets, place[vertices])
    if shortest > 0.0:
        points, offsets, vertices = collapse_short_edges(points, offsets, vertices, sides, shortest)
    points, number = _sort_by_rows(points)
    points = move_into_box(points, sides, np.array(rectangle.low), np.array(rectangle.high))
    return PolygonMesh.unchecked(points, offsets, number[vertices], box=rectangle)


def voronoi3(
    n: SpaceCount | None = None, box: SpaceCorners = UNIT_CUBE, seed: int = 0, *, size: float | None = None
) -> PolyhedralMesh:
    """Return a mesh of irregular convex polyhedra (about 14 faces) in a box.

    Parameters
    ----------
    n, box, seed, size : as in `cubes`

    Returns
    -------
    PolyhedralMesh
        Edges may be arbitrarily short.

    Examples
    --------
    >>> vx.meshes.voronoi3((4, 5, 1), seed=1).n_cells
    20
    """
    whole = check_box(box, 3)
    count = math.prod(cell_counts(n, whole, size))
    lengths = np.array(whole.lengths)
    sides = lengths * (count / np.prod(lengths / lengths.max())) ** (1.0 / 3.0) / lengths.max()
    return _solid(*_relax(seed, count, sides, 5, _polyhedra), sides, whole)


def kelvin(
    n: SpaceCount | None = None, box: SpaceCorners = UNIT_CUBE, seed: int = 0, *, size: float | None = None
) -> PolyhedralMesh:
    """Return a mesh of truncated octahedra (Kelvin's foam) in a box, cut at the sides of the box.

    Parameters
    ----------
    n, box, seed, size : as in `cubes`
        The mesh has two cells for each cube of `cubes`.

    Returns
    -------
    PolyhedralMesh

    Examples
    --------
    >>> vx.meshes.kelvin(2).n_cells
    16
    """
    # Truncated octahedra are the Voronoi cells of a body-centred lattice.
    whole = check_box(box, 3)
    counts = cell_counts(n, whole, size, each=2)
    first = np.indices(counts).reshape(3, -1).T + 0.25
    seeds, _ = _sort_by_rows(np.concatenate([first, first + 0.5]))
    sides = np.array(counts, dtype=float)
    return _solid(*_polyhedra(seeds, sides, MIRROR_DISTANCE[3]), sides, whole)


def _solid(points: Floats, faces: Faces, sides: Floats, box: Box) -> PolyhedralMesh:
    """Return the mesh of faces, moved from [0, sides] into a box."""
    points, number = _sort_by_rows(points)
    faces = faces._replace(face_vertices=number[faces.face_vertices])
    points = move_into_box(points, sides, np.array(box.low), np.array(box.high))
    return PolyhedralMesh.unchecked(points, *faces, box=box)


Cells = TypeVar("Cells", tuple[Ints, Ints], Faces)  # polygons as (offsets, vertices), or polyhedra
MIRROR_DISTANCE = {2: 3.0, 3: 2.0}  # dimension -> width of the reflected strip, in cell widths


def _relax(
    seed: int, count: int, size: Floats, relaxations: int, cut: Callable[[Floats, Floats, float], tuple[Floats, Cells]]
) -> tuple[Floats, Cells]:
    """Return points and Voronoi cells after Lloyd's iteration."""
    seeds = _sort_by_rows(np.random.default_rng(check_whole("seed", seed, 0)).random((count, len(size))) * size)[0]
    for _ in range(relaxations + 1):
        # If there are few seeds, all are reflected, because they may lie on one line.
        reach = MIRROR_DISTANCE[len(size)] if count > 50 else np.inf
        while True:
            points, cells = cut(seeds, size, reach)
            # With too few mirror images, cells leave the box or are open.
            inside = np.max(np.abs(points - 0.5 * size) - 0.5 * size) < SINGLE_EPS
            points = np.clip(points, 0.0, size)
            measures, centroids = _measures_and_centroids(points, cells)
            if reach > size.max() or (inside and abs(measures.sum() - count) < SINGLE_EPS):
                break
            reach *= 2.0
        seeds = centroids
    return points, cells


def _measures_and_centroids(points: Floats, cells: tuple[Ints, Ints] | Faces) -> tuple[Floats, Floats]:
    if not isinstance(cells, Faces):
        return areas_and_centroids(points, *cells)
    shapes = face_shapes(points, cells.face_offsets, cells.face_vertices)
    return volumes_and_centroids(shapes, cells.cell_offsets, cells.cell_faces, signs_of(cells))


def _sort_by_rows(points: Floats) -> tuple[Floats, Ints]:
    """Return points sorted by layers and rows, and the new numbers."""
    rows = np.lexsort((points[:, 0], *np.floor(points[:, 1:]).T))
    number = np.empty_like(rows)
    number[rows] = np.arange(len(rows))
    return points[rows], number


def _mirror(seeds: Floats, size: Floats, reach: float) -> tuple[Floats, Ints, Ints]:
    """Return seeds and mirror images, seed numbers, and side numbers or -1."""
    images, origin, wall = [seeds], [np.arange(len(seeds))], [np.full(len(seeds), -1)]
    for side in range(2 * len(size)):
        axis, place = side // 2, size[side // 2] * (side % 2)
        near = np.flatnonzero(np.abs(seeds[:, axis] - place) < reach)
        image = seeds[near]
        image[:, axis] = 2.0 * place - image[:, axis]
        images.append(image)
        origin.append(near)
        wall.append(np.full(len(near), side))
    return np.concatenate(images), np.concatenate(origin), np.concatenate(wall)


def _polygons(seeds: Floats, size: Floats, reach: float) -> tuple[Floats, tuple[Ints, Ints]]:
    """Return the vertices and the Voronoi cells of the seeds."""
    from scipy.spatial import Delaunay, QhullError

    sites = _mirror(seeds, size, reach)[0]
    try:
        triangles = Delaunay(sites).simplices.astype(np.int64)
    except QhullError as error:
        raise MeshError(f"{len(sites)} points have no triangulation: they nearly lie on one line.") from error
    triangles = triangles[(triangles < len(seeds)).any(axis=1)]
    centres = _circumcentres(sites[triangles])
    site, centre = triangles.ravel(), np.repeat(np.arange(len(triangles)), 3)
    inner = site < len(seeds)
    site, centre = site[inner], centre[inner]
    direction = centres[centre] - sites[site]
    order = np.lexsort((np.arctan2(direction[:, 1], direction[:, 0]), site))
    return centres, (offsets_of(np.bincount(site, minlength=len(seeds))), centre[order])


def _circumcentres(corners: Floats) -> Floats:
    """Return the circumcentres of triangles."""
    b, c = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    bb, cc = (b * b).sum(axis=1), (c * c).sum(axis=1)
    shift = np.column_stack([c[:, 1] * bb - b[:, 1] * cc, b[:, 0] * cc - c[:, 0] * bb])
    return corners[:, 0] + shift / (2.0 * cross(b, c)[:, None])


def collapse_short_edges(
    points: Floats, offsets: Ints, vertices: Ints, size: Floats, shortest: float
) -> tuple[Floats, Ints, Ints]:
    """Collapse edges shorter than `shortest` if cells stay star-shaped about old centroids."""
    edges = corner_edges(offsets, vertices)
    ends, on = points[edges], (points == 0.0) | (points == size)
    bridge = on[edges].any(axis=2).all(axis=1) & ~(on[edges].all(axis=1) & (ends[:, 0] == ends[:, 1])).any(axis=1)
    edges = edges[(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) < shortest) & ~bridge]
    owner, after = cell_of_corner(offsets), next_corner(offsets)
    centroids = areas_and_centroids(points, offsets, vertices)[1]
    while True:
        place = smallest_linked(edges, len(points))
        mean = np.column_stack([np.bincount(place, x) for x in points.T]) / np.bincount(place).clip(1)[:, None]
        side = np.full_like(mean, -1.0)
        np.maximum.at(side, place, np.where(on, points, -1.0))
        moved = np.where(side >= 0.0, side, mean)[place]
        arm = moved[vertices] - centroids[owner]
        kept = place[vertices] != place[vertices[after]]
        bad = (kept & (cross(arm, arm[after]) <= 0.0)) | (np.bincount(owner, kept) < 3)[owner]
        bad |= (on & (moved != points)).any(axis=1)[vertices]
        if not bad.any():
            return _drop_repeats(moved, offsets, place[vertices])[:3]
        edges = edges[~np.isin(edges, vertices[np.isin(owner, owner[bad])]).any(axis=1)]


def _drop_repeats(points: Floats, offsets: Ints, vertices: Ints) -> tuple[Floats, Ints, Ints, Ints]:
    """Drop repeated vertices, rows with fewer than three vertices, and unused points."""
    fresh = vertices != next_vertex(offsets, vertices)
    counts = np.add.reduceat(fresh.astype(np.int64), offsets[:-1])
    left = counts > 2
    used, vertices = np.unique(vertices[fresh & np.repeat(left, np.diff(offsets))], return_inverse=True)
    return points[used], offsets_of(counts[left]), vertices, np.flatnonzero(left)


def _polyhedra(seeds: Floats, size: Floats, reach: float) -> tuple[Floats, Faces]:
    from scipy.spatial import Voronoi

    sites, origin, walls = _mirror(seeds, size, reach)
    found, count = Voronoi(sites), len(seeds)
    points, corners = found.vertices, found.ridge_vertices
    first, second = np.sort(found.ridge_points, axis=1).astype(np.int64).T
    # Leave out faces that rounding makes at edges of the box.
    kept = np.flatnonzero((first < count) & ((second < count) | (origin[second] == first)))
    kept = kept[np.lexsort((second[kept], first[kept]))]
    offsets = offsets_of(np.array([len(corners[k]) for k in kept]))
    vertices = np.fromiter(chain.from_iterable(corners[k] for k in kept), np.int64, offsets[-1])
    first, second = first[kept], second[kept]
    side = walls[second]
    of_corner = np.repeat(side, np.diff(offsets))
    for wall in range(6):  # vertices on sides get exact coordinates
        points[vertices[of_corner == wall], wall // 2] = size[wall // 2] * (wall % 2)
    place = smallest_linked(close_pairs(points, SAME), len(points))
    points, offsets, vertices, left = _drop_repeats(points, offsets, place[vertices])
    first, second, side = first[left], second[left], side[left]
    outwards = np.einsum("ij,ij->i", face_shapes(points, offsets, vertices).normals, sites[second] - sites[first])
    vertices = reverse_rows(offsets, vertices, outwards < 0.0)
    face_cells = np.column_stack([first, np.where(side < 0, second, -1)])
    number, owner = np.repeat(np.arange(len(face_cells)), 2), face_cells.ravel()
    number, owner = number[owner >= 0], owner[owner >= 0]
    order = np.argsort(owner, kind="stable")
    cell_offsets = offsets_of(np.bincount(owner, minlength=count))
    return points, Faces(offsets, vertices, cell_offsets, number[order], face_cells)
