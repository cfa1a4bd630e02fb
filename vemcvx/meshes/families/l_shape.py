"""Squares in an L: a box without its upper right quarter, the usual body with a re-entrant corner."""

from __future__ import annotations

import numpy as np

from vemcvx.errors import MeshError
from vemcvx.meshes.box import UNIT_BOX, Corners, Count, cell_counts, check_box, listed
from vemcvx.meshes.families.squares import padded_mesh, square_grid
from vemcvx.meshes.polygon_mesh import PolygonMesh


def l_shape(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None
) -> PolygonMesh:
    """Mesh an L with equal squares (rectangles, if the box asks for them).

    Parameters
    ----------
    n : int or (int, int)
        As of `squares`, but rounded to even numbers, so that a corner falls in the middle; or the even numbers of cells
        along the bottom and left sides: (nx, ny).
    box : ((x0, x1), (y0, y1))
        The rectangle around the L; its quarter beyond the middles of x and y is left out.
    seed, size : as of `squares`

    Returns
    -------
    PolygonMesh
        Nodes and cells row by row. Boundaries "left", "bottom", "right" (lower half) and "top" (left half) as on a box,
        "inner_right" and "inner_top", which meet in the re-entrant corner and face right and up, and "boundary".

    Raises
    ------
    MeshError
        As `squares`, or a pair (nx, ny) is not even.
    """
    rectangle = check_box(box)
    nx, ny = cell_counts(n, rectangle, size)
    if not listed(n):
        nx, ny = 2 * max(1, round(nx / 2)), 2 * max(1, round(ny / 2))
    elif nx % 2 or ny % 2:
        raise MeshError(f"n must be even numbers of cells, so that a corner falls in the middle; got ({nx}, {ny}).")
    points, corners = square_grid(nx, ny, rectangle)
    column, row = np.tile(np.arange(nx), ny), np.repeat(np.arange(ny), nx)
    corners = corners[(column < nx // 2) | (row < ny // 2)]
    present = np.zeros(len(points), dtype=bool)
    present[corners] = True
    x, y = points[(ny // 2) * (nx + 1) + nx // 2]
    mesh = padded_mesh(points, present, corners, rectangle)
    return mesh.with_boundary("inner_right", lambda m: m[:, 0] == x).with_boundary("inner_top", lambda m: m[:, 1] == y)
