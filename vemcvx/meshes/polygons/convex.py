"""Kernels of polygons, and simple polygons cut into convex pieces."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.meshes.polygons.geometry import clip_ears


def kernel_centroids(corners: Floats) -> tuple[Floats, Floats]:
    """Points (c, 2) that see all of a polygon each, and how far they are from the lines of the sides, (c,).

    The corners (c, n, 2) are counter-clockwise, all within 1 of the origin. The point is the origin if it is .1 away
    from all lines, else the centroid of the kernel, the part of the polygon that is left of every side; the origin
    again where there is none. Distances are the least signed ones, negative outside.
    """
    import shapely

    edge = np.roll(corners, -1, axis=1) - corners
    forth = edge / np.hypot(edge[..., 0], edge[..., 1])[..., None]
    left = np.stack([-forth[..., 1], forth[..., 0]], axis=-1)
    points = np.zeros((len(corners), 2))
    sought = np.flatnonzero(np.einsum("cia,cia->ci", -corners, left).min(axis=1) < 0.1)
    kernel = shapely.polygons(corners[sought])
    for side in range(corners.shape[1]):
        start, u, v = (a[sought, side, None] for a in (corners, forth, left))
        # All of the polygon that is left of the side is within 2 of the corner where it starts.
        half = start + 2.0 * np.concatenate([-u, u, u + v, v - u], axis=1)
        kernel = shapely.intersection(kernel, shapely.polygons(half))
    seeing = shapely.area(kernel) > 0.0
    points[sought[seeing]] = shapely.get_coordinates(shapely.centroid(kernel[seeing]))
    return points, np.einsum("cia,cia->ci", points[:, None] - corners, left).min(axis=1)


def convex_pieces(corners: Floats) -> list[list[int]]:
    """The convex pieces of a polygon (n, 2), each by the numbers of its corners; all counter-clockwise.

    Ears are clipped, then every diagonal is taken out again whose absence leaves no right turn: at most four times as
    many pieces as the best (S. Hertel, K. Mehlhorn, FCT 1983, LNCS 158, 207-218). Ears may be flat (three corners in a
    line, as at the tips of a comb); the diagonal under the flattest comes first, which joins it to what lies below.
    """
    x = [complex(*corner) for corner in corners.tolist()]
    ears = clip_ears(corners[None])[0].tolist()
    pieces = dict(enumerate(ears))
    owner = {edge: k for k, ear in pieces.items() for edge in _edges(ear)}
    heights = {edge: _height(ear, edge, x) for ear in ears for edge in _edges(ear)}
    diagonals = [(a, b) for a, b in owner if a < b and (b, a) in owner]
    for a, b in sorted(diagonals, key=lambda edge: min(heights[edge], heights[edge[::-1]])):
        kept, gone = owner[a, b], owner[b, a]
        one, other = _beginning_with(b, pieces[kept]), _beginning_with(a, pieces[gone])
        # One runs from b to a, the other from a to b: together they turn at a and at b.
        if _left(x[one[-2]], x[a], x[other[1]]) and _left(x[other[-2]], x[b], x[one[1]]):
            pieces[kept] = one + other[1:-1]
            owner.update((edge, kept) for edge in _edges(pieces.pop(gone)))
    return list(pieces.values())


def _edges(piece: list[int]) -> list[tuple[int, int]]:
    return list(zip(piece, piece[1:] + piece[:1], strict=True))


def _beginning_with(corner: int, piece: list[int]) -> list[int]:
    place = piece.index(corner)
    return piece[place:] + piece[:place]


def _height(ear: list[int], edge: tuple[int, int], x: list[complex]) -> float:
    """Height of a triangle over its longest edge, in lengths of that edge; infinite over the others."""
    lengths = {(a, b): abs(x[b] - x[a]) for a, b in _edges(ear)}
    if lengths[edge] < max(lengths.values()):
        return float("inf")
    a, b, c = (x[k] for k in ear)
    return ((b - a).conjugate() * (c - a)).imag / lengths[edge] ** 2


def _left(a: complex, b: complex, c: complex) -> bool:
    """Return True if the way from a over b to c turns left or goes straight on, up to a sine of 1e-9 for rounding."""
    return ((b - a).conjugate() * (c - b)).imag >= -1e-9 * abs(b - a) * abs(c - b)
