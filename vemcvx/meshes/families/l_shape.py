"""Squares in an L: a box without its upper right quarter, the usual body with a re-entrant corner."""

from __future__ import annotations

import numpy as np

from vemcvx.errors import MeshError
from vemcvx.meshes.box import UNIT_BOX, Box, Corners, Count, cell_counts, check_box
from vemcvx.meshes.families.padded import padded_mesh
from vemcvx.meshes.families.squares import square_grid
from vemcvx.meshes.polygon_mesh import PolygonMesh


def l_shape(n: Count, box: Corners = UNIT_BOX, seed: int = 0) -> PolygonMesh:
    """Mesh an L with equal squares (rectangles, if the box asks for them).

    Parameters
    ----------
    n : int or (int, int)
        Cells a unit length along each side (at least one in each half), or the even numbers of cells along the left
        and bottom sides: (nx, ny).
    box : ((x0, x1), (y0, y1))
        The rectangle around the L; its quarter beyond the middles of x and y is left out.
    seed : int
        Nothing is random here.

    Returns
    -------
    PolygonMesh
        Nodes and cells row by row. Boundaries "left", "bottom", "right" (lower half) and "top" (left half) as on a box,
        "inner_right" and "inner_top", which meet in the re-entrant corner and face right and up, and "boundary".

    Raises
    ------
    MeshError
        n is not a positive whole number or a pair of even ones, or box is not a rectangle.
    """
    rectangle = check_box(box)
    x, y = 0.5 * (rectangle.left + rectangle.right), 0.5 * (rectangle.bottom + rectangle.top)
    if isinstance(n, (tuple, list, np.ndarray)):
        nx, ny = cell_counts(n, rectangle)
        if nx % 2 or ny % 2:
            raise MeshError(f"n must be even numbers of cells, so that a corner falls in the middle; got ({nx}, {ny}).")
    else:
        nx, ny = (2 * half for half in cell_counts(n, Box(rectangle.left, x, rectangle.bottom, y)))
    points, corners = square_grid(nx, ny, rectangle)
    column, row = np.tile(np.arange(nx), ny), np.repeat(np.arange(ny), nx)
    corners = corners[(column < nx // 2) | (row < ny // 2)]
    present = np.zeros(len(points), dtype=bool)
    present[corners] = True
    x, y = points[(ny // 2) * (nx + 1) + nx // 2]
    mesh = padded_mesh(points, present, corners, rectangle)
    return mesh.with_boundary("inner_right", lambda m: m[:, 0] == x).with_boundary("inner_top", lambda m: m[:, 1] == y)
