"""Plane meshes of boxes, L-shaped domains, rings and discs."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import ROUNDING, Bools, Floats, Ints, brief, plain
from vemcvx.base.errors import MeshError
from vemcvx.meshes.box import (
    LARGEST,
    SHORTEST,
    UNIT_BOX,
    Box,
    Corners,
    Count,
    cell_counts,
    check_box,
    check_total,
    check_whole,
)
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import offsets_of


def squares(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None
) -> PolygonMesh:
    """Return a mesh of equal squares in a box.

    Parameters
    ----------
    n : int or (int, int)
        Number of cells along the shortest side of the box, or numbers of cells along x and y.
    box : ((x0, x1), (y0, y1))
        The rectangle to mesh.
    seed : int
        Seed of random numbers, for families with random cells.
    size : float
        Approximate width of a cell, instead of n.

    Returns
    -------
    PolygonMesh
        Nodes and cells are numbered row by row. The boundaries are "left", "right", "bottom", "top" and "boundary".

    Raises
    ------
    MeshError
        An argument is invalid, n and size are both given or both missing, or there are too many cells.

    Examples
    --------
    >>> vx.meshes.squares(4, box=((0, 2), (0, 1)))
    PolygonMesh(32 cells, 45 nodes, h = 0.3536, boundaries: left, right, bottom, top, boundary)
    """
    rectangle = check_box(box)
    nx, ny = cell_counts(n, rectangle, size)
    points, corners = square_grid(nx, ny, rectangle)
    return PolygonMesh.unchecked(points, np.arange(0, corners.size + 1, 4), corners.ravel(), box=rectangle)


def square_grid(nx: int, ny: int, box: Box) -> tuple[Floats, Ints]:
    """Return the nodes row by row, and the corners (nx ny, 4) of cells."""
    x, y = box.ticks(nx, ny)
    points = np.column_stack([np.tile(x, ny + 1), np.repeat(y, nx + 1)])
    first = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)).ravel()
    return points, first[:, None] + np.array([0, 1, nx + 2, nx + 1])


def mesh_from_rows(points: Floats, present: Bools, rows: Ints, box: Box) -> PolygonMesh:
    """Return the mesh with the cells `rows` and the marked points."""
    number = np.where(present, np.cumsum(present) - 1, -1)
    vertices = np.where(rows >= 0, number[rows], -1)
    offsets = offsets_of((vertices >= 0).sum(axis=1))
    return PolygonMesh.unchecked(points[present], offsets, vertices[vertices >= 0], box=box)


def triangles(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None
) -> PolygonMesh:
    """Return a mesh of right-angled triangles in a box, two per square.

    The meshes for n and 2 n are nested.

    Parameters
    ----------
    n, box, seed, size : as in `squares`

    Returns
    -------
    PolygonMesh

    Examples
    --------
    >>> vx.meshes.triangles(4).n_cells
    32
    """
    rectangle = check_box(box)
    nx, ny = cell_counts(n, rectangle, size, each=2)
    points, corners = square_grid(nx, ny, rectangle)
    vertices = corners[:, [0, 1, 2, 0, 2, 3]].ravel()
    return PolygonMesh.unchecked(points, np.arange(0, vertices.size + 1, 3), vertices, box=rectangle)


HEXAGON_WIDTH = float(np.sqrt(2.0 / np.sqrt(3.0)))
"""Width w of a regular hexagon with the area w^2 sqrt(3) / 2 = 1."""


def hexagons(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None
) -> PolygonMesh:
    """Return a mesh of stretched hexagons in a box, with half hexagons and pentagons at the sides.

    Parameters
    ----------
    n, box, seed, size : as in `squares`

    Returns
    -------
    PolygonMesh

    Examples
    --------
    >>> vx.meshes.hexagons(4).n_cells
    18
    """
    rectangle = check_box(box)
    columns, rows = cell_counts(n, rectangle, size, stretch=HEXAGON_WIDTH)
    x, y = rectangle.ticks(2 * columns, rows)
    line, half = np.indices((rows + 1, 2 * columns + 1))
    # Zigzag lines separate rows of cells. An upright edge joins a peak to the zigzag line above.
    high = (line + half) % 2 == 0
    flat = (line == 0) | (line == rows)
    ends = flat & ((half == 0) | (half == 2 * columns))
    present = np.where(line == 0, high, np.where(line == rows, ~high, True)) | ends
    zigzag = np.where(flat, 0.0, np.where(high, 1.0, -1.0)) * (rectangle.lengths[1] / rows / 6.0)
    points = np.column_stack([x[half.ravel()], y[line.ravel()] + zigzag.ravel()])
    # A cell has up to three vertices on each of two zigzag lines.
    row, middle = np.nonzero(~high[:-1])
    across = middle[:, None] + np.array([-1, 0, 1])
    below, above = (across + (2 * columns + 1) * (row + k)[:, None] for k in (0, 1))
    cells = np.hstack([below, above[:, ::-1]])
    outside = (across < 0) | (across > 2 * columns)
    return mesh_from_rows(
        points, present.ravel(), np.where(np.hstack([outside, outside[:, ::-1]]), -1, cells), rectangle
    )


def distorted(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None
) -> PolygonMesh:
    """Return a mesh of distorted squares in a box.

    Inner nodes move at random, along each axis by up to a quarter of a cell.

    Parameters
    ----------
    n, box, seed, size : as in `squares`

    Returns
    -------
    PolygonMesh

    Examples
    --------
    >>> vx.meshes.distorted(4).n_cells
    16
    """
    rectangle = check_box(box)
    nx, ny = cell_counts(n, rectangle, size)
    points, corners = square_grid(nx, ny, rectangle)
    random = np.random.default_rng(check_whole("seed", seed, 0))
    inner = points.reshape(ny + 1, nx + 1, 2)[1:-1, 1:-1]
    inner += random.uniform(-0.25, 0.25, inner.shape) * np.divide(rectangle.lengths, (nx, ny))
    return PolygonMesh.unchecked(points, np.arange(0, corners.size + 1, 4), corners.ravel(), box=rectangle)


def hanging(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None
) -> PolygonMesh:
    """Return a mesh of large and small squares in a box, with hanging nodes.

    Parameters
    ----------
    n, box, seed, size : as in `squares`
        n refers to large cells. 30 % of the large cells, chosen at random, are split into four.

    Returns
    -------
    PolygonMesh
        Large cells are numbered row by row. Four quarters replace a split cell.

    Examples
    --------
    >>> vx.meshes.hanging(4).n_cells
    31
    """
    nx, ny = cell_counts(n, check_box(box), size, each=4)
    mesh = squares((nx, ny), box)
    random = np.random.default_rng(check_whole("seed", seed, 0))
    return mesh.refine(random.permutation(mesh.n_cells)[: round(0.3 * mesh.n_cells)])


ZIGZAG = 0.15
"""Distance of new nodes from old edges in `nonconvex`, in cell widths. The value must be below 1/3."""


def nonconvex(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None
) -> PolygonMesh:
    """Return a mesh of interlocking nonconvex cells (up to twelve vertices) in a box.

    Parameters
    ----------
    n, box, seed, size : as in `squares`

    Returns
    -------
    PolygonMesh

    Examples
    --------
    >>> max(map(len, vx.meshes.nonconvex(4).cells))
    12
    """
    rectangle = check_box(box)
    nx, ny = cell_counts(n, rectangle, size)
    points, corners = square_grid(nx, ny, rectangle)
    # Every edge becomes a zigzag with two new nodes. Horizontal edges come first.
    grid, pitch = points.reshape(ny + 1, nx + 1, 2), np.divide(rectangle.lengths, (nx, ny))
    level = grid[:, :-1, None] + np.array([[1 / 3, ZIGZAG], [2 / 3, -ZIGZAG]]) * pitch
    upright = grid[:-1, :, None] + np.array([[-ZIGZAG, 1 / 3], [ZIGZAG, 2 / 3]]) * pitch
    number = len(points) + np.arange((level.size + upright.size) // 2)
    levels, uprights = number[: level.size // 2].reshape(level.shape[:3]), number[level.size // 2 :]
    uprights = uprights.reshape(upright.shape[:3])
    around = [
        corners[:, :1],
        levels[:-1].reshape(-1, 2),
        corners[:, 1:2],
        uprights[:, 1:].reshape(-1, 2),
        corners[:, 2:3],
        levels[1:, :, ::-1].reshape(-1, 2),
        corners[:, 3:],
        uprights[:, :-1, ::-1].reshape(-1, 2),
    ]
    present = np.ones(len(points) + len(number), dtype=bool)
    for straight in (levels[[0, -1]], uprights[:, [0, -1]]):  # edges on the sides of the box stay straight
        present[straight] = False
    nodes = np.concatenate([points, level.reshape(-1, 2), upright.reshape(-1, 2)])
    return mesh_from_rows(nodes, present, np.concatenate(around, axis=1), rectangle)


def l_shape(
    n: Count | None = None, box: Corners = UNIT_BOX, seed: int = 0, *, size: float | None = None
) -> PolygonMesh:
    """Return a mesh of equal squares or rectangles in an L.

    Parameters
    ----------
    n : int or (int, int)
        As in `squares`. Odd numbers are rounded up, so that the re-entrant corner is a node.
    box : ((x0, x1), (y0, y1))
        The rectangle around the L. The upper right quarter is empty.
    seed, size : as in `squares`

    Returns
    -------
    PolygonMesh
        Boundaries "left", "bottom", "right" (lower half), "top" (left half), "inner_right" and "inner_top".

    Examples
    --------
    >>> vx.meshes.l_shape(4).n_cells
    12
    """
    rectangle = check_box(box)
    nx, ny = (count + count % 2 for count in cell_counts(n, rectangle, size))
    points, corners = square_grid(nx, ny, rectangle)
    column, row = np.tile(np.arange(nx), ny), np.repeat(np.arange(ny), nx)
    corners = corners[(column < nx // 2) | (row < ny // 2)]
    present = np.zeros(len(points), dtype=bool)
    present[corners] = True
    x, y = points[(ny // 2) * (nx + 1) + nx // 2]
    mesh = mesh_from_rows(points, present, corners, rectangle)
    return mesh.with_boundary("inner_right", lambda m: m[:, 0] == x).with_boundary("inner_top", lambda m: m[:, 1] == y)


def ring(radii: ArrayLike, sectors: int, *, angles: tuple[float, float] = (0.0, math.tau)) -> PolygonMesh:
    """Return a mesh of quadrilaterals between circles and rays, in a ring, a disc or a sector.

    Parameters
    ----------
    radii : (k,) array
        Increasing radii of k >= 2 circles. If radii[0] is 0, the domain is a disc, with triangles at the centre.
    sectors : int
        Number of cells around the full circle or the sector. A cell must have an angle below pi.
    angles : (float, float), optional
        Angles of the first and last ray, counter-clockwise from x, in radians; by default a full circle.

    Returns
    -------
    PolygonMesh
        Boundaries "outer", "inner" (not for a disc), and "first" and "last" (the rays of a sector).

    Examples
    --------
    >>> vx.meshes.ring(np.linspace(1.0, 2.0, 5), 48).extruded(np.linspace(0.0, 3.0, 7)).n_cells
    1152
    """
    r = _increasing(radii, f"radii must be at least two increasing numbers from 0 to {LARGEST:g}", 0.0, LARGEST)
    words = "angles must be two increasing numbers in radians, at most 2 pi apart"
    start, *_, end = _increasing(angles, words, -LARGEST, LARGEST).tolist()
    if len(angles) > 2 or end - start > math.tau * (1 + ROUNDING):
        raise MeshError(f"ring: {words}; got {brief(angles)}.")
    check_whole("sectors", sectors, int((end - start) / np.pi) + 1)
    check_total(sectors * (len(r) - 1))
    turns, disc = end - start > math.tau * (1 - ROUNDING), r[0] == 0.0
    rays = sectors if turns else sectors + 1
    angle = start + (end - start) * np.arange(rays) / sectors
    unit = np.column_stack([np.cos(angle), np.sin(angle)]).round(15)  # exact zeros for rays along an axis
    centre = np.zeros(int(disc), dtype=np.int64)
    points = np.concatenate([np.zeros((len(centre), 2)), (r[len(centre) :, None, None] * unit).reshape(-1, 2)])
    around = np.column_stack([np.arange(sectors), np.arange(1, sectors + 1) % rays])
    circles = len(centre) + np.arange(len(r) - len(centre)) * rays
    inner, outer = circles[:-1, None, None] + around, circles[1:, None, None] + around
    quads = np.concatenate([inner[..., :1], outer, inner[..., 1:]], axis=2).reshape(-1, 4)
    middle = np.insert(circles[0] + around, 0, 0, axis=1) if disc else quads[:0]
    parts = {"outer": circles[-1] + around} | ({} if disc else {"inner": circles[0] + around})
    if not turns:
        for name, ray in (("first", circles), ("last", circles + sectors)):
            along = np.append(centre, ray)
            parts[name] = np.column_stack([along[:-1], along[1:]])
    return PolygonMesh(points, [*middle, *quads], boundaries=parts)


def _increasing(given: ArrayLike, what: str, least: float, most: float) -> Floats:
    numbers = plain(given)
    if numbers is not None and numbers.ndim == 1 and len(numbers) > 1 and numbers.dtype.kind in "iuf":
        x = numbers.astype(float)
        if np.isfinite(x).all() and least <= x[0] and x[-1] <= most and np.diff(x).min() >= SHORTEST:
            return x
    raise MeshError(f"ring: {what}; got {brief(given)}.")
