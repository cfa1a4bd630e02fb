"""Squares whose inner nodes are moved at random: quadrilaterals of every shape, some of them not convex."""

from __future__ import annotations

import numpy as np

from vemcvx.meshes.box import UNIT_BOX, Corners, Count, cell_counts, check_box, check_fraction, check_whole
from vemcvx.meshes.families.squares import square_grid
from vemcvx.meshes.polygon_mesh import PolygonMesh


def distorted(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None, amount: float = 0.5
) -> PolygonMesh:
    """Mesh a box with distorted squares.

    Parameters
    ----------
    n, box, seed, size : as of `squares`
    amount : float
        In [0, 1): inner nodes move by up to this part of half a cell along each axis. Nodes then stay in disjoint
        boxes about their places, so opposite edges of a cell never meet and every cell is valid.

    Returns
    -------
    PolygonMesh
        Nodes and cells in the order of `squares`.

    Raises
    ------
    MeshError
        As `squares`, or ``amount`` is not in [0, 1).
    """
    rectangle = check_box(box)
    amount = check_fraction("amount", amount, 1.0)
    nx, ny = cell_counts(n, rectangle, size)
    points, corners = square_grid(nx, ny, rectangle)
    random = np.random.default_rng(check_whole("seed", seed, 0))
    inner = points.reshape(ny + 1, nx + 1, 2)[1:-1, 1:-1]
    inner += random.uniform(-0.5 * amount, 0.5 * amount, inner.shape) * [rectangle.width / nx, rectangle.height / ny]
    return PolygonMesh.unchecked(points, np.arange(0, corners.size + 1, 4), corners.ravel(), rectangle)
