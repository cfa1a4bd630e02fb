"""Squares of which some are cut in four: their neighbours get a vertex in the middle of a straight edge."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Ints
from vemcvx.meshes.box import UNIT_BOX, Corners, Count, cell_counts, check_box, check_fraction, check_whole
from vemcvx.meshes.families.squares import padded_mesh, square_grid
from vemcvx.meshes.polygon_mesh import PolygonMesh

# Places of a 3 x 3 block of nodes, numbered from the lower left row by row: once around it, and its four quarters.
AROUND = np.array([0, 1, 2, 5, 8, 7, 6, 3])
QUARTERS = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])


def hanging(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None, fraction: float = 0.3
) -> PolygonMesh:
    """Mesh a box with squares of two sizes and hanging nodes between them.

    Parameters
    ----------
    n, box, seed, size : as of `squares`
        With n for the large cells; which of them are cut is random.
    fraction : float
        In [0, 1]: the part of the large cells that is cut in four.

    Returns
    -------
    PolygonMesh
        Nodes row by row; large cells row by row, each cut one followed by its four quarters in its place.

    Raises
    ------
    MeshError
        As `squares`, or ``fraction`` is not in [0, 1].
    """
    rectangle = check_box(box)
    fraction = check_fraction("fraction", fraction, 1.0, closed=True)
    nx, ny = cell_counts(n, rectangle, size, each=4)
    random = np.random.default_rng(check_whole("seed", seed, 0))
    cut = np.zeros(nx * ny, dtype=bool)
    cut[random.permutation(nx * ny)[: round(fraction * nx * ny)]] = True
    points, _ = square_grid(2 * nx, 2 * ny, rectangle)
    blocks = _blocks(nx, ny)
    whole = np.flatnonzero(~cut)
    rows = np.full((4 * nx * ny, 8), -1)
    rows[4 * whole] = blocks[whole][:, AROUND]
    rows.reshape(-1, 4, 8)[cut, :, :4] = blocks[cut][:, QUARTERS]
    rows = rows[rows[:, 0] >= 0]
    return padded_mesh(points, _present(cut, blocks, len(points)), rows, rectangle)


def _blocks(nx: int, ny: int) -> Ints:
    """Nodes (nx ny, 9) of the fine grid that belong to each large cell."""
    line = 2 * nx + 1
    first = (2 * np.arange(ny)[:, None] * line + 2 * np.arange(nx)).ravel()
    return first[:, None] + (np.arange(3)[:, None] * line + np.arange(3)).ravel()


def _present(cut: Bools, blocks: Ints, n_points: int) -> Bools:
    """Which nodes of the fine grid exist: corners of large cells, and all of a cell that is cut."""
    present = np.zeros(n_points, dtype=bool)
    present[blocks[:, [0, 2, 6, 8]]] = True
    present[blocks[cut]] = True
    return present
