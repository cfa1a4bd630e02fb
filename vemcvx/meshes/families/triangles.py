"""Squares cut in two by the diagonal from the lower left; halving n nests the meshes."""

from __future__ import annotations

import numpy as np

from vemcvx.meshes.box import UNIT_BOX, Corners, Count, cell_counts, check_box
from vemcvx.meshes.families.squares import square_grid
from vemcvx.meshes.polygon_mesh import PolygonMesh


def triangles(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None
) -> PolygonMesh:
    """Mesh a box with right-angled triangles, two to each square of `squares`.

    Parameters
    ----------
    n, box, seed, size : as of `squares`

    Returns
    -------
    PolygonMesh
        Nodes row by row, the lower then the upper triangle of each square.
    """
    rectangle = check_box(box)
    points, corners = square_grid(*cell_counts(n, rectangle, size, each=2), rectangle)
    vertices = corners[:, [0, 1, 2, 0, 2, 3]].ravel()
    return PolygonMesh.unchecked(points, np.arange(0, vertices.size + 1, 3), vertices, rectangle)
