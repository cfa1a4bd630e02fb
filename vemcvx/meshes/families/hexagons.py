"""Hexagons in staggered rows, cut off straight at the box.

Rows of cells are parted by zigzag lines of nodes half a cell apart. Regular hexagons of width a have rows
a sqrt(3)/2 apart and zigzags of height 1/3 of that; the counts are rounded so that rows and columns fill the box,
which stretches them a little.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.box import UNIT_BOX, Box, Corners, Count, cell_counts, check_box, ticks
from vemcvx.meshes.families.squares import padded_mesh
from vemcvx.meshes.polygon_mesh import PolygonMesh

# Width of a regular hexagon of area 1, so that hexagons are as many as squares: a^2 sqrt(3)/2 = 1.
WIDTH = float(np.sqrt(2.0 / np.sqrt(3.0)))


def hexagons(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None
) -> PolygonMesh:
    """Mesh a box with hexagons, regular up to a stretch that makes them fit; cut in half or to pentagons at the sides.

    Parameters
    ----------
    n, box, seed, size : as of `squares`
        As many cells as squares, nearly; every other of the rows has a half cell at either end in place of one whole.

    Returns
    -------
    PolygonMesh
        Nodes and cells row by row.
    """
    rectangle = check_box(box)
    columns, rows = cell_counts(n, rectangle, size, stretch=WIDTH)
    lines, half_cells = np.arange(rows + 1)[:, None], np.arange(2 * columns + 1)
    # Row k has its upright edges where k + i is even; there the line below it is high and the line above it low.
    high = (lines + half_cells) % 2 == 0
    flat = (lines == 0) | (lines == rows)
    present = np.where(lines == 0, high, np.where(lines == rows, ~high, True))
    present = present | (flat & ((half_cells == 0) | (half_cells == 2 * columns)))
    points = _zigzag_points(columns, rows, np.where(flat, 0.0, np.where(high, 1.0, -1.0)), rectangle)
    cells = np.concatenate([_row_of_cells(columns, row) for row in range(rows)])
    return padded_mesh(points, present.ravel(), cells, rectangle)


def _zigzag_points(columns: int, rows: int, zigzag: Floats, box: Box) -> Floats:
    x = np.tile(ticks(box.left, box.right, 2 * columns), rows + 1)
    y = np.repeat(ticks(box.bottom, box.top, rows), 2 * columns + 1)
    return np.column_stack([x, y + zigzag.ravel() * (box.height / rows / 6.0)])


def _row_of_cells(columns: int, row: int) -> Ints:
    """Candidates for the vertices of a row of cells: three on the line below, three on the line above."""
    last = 2 * columns
    middles = np.arange(1, last, 2) if row % 2 == 0 else np.arange(0, last + 1, 2)
    across = middles[:, None] + np.array([-1, 0, 1])
    across[(across < 0) | (across > last)] = -1
    outside = across < 0
    below = np.where(outside, -1, across + row * (last + 1))
    above = np.where(outside, -1, across + (row + 1) * (last + 1))
    return np.concatenate([below, above[:, ::-1]], axis=1)
