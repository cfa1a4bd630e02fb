"""Families of meshes of a box in space."""

from __future__ import annotations

import numpy as np

from vemcvx.base.arrays import Floats, Ints
from vemcvx.meshes.box import UNIT_CUBE, Box, SpaceCorners, SpaceCount, cell_counts, check_box
from vemcvx.meshes.families.voronoi import voronoi
from vemcvx.meshes.polyhedra import FACES, join_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh


def cubes(
    n: SpaceCount | None = None, box: SpaceCorners = UNIT_CUBE, seed: int = 0, *, size: float | None = None
) -> PolyhedralMesh:
    """Return a mesh of cubes in a box.

    Parameters
    ----------
    n : int or (int, int, int)
        Number of cells along the shortest side, or numbers of cells along x, y and z.
    box : ((x0, x1), (y0, y1), (z0, z1))
        The box to mesh.
    seed : int
        Seed of random numbers, for families with random cells.
    size : float
        Approximate width of a cell, instead of n.

    Returns
    -------
    PolyhedralMesh
        The boundaries are "left" and "right" in x, "front" and "back" in y, "bottom" and "top" in z, and "boundary".

    Raises
    ------
    MeshError
        An argument is invalid, n and size are both given or both missing, or there are too many cells.

    Examples
    --------
    >>> vx.meshes.cubes((2, 2, 4), box=((0, 1), (0, 1), (0, 2)))
    PolyhedralMesh(16 cells, 45 nodes, h = 0.866, boundaries: left, right, front, back, bottom, top, boundary)
    """
    whole = check_box(box, 3)
    points, corners = cube_grid(cell_counts(n, whole, size), whole)
    return mesh_of_equal_cells(points, corners[:, np.array(FACES["hexahedron"])], whole)


def cube_grid(counts: tuple[int, ...], box: Box) -> tuple[Floats, Ints]:
    """Return the nodes layer by layer, and the corners (n_cells, 8) as in `FACES`."""
    nx, ny, nz = counts
    x, y, z = box.ticks(*counts)
    level, row, column = np.meshgrid(z, y, x, indexing="ij")
    points = np.column_stack([column.ravel(), row.ravel(), level.ravel()])
    number = np.arange(len(points)).reshape(nz + 1, ny + 1, nx + 1)
    around = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    corners = [number[k : k + nz, j : j + ny, i : i + nx].ravel() for k, j, i in around]
    return points, np.column_stack(corners)


def mesh_of_equal_cells(points: Floats, faces: Ints, box: Box) -> PolyhedralMesh:
    """Return the mesh of cells with the faces (cells, faces, vertices)."""
    cells, each, sides = faces.shape
    joined = join_faces(np.arange(cells * each + 1) * sides, faces.ravel(), np.arange(cells + 1) * each)
    return PolyhedralMesh.unchecked(points, *joined, box=box)


# Six tetrahedra around the diagonal from corner 0 to corner 6 (H. W. Kuhn, IBM J. Res. Dev. 4 (1960), 518)
CUBE_TETRAHEDRA = np.array([[0, 6, 1, 2], [0, 6, 2, 3], [0, 6, 3, 7], [0, 6, 7, 4], [0, 6, 4, 5], [0, 6, 5, 1]])
"""Corners of each tetrahedron, numbered as in `cube_grid`."""


def tetrahedra(
    n: SpaceCount | None = None, box: SpaceCorners = UNIT_CUBE, seed: int = 0, *, size: float | None = None
) -> PolyhedralMesh:
    """Return a mesh of tetrahedra in a box, six per cell of `cubes`.

    Parameters
    ----------
    n, box, seed, size : as in `cubes`

    Returns
    -------
    PolyhedralMesh

    Examples
    --------
    >>> vx.meshes.tetrahedra(2).n_cells
    48
    """
    whole = check_box(box, 3)
    points, corners = cube_grid(cell_counts(n, whole, size, each=6), whole)
    cells = corners[:, CUBE_TETRAHEDRA].reshape(-1, 4)
    return mesh_of_equal_cells(points, cells[:, np.array(FACES["tetra"])], whole)


def prisms(
    n: SpaceCount | None = None, box: SpaceCorners = UNIT_CUBE, seed: int = 0, *, size: float | None = None
) -> PolyhedralMesh:
    """Return a mesh of upright prisms in a box. Each layer has the polygons of `voronoi`.

    Parameters
    ----------
    n, box, seed, size : as in `cubes`

    Returns
    -------
    PolyhedralMesh

    Examples
    --------
    >>> vx.meshes.prisms(3).n_cells
    27
    """
    whole = check_box(box, 3)
    nx, ny, nz = cell_counts(n, whole, size)
    x, y, _ = box
    return voronoi((nx, ny), (x, y), seed).extruded(whole.ticks(nx, ny, nz)[2])
