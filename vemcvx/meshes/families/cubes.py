"""Equal boxes (cubes where the box allows), numbered layer by layer, row by row."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.box import UNIT_CUBE, SpaceBox, SpaceCorners, SpaceCount, check_space_box, space_counts, ticks
from vemcvx.meshes.polyhedra.standard import FACES
from vemcvx.meshes.polyhedra.topology import joined_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh


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
    whole = check_space_box(box)
    points, corners = cube_grid(space_counts(n, whole, size), whole)
    return mesh_of_equal_cells(points, corners[:, np.array(FACES["hexahedron"])], whole)


def cube_grid(counts: tuple[int, int, int], box: SpaceBox) -> tuple[Floats, Ints]:
    """Nodes, layer by layer, and the corners (n_cells, 8) of the cells: around the bottom, then around the top."""
    nx, ny, nz = counts
    x, y, z = (ticks(low, high, count) for low, high, count in zip(box.low, box.high, counts, strict=True))
    level, row, column = np.meshgrid(z, y, x, indexing="ij")
    points = np.column_stack([column.ravel(), row.ravel(), level.ravel()])
    number = np.arange(len(points)).reshape(nz + 1, ny + 1, nx + 1)
    around = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    corners = [number[k : k + nz, j : j + ny, i : i + nx].ravel() for k, j, i in around]
    return points, np.column_stack(corners)


def mesh_of_equal_cells(points: Floats, faces: Ints, box: SpaceBox) -> PolyhedralMesh:
    """The mesh of cells that all have as many faces, of as many vertices: (n_cells, faces, vertices), outwards."""
    cells, each, sides = faces.shape
    joined = joined_faces(np.arange(cells * each + 1) * sides, faces.ravel(), np.arange(cells + 1) * each)
    return PolyhedralMesh.unchecked(points, **joined._asdict(), box=box)
