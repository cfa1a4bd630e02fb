"""Voronoi cells of random seeds in a box in space.

As in the plane (`voronoi`), seeds near a side are mirrored in it, so that the side is itself made of faces of the
Voronoi cells and no cell needs cutting; Lloyd's iteration then moves every seed to the centroid of its cell. In space,
short edges stay: four cells meet in a vertex, and to move it would bend their faces. Vertices are merged only where
rounding alone keeps them apart.
"""

from __future__ import annotations

import math
from itertools import chain

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.box import (
    UNIT_CUBE,
    SpaceCorners,
    SpaceCount,
    check_space_box,
    check_total,
    check_whole,
    placed,
    space_counts,
)
from vemcvx.meshes.polygons.search import close_pairs, voronoi_faces
from vemcvx.meshes.polygons.topology import next_vertex, offsets_of, smallest_linked, turned
from vemcvx.meshes.polyhedra.shapes import face_shapes, volumes_and_centroids
from vemcvx.meshes.polyhedra.topology import Faces, signs_of
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

# In widths of a cell: vertices so near to each other, or to a side, are one vertex, or lie on it.
MERGED = 1e-9


def voronoi3(
    n: SpaceCount | None = None,
    box: SpaceCorners = UNIT_CUBE,
    seed: int = 0,
    *,
    size: float | None = None,
    cells: int | None = None,
    relaxations: int = 5,
) -> PolyhedralMesh:
    """Mesh a box with irregular convex polyhedra of about 14 faces.

    Parameters
    ----------
    n, box, seed, size : as of `cubes`
        Which has as many cells.
    cells : int, optional
        Number of cells, instead of n or size.
    relaxations : int
        Lloyd iterations, each as long as the mesh itself takes; 0 keeps the raw Voronoi cells of the random seeds.

    Returns
    -------
    PolyhedralMesh
        Cells and nodes by layers and rows one cell high. Faces are plane to rounding, edges may be as short as chance
        makes them.

    Raises
    ------
    MeshError
        As `cubes`.
    """
    whole = check_space_box(box)
    counts = space_counts(n, whole, size) if cells is None else (check_total(check_whole("cells", cells)),)
    count = math.prod(counts)
    relaxations = check_whole("relaxations", relaxations, 0, 10_000)
    # Lengths below are in widths of a cell, whatever the units of the box.
    lengths = np.array(whole.lengths)
    sides = lengths * (count / np.prod(lengths / lengths.max())) ** (1.0 / 3.0) / lengths.max()
    seeds = np.random.default_rng(check_whole("seed", seed, 0)).random((count, 3)) * sides
    seeds = seeds[_by_layers(seeds)]
    for _ in range(relaxations):
        seeds = _volumes_and_centroids(*_cells_of(seeds, sides))[1]
    points, faces = _cells_of(seeds, sides)
    rows = _by_layers(points)
    number = np.empty_like(rows)
    number[rows] = np.arange(len(rows))
    faces = faces._replace(face_vertices=number[faces.face_vertices])
    return PolyhedralMesh.unchecked(
        placed(points[rows], sides, np.array(whole.low), np.array(whole.high)), **faces._asdict(), box=whole
    )


def _by_layers(points: Floats) -> Ints:
    """An order of points by layers and rows one cell high: neighbours lie near in memory."""
    return np.lexsort((points[:, 0], np.floor(points[:, 1]), np.floor(points[:, 2])))


def _volumes_and_centroids(points: Floats, faces: Faces) -> tuple[Floats, Floats]:
    found = face_shapes(points, faces.face_offsets, faces.face_vertices)
    return volumes_and_centroids(found, faces.cell_offsets, faces.cell_faces, signs_of(faces))


def _cells_of(seeds: Floats, size: Floats) -> tuple[Floats, Faces]:
    """Voronoi cells of the seeds in [0, size]."""
    # A cell is about one unit wide; random ones can be wider, then all of this is done again.
    reach = 2.0 if len(seeds) > 50 else np.inf
    while True:
        points, faces = _mirrored_cells(seeds, size, reach)
        inside = np.max(np.abs(points - 0.5 * size) - 0.5 * size) < 1e-6
        if reach > size.max() or (inside and abs(_volumes_and_centroids(points, faces)[0].sum() - len(seeds)) < 1e-6):
            return np.clip(points, 0.0, size), faces
        reach *= 2.0


def _mirrored_cells(seeds: Floats, size: Floats, reach: float) -> tuple[Floats, Faces]:
    count = len(seeds)
    images, origin, wall = [seeds], [np.arange(count)], [np.full(count, -1)]
    for side in range(6):
        axis, place = side // 2, size[side // 2] * (side % 2)
        near = np.flatnonzero(np.abs(seeds[:, axis] - place) < reach)
        image = seeds[near]
        image[:, axis] = 2.0 * place - image[:, axis]
        images.append(image)
        origin.append(near)
        wall.append(np.full(len(near), side))
    sites, of, walls = np.concatenate(images), np.concatenate(origin), np.concatenate(wall)
    points, pairs, corners = voronoi_faces(sites)
    pairs = np.sort(pairs, axis=1)
    first, second = pairs.T
    # Faces inside, and those between a seed and its own image; others with images are rounding at the box's edges.
    kept = np.flatnonzero((first < count) & ((second < count) | (of[second] == first)))
    kept = kept[np.lexsort((second[kept], first[kept]))]
    offsets = offsets_of(np.array([len(corners[k]) for k in kept]))
    vertices = np.fromiter(chain.from_iterable(corners[k] for k in kept), np.int64, offsets[-1])
    first, second = first[kept], second[kept]
    side = walls[second]
    _snap(points, vertices, np.repeat(side, np.diff(offsets)), size)
    points, offsets, vertices, left = _merged(points, offsets, vertices)
    first, second, side = first[left], second[left], side[left]
    outwards = np.einsum("ij,ij->i", face_shapes(points, offsets, vertices).normals, sites[second] - sites[first])
    vertices = turned(offsets, vertices, outwards < 0.0)
    return points, _listed(offsets, vertices, np.column_stack([first, np.where(side < 0, second, -1)]), count)


def _snap(points: Floats, vertices: Ints, side: Ints, size: Floats) -> None:
    """Put the vertices of faces on a side of the box there, to the bit; in place."""
    for number in range(6):
        axis = number // 2
        points[vertices[side == number], axis] = size[axis] * (number % 2)


def _merged(points: Floats, offsets: Ints, vertices: Ints) -> tuple[Floats, Ints, Ints, Ints]:
    """Used points with those in the same place made one, rows without repetitions, and which of the rows are left."""
    used, vertices = np.unique(vertices, return_inverse=True)
    points = points[used]
    place = smallest_linked(close_pairs(points, MERGED), len(points))
    vertices = place[vertices]
    rows = np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))
    fresh = next_vertex(offsets, vertices) != vertices
    counts = np.bincount(rows[fresh], minlength=len(offsets) - 1)
    left = counts > 2
    vertices = vertices[fresh & left[rows]]
    used, vertices = np.unique(vertices, return_inverse=True)
    return points[used], offsets_of(counts[left]), vertices, np.flatnonzero(left)


def _listed(offsets: Ints, vertices: Ints, face_cells: Ints, cells: int) -> Faces:
    """Faces with their cells, cell by cell."""
    number = np.repeat(np.arange(len(face_cells)), 2)
    owner = face_cells.ravel()
    number, owner = number[owner >= 0], owner[owner >= 0]
    order = np.argsort(owner, kind="stable")
    return Faces(offsets, vertices, offsets_of(np.bincount(owner, minlength=cells)), number[order], face_cells)
