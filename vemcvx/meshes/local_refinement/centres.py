"""The inner point that the middles of a cell's sides are joined to.

    four long sides    the crossing of the lines through opposite middles, (x_1 + x_2 + x_3 + x_4) / 4: the quarters
                       of quarters ... tend to parallelograms, so no shape degenerates
    an arrow           (four sides, right turn at x_1) the middle of its inner diagonal, (x_1 + x_3) / 2: two children
                       are arrows of the same shape, two are parallelograms
    convex             the centroid, from which every side is at least a third of the width away
    else               the centroid of the kernel (the points that see the whole cell), an intersection of half-planes,
                       which comes from clipping a square by one side after the other

A cell whose kernel is empty, or so small that it would be seen under flat angles, has no such point.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.local_refinement.sides import Splitting
from vemcvx.meshes.polygons.clipping import left_of
from vemcvx.meshes.polygons.segments import cross
from vemcvx.meshes.polygons.shapes import polygon_centroids
from vemcvx.meshes.polygons.topology import offsets_of
from vemcvx.meshes.tessellation import Tessellation

# In diameters: what the centre must be away from the line of every side. A side of a quarter of the diameter
# is then seen under an angle of six degrees at least.
CLEAR = 0.03


def centres_of(mesh: Tessellation, splitting: Splitting) -> tuple[Floats, Bools]:
    """Centres of all cells (n_cells, 2), and which cells have one, (n_cells,)."""
    centres, seen = mesh.centroids.copy(), np.ones(mesh.n_cells, dtype=bool)
    bends = np.flatnonzero(splitting.bend)
    counts = np.add.reduceat(splitting.bend.astype(np.int64), mesh.offsets[:-1])
    offsets = offsets_of(counts)

    def corners(cells: Ints, count: int) -> Floats:
        nodes: Ints = mesh.vertices[bends[offsets[cells, None] + np.arange(count)]]
        return mesh.points[nodes]

    all_long = np.logical_and.reduceat(splitting.long, splitting.offsets[:-1]) & (np.diff(splitting.offsets) == 4)
    quads = np.flatnonzero((counts == 4) & (all_long | ~splitting.convex))
    centres[quads] = _middles_of_quads(corners(quads, 4))
    others = np.flatnonzero(~splitting.convex & (counts != 4))
    for count in np.unique(counts[others]):
        cells = others[counts[others] == count]
        scale = mesh.diameters[cells, None]
        about = (corners(cells, count) - mesh.centroids[cells, None]) / scale[:, None]
        inside, clear = kernel_centroids(about)
        centres[cells] += inside * scale
        seen[cells] = clear >= CLEAR
    return centres, seen


def _middles_of_quads(x: Floats) -> Floats:
    """Crossings of the middle lines of convex quadrilaterals (c, 4, 2), middles of the inner diagonals of arrows."""
    # The sums of opposite corners do not depend on where the list begins, to the bit.
    even, odd = x[:, 0] + x[:, 2], x[:, 1] + x[:, 3]
    before, after = x - np.roll(x, 1, axis=1), np.roll(x, -1, axis=1) - x
    turn = cross(before, after)
    tip = np.argmin(turn, axis=1)
    arrow = turn.min(axis=1) < 0.0
    diagonal = np.where((tip % 2 == 0)[:, None], even, odd)
    return np.where(arrow[:, None], 0.5 * diagonal, 0.25 * (even + odd))


def kernel_centroids(corners: Floats) -> tuple[Floats, Floats]:
    """Centroids (c, 2) of the kernels of polygons, and how far they are from the lines of the sides, (c,).

    The corners (c, n, 2) are counter-clockwise, all within 1 of the origin, which stands for an empty kernel. Distances
    are the least signed ones, negative outside.
    """
    edge = np.roll(corners, -1, axis=1) - corners
    inward = np.stack([-edge[..., 1], edge[..., 0]], axis=-1) / np.hypot(edge[..., 0], edge[..., 1])[..., None]
    empty = np.zeros(len(corners), dtype=bool)
    kernel = np.broadcast_to(np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]), (len(corners), 4, 2))
    for start, along in zip(corners.transpose(1, 0, 2), edge.transpose(1, 0, 2), strict=True):
        kernel, left = left_of(kernel, start, along)
        empty |= ~left
    areas, centroids = polygon_centroids(kernel)
    points = np.where(((areas > 0.0) & ~empty)[:, None], centroids, 0.0)
    return points, np.einsum("cia,cia->ci", points[:, None] - corners, inward).min(axis=1)
