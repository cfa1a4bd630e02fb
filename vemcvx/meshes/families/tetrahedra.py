"""Cubes cut in six tetrahedra about the diagonal from the lowest to the highest corner, which fit face to face.

One tetrahedron an order of the axes: from the lowest corner along the first axis, then the second, then the third
(H. W. Kuhn, IBM J. Res. Dev. 4 (1960), 518-524). All have the shape of one of them or of its mirror image, and halving
n nests the meshes.
"""

from __future__ import annotations

import numpy as np

from vemcvx.meshes.box import UNIT_CUBE, SpaceCorners, SpaceCount, check_space_box, space_counts
from vemcvx.meshes.families.cubes import cube_grid, mesh_of_equal_cells
from vemcvx.meshes.polyhedra.standard import FACES
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

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
    whole = check_space_box(box)
    points, corners = cube_grid(space_counts(n, whole, size, each=6), whole)
    cells = corners[:, SIX].reshape(-1, 4)
    return mesh_of_equal_cells(points, cells[:, np.array(FACES["tetra"])], whole)
