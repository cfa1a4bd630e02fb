"""Squares with zigzag edges: cells of up to twelve vertices, none of them convex, that lock into each other."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.box import UNIT_BOX, Box, Corners, Count, cell_counts, check_box, check_fraction
from vemcvx.meshes.families.squares import padded_mesh, square_grid
from vemcvx.meshes.polygon_mesh import PolygonMesh


def nonconvex(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None, zigzag: float = 0.15
) -> PolygonMesh:
    """Mesh a box with non-convex cells (where there is more than one).

    Parameters
    ----------
    n, box, seed, size : as of `squares`
    zigzag : float
        In [0, 1/3): how far the thirds of every inner edge swerve to either side, in parts of a cell. Below 1/3 the
        edges of a corner stay apart.

    Returns
    -------
    PolygonMesh
        Cells row by row; first the corner nodes in the order of `squares`, then the nodes of the zigzags.

    Raises
    ------
    MeshError
        As `squares`, or ``zigzag`` is not in [0, 1/3).
    """
    rectangle = check_box(box)
    zigzag = check_fraction("zigzag", zigzag, 1.0 / 3.0)
    nx, ny = cell_counts(n, rectangle, size)
    points, corners = square_grid(nx, ny, rectangle)
    along = _thirds(points, nx, ny, zigzag, rectangle)
    level, upright = (ny + 1) * nx, ny * (nx + 1)  # numbers of level and of upright edges, also those on the sides
    inner = np.repeat(_inner(nx, ny), 2)
    first = len(points) + 2 * np.arange(level + upright)
    edges = first[:, None] + np.array([0, 1])
    level_edges, upright_edges = edges[:level].reshape(ny + 1, nx, 2), edges[level:].reshape(ny, nx + 1, 2)
    around = [
        corners[:, :1],
        level_edges[:-1].reshape(-1, 2),
        corners[:, 1:2],
        upright_edges[:, 1:].reshape(-1, 2),
        corners[:, 2:3],
        level_edges[1:, :, ::-1].reshape(-1, 2),
        corners[:, 3:],
        upright_edges[:, :-1, ::-1].reshape(-1, 2),
    ]
    present = np.concatenate([np.ones(len(points), dtype=bool), inner])
    return padded_mesh(np.concatenate([points, along]), present, np.concatenate(around, axis=1), rectangle)


def _thirds(points: Floats, nx: int, ny: int, zigzag: float, box: Box) -> Floats:
    """Two nodes an edge, level edges first: off to the left at a third, off to the right at two thirds."""
    grid = points.reshape(ny + 1, nx + 1, 2)
    pitch = np.array([box.width / nx, box.height / ny])
    level = grid[:, :-1, None] + np.array([[1 / 3, zigzag], [2 / 3, -zigzag]]) * pitch
    upright = grid[:-1, :, None] + np.array([[-zigzag, 1 / 3], [zigzag, 2 / 3]]) * pitch
    return np.concatenate([level.reshape(-1, 2), upright.reshape(-1, 2)])


def _inner(nx: int, ny: int) -> Ints:
    """Which edges (level ones first) are inside the box; the others stay straight."""
    level, upright = np.ones((ny + 1, nx), dtype=bool), np.ones((ny, nx + 1), dtype=bool)
    level[[0, -1]] = upright[:, [0, -1]] = False
    return np.concatenate([level.ravel(), upright.ravel()])
