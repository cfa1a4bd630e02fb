"""Families of meshes of a box in space."""

from __future__ import annotations

import math
from itertools import chain, product

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.box import (
    UNIT_CUBE,
    Box,
    SpaceCorners,
    SpaceCount,
    cell_counts,
    check_box,
    check_total,
    check_whole,
    placed,
)
from vemcvx.meshes.families.voronoi import voronoi
from vemcvx.meshes.polygons.geometry import close_pairs, voronoi_faces
from vemcvx.meshes.polygons.topology import next_vertex, offsets_of, rows_in_order, smallest_linked, turned
from vemcvx.meshes.polyhedra import FACES, Faces, face_shapes, joined_faces, signs_of, volumes_and_centroids
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

# Equal boxes (cubes where the box allows), numbered layer by layer, row by row.


def cubes(
    n: SpaceCount | None = None, box: SpaceCorners = UNIT_CUBE, seed: int = 0, *, size: float | None = None
) -> PolyhedralMesh:
    """Mesh a box with equal cubes; other families in space take what this one takes, and name the sides as it does.

    Parameters
    ----------
    n : int or (int, int, int)
        Cells across the shortest side of the box, and along the others as many as make them most nearly cubes; or the
        numbers of cells along x, y and z.
    box : ((x0, x1), (y0, y1), (z0, z1))
        The box to mesh.
    seed : int
        Start of the random numbers: the same seed gives the same mesh. Nothing is random here.
    size : float
        The width of a cell, instead of n; cells are as near to it as whole numbers of them come.

    Returns
    -------
    PolyhedralMesh
        Nodes and cells layer by layer, row by row; boundaries "left" and "right" (x least and greatest), "front" and
        "back" (y), "bottom" and "top" (z) and "boundary"; in the unit cube h = sqrt(3) / n.

    Raises
    ------
    MeshError
        n is not a positive whole number, size is not a positive length, both or neither are given, or box is no box.
    """
    whole = check_box(box, 3)
    points, corners = cube_grid(cell_counts(n, whole, size), whole)
    return mesh_of_equal_cells(points, corners[:, np.array(FACES["hexahedron"])], whole)


def cube_grid(counts: tuple[int, ...], box: Box) -> tuple[Floats, Ints]:
    """Nodes, layer by layer, and the corners (n_cells, 8) of the cells: around the bottom, then around the top."""
    nx, ny, nz = counts
    x, y, z = box.ticks(*counts)
    level, row, column = np.meshgrid(z, y, x, indexing="ij")
    points = np.column_stack([column.ravel(), row.ravel(), level.ravel()])
    number = np.arange(len(points)).reshape(nz + 1, ny + 1, nx + 1)
    around = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    corners = [number[k : k + nz, j : j + ny, i : i + nx].ravel() for k, j, i in around]
    return points, np.column_stack(corners)


def mesh_of_equal_cells(points: Floats, faces: Ints, box: Box) -> PolyhedralMesh:
    """The mesh of cells that all have as many faces, of as many vertices: (n_cells, faces, vertices), outwards."""
    cells, each, sides = faces.shape
    joined = joined_faces(np.arange(cells * each + 1) * sides, faces.ravel(), np.arange(cells + 1) * each)
    return PolyhedralMesh.unchecked(points, *joined, box=box)


# Cubes cut in six tetrahedra about the diagonal from the lowest to the highest corner, which fit face to face.
#
# One tetrahedron an order of the axes: from the lowest corner along the first axis, then the second, then the third
# (H. W. Kuhn, IBM J. Res. Dev. 4 (1960), 518-524). All have the shape of one of them or of its mirror image, and
# halving n nests the meshes.


# Corners of a hexahedron (see `cubes`); the second to the fourth run counter-clockwise seen from the first.
SIX = np.array([[0, 6, 1, 2], [0, 6, 2, 3], [0, 6, 3, 7], [0, 6, 7, 4], [0, 6, 4, 5], [0, 6, 5, 1]])


def tetrahedra(
    n: SpaceCount | None = None, box: SpaceCorners = UNIT_CUBE, seed: int = 0, *, size: float | None = None
) -> PolyhedralMesh:
    """Mesh a box with tetrahedra, six to each cell of `cubes`.

    Parameters
    ----------
    n, box, seed, size : as of `cubes`

    Returns
    -------
    PolyhedralMesh
        Nodes layer by layer, row by row; the six tetrahedra of a cube one after the other.
    """
    whole = check_box(box, 3)
    points, corners = cube_grid(cell_counts(n, whole, size, each=6), whole)
    cells = corners[:, SIX].reshape(-1, 4)
    return mesh_of_equal_cells(points, cells[:, np.array(FACES["tetra"])], whole)


# Layers of prisms over polygons.


def prisms(
    n: SpaceCount | None = None, box: SpaceCorners = UNIT_CUBE, seed: int = 0, *, size: float | None = None
) -> PolyhedralMesh:
    """Mesh a box with upright prisms over the rounded irregular polygons of `voronoi`, in equal layers.

    Prisms over any other polygons are made by :meth:`vemcvx.PolygonMesh.extruded`.

    Parameters
    ----------
    n, box, seed, size : as of `cubes`
        Which has as many cells.

    Returns
    -------
    PolyhedralMesh
        Nodes and cells layer by layer.
    """
    whole = check_box(box, 3)
    nx, ny, nz = cell_counts(n, whole, size)
    x, y, _ = box
    return voronoi((nx, ny), (x, y), seed).extruded(whole.ticks(nx, ny, nz)[2])


