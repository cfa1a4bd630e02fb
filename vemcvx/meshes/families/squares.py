"""Equal rectangles (squares where the box allows), numbered row by row; meshes of such numberings with holes."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.box import UNIT_BOX, Box, Corners, Count, cell_counts, check_box, ticks
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons.topology import offsets_of


def squares(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None
) -> PolygonMesh:
    """Mesh a box with equal squares; other families take what this one takes, and name the sides as it does.

    Parameters
    ----------
    n : int or (int, int)
        Cells across the shortest side of the box, and along the other as many as make them most nearly squares; or the
        numbers of cells along x and y.
    box : ((x0, x1), (y0, y1))
        The rectangle to mesh.
    seed : int
        Start of the random numbers: the same seed gives the same mesh. Nothing is random here.
    size : float
        The width of a cell, instead of n; cells are as near to it as whole numbers of them come.

    Returns
    -------
    PolygonMesh
        Nodes and cells row by row, boundaries "left", "right", "bottom", "top" and "boundary"; in the unit square
        h = sqrt(2) / n.

    Raises
    ------
    MeshError
        n is not a positive whole number, size is not a positive length, both or neither are given, or box is not a
        rectangle.
    """
    rectangle = check_box(box)
    points, corners = square_grid(*cell_counts(n, rectangle, size), rectangle)
    return PolygonMesh.unchecked(points, np.arange(0, corners.size + 1, 4), corners.ravel(), rectangle)


def square_grid(nx: int, ny: int, box: Box) -> tuple[Floats, Ints]:
    """Return nodes ((nx + 1)(ny + 1), 2) row by row, and the corners (nx ny, 4) of the cells, counter-clockwise."""
    x, y = ticks(box.left, box.right, nx), ticks(box.bottom, box.top, ny)
    points = np.column_stack([np.tile(x, ny + 1), np.repeat(y, nx + 1)])
    first = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)).ravel()
    return points, first[:, None] + np.array([0, 1, nx + 2, nx + 1])


def padded_mesh(points: Floats, present: Bools, rows: Ints, box: Box) -> PolygonMesh:
    """Return the mesh of the nodes ``present`` whose cells are ``rows`` less the absent nodes and the entries -1.

    Of n candidates for nodes, the rows (n_cells, k) list those of each cell, counter-clockwise.
    """
    number = np.where(present, np.cumsum(present) - 1, -1)
    vertices = np.where(rows >= 0, number[rows], -1)
    offsets = offsets_of((vertices >= 0).sum(axis=1))
    return PolygonMesh.unchecked(points[present], offsets, vertices[vertices >= 0], box)