# Truncated octahedra, which fill space: the cells of Kelvin's foam, with plane faces.
#
# A cell sits in the middle of every cube of a grid, and one about every node of it, of which the box keeps a half, a
# quarter or an eighth. Places are whole numbers, in quarters of the cubes: a cell about the origin has its vertices
# at all permutations of (0, +-1, +-2) (W. Thomson, Phil. Mag. 24 (1887), 503-514).


VERTICES = np.array([v for v in product(range(-2, 3), repeat=3) if sorted(map(abs, v)) == [0, 1, 2]])


def kelvin(
    n: SpaceCount | None = None, box: SpaceCorners = UNIT_CUBE, seed: int = 0, *, size: float | None = None
) -> PolyhedralMesh:
    """Mesh a box with truncated octahedra, cut in halves, quarters and eighths at its sides.

    Parameters
    ----------
    n, box, seed, size : as of `cubes`
        The cells in the middle of the cubes; there is one more about each node of `cubes`.

    Returns
    -------
    PolyhedralMesh
        Cells in the middle of cubes first, then those about nodes, both layer by layer; nodes layer by layer.
    """
    whole = check_box(box, 3)
    counts = np.array(cell_counts(n, whole, size, each=2))
    middles = 4 * _grid(counts) + 2
    corners = 4 * _grid(counts + 1)
    # -1, 0, 1 along each axis: on the lower side of the box, inside, on the upper one.
    cut = (corners == 4 * counts).astype(np.int64) - (corners == 0)
    sites = np.concatenate([middles, corners])
    cut = np.concatenate([np.zeros_like(middles), cut])
    blocks, owner = [], []
    for sides in np.unique(cut, axis=0):
        members = np.flatnonzero((cut == sides).all(axis=1))
        for face in _faces(tuple(sides.tolist())):
            blocks.append(sites[members, None] + face)
            owner.append(members)
    width, depth = 4 * counts[:2] + 1
    x, y, z = np.concatenate([block.reshape(-1, 3) for block in blocks]).T
    used, vertices = np.unique((z * depth + y) * width + x, return_inverse=True)
    sizes = np.concatenate([np.full(len(block), block.shape[1]) for block in blocks])
    cells = np.concatenate(owner)
    offsets, vertices = rows_in_order(offsets_of(sizes), vertices, np.argsort(cells, kind="stable"))
    joined = joined_faces(offsets, vertices, offsets_of(np.bincount(cells)))
    at = (used % width, used // width % depth, used // (width * depth))
    lines = whole.ticks(*(4 * counts).tolist())
    points = np.column_stack([line[place] for line, place in zip(lines, at, strict=True)])
    return PolyhedralMesh.unchecked(points, *joined, box=whole)


def _grid(counts: Ints) -> Ints:
    """Whole numbers below the counts along x, y and z, (m, 3), layer by layer."""
    z, y, x = np.indices(tuple(counts[::-1].tolist())).reshape(3, -1)
    return np.column_stack([x, y, z])


def _faces(cut: tuple[int, ...]) -> list[Ints]:
    """Faces of a cell about the origin, each (k, 3), outwards: less what is beyond the origin along the axes cut."""
    outwards = [np.array(signs) for signs in product((-1, 1), repeat=3)]
    outwards += [sign * axis for axis in np.eye(3, dtype=np.int64) for sign in (-1, 1)]
    planes = [(out, 3 if out.all() else 2) for out in outwards]
    planes += [(sign * axis, 0) for sign, axis in zip(cut, np.eye(3, dtype=np.int64), strict=True) if sign]
    faces = [_around(VERTICES[VERTICES @ out == height], out) for out, height in planes]
    for axis, sign in enumerate(cut):
        if sign:
            parts = [_below(face, sign * face[:, axis]) for face in faces]
            faces = [part for part in parts if len(part) > 2]
    return faces


def _around(points: Ints, normal: Ints) -> Ints:
    """Points of a convex polygon in order around the normal."""
    arm = points - points.mean(axis=0)
    ahead = arm[0]
    return points[np.argsort(np.arctan2(arm @ np.cross(normal, ahead) / np.linalg.norm(normal), arm @ ahead))]


def _below(face: Ints, height: Ints) -> Ints:
    """The part of a convex polygon where the height of its vertices is not above zero; it cuts edges in the middle."""
    kept = []
    for k in range(len(face)):
        after = (k + 1) % len(face)
        if height[k] <= 0:
            kept.append(face[k])
        if height[k] * height[after] < 0:
            kept.append((face[k] + face[after]) // 2)
    return np.array(kept)


# Voronoi cells of random seeds in a box in space.
#
# As in the plane (`voronoi`), seeds near a side are mirrored in it, so that the side is itself made of faces of the
# Voronoi cells and no cell needs cutting; Lloyd's iteration then moves every seed to the centroid of its cell. In
# space, short edges stay: four cells meet in a vertex, and to move it would bend their faces. Vertices are merged
# only where rounding alone keeps them apart.


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
    whole = check_box(box, 3)
    counts = cell_counts(n, whole, size) if cells is None else (check_total(check_whole("cells", cells)),)
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
        placed(points[rows], sides, np.array(whole.low), np.array(whole.high)), *faces, box=whole
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
    # Vertices that are 1e-9 of a cell's width apart are one.
    place = smallest_linked(close_pairs(points, 1e-9), len(points))
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
