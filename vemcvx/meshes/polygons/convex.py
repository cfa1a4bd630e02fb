"""Convex polygons: their intersections, and simple polygons cut into them.

Of two convex polygons, one is cut by the line of every edge of the other in turn (I. E. Sutherland, G. W. Hodgman,
Comm. ACM 17 (1974)). What comes out depends continuously on the vertices: edges that lie on one another up to
round-off, the rule and not the exception where meshes are nested, cost an area of round-off and no more.

A simple polygon is cut into convex pieces along diagonals (S. Hertel, K. Mehlhorn, FCT 1983, LNCS 158, 207-218): ears
are clipped, then every diagonal is taken out again whose absence leaves no right turn: at most four times as many
pieces as the best. Ears may be flat (three corners in a line, as at the tips of a comb); the diagonal under the
flattest comes first, which joins it to what lies below.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.polygons.geometry import clip_ears, cross


def clip(subject: Floats, window: Floats) -> Floats:
    """Intersections (p, w, 2) of convex polygons (p, m, 2) and (p, n, 2), counter-clockwise.

    The last vertex is repeated up to the common width w, also in what is given; a point where they do not meet.
    """
    # Relative to a vertex of the window: differences of neighbouring coordinates are exact.
    origin = window[:, :1]
    polygon, window = subject - origin, window - origin
    rows = np.arange(len(polygon))
    result = np.zeros_like(polygon)
    for start in range(window.shape[1]):
        from_, to = window[rows, start], window[rows, (start + 1) % window.shape[1]]
        polygon, left = left_of(polygon, from_, to - from_)
        rows, polygon = rows[left], polygon[left]
    if polygon.shape[1] > result.shape[1]:
        result = np.zeros((len(result), polygon.shape[1], 2))
    result[rows] = np.pad(polygon, ((0, 0), (0, result.shape[1] - polygon.shape[1]), (0, 0)), mode="edge")
    return result + origin


def left_of(polygon: Floats, point: Floats, direction: Floats) -> tuple[Floats, Bools]:
    """The parts of convex polygons (p, m, 2) left of lines through points (p, 2), and which of them have any.

    Where there is none, the last vertex of the polygon is repeated.
    """
    side = cross(direction[:, None], polygon - point[:, None])
    if (side >= 0).all():
        return polygon, np.ones(len(polygon), dtype=bool)
    after, side_after = np.roll(polygon, -1, axis=1), np.roll(side, -1, axis=1)
    stays = side >= 0
    crosses = stays != (side_after >= 0)
    part = np.divide(side, side - side_after, out=np.zeros_like(side), where=crosses)
    met = polygon + part[..., None] * (after - polygon)
    # In the order around the polygon: each vertex that stays, then the point where the edge that follows it crosses.
    found = np.stack([stays, crosses], axis=2).reshape(len(polygon), -1)
    places = np.stack([polygon, met], axis=2).reshape(len(polygon), -1, 2)
    count = found.sum(axis=1)
    width = max(int(count.max()), 1)
    slot = np.minimum(np.cumsum(found, axis=1) - 1, width - 1)
    row, column = np.nonzero(found)
    cut = np.empty((len(polygon), width, 2))
    last = places[np.arange(len(polygon)), _last(found)]
    cut[:] = last[:, None]
    cut[row, slot[row, column]] = places[row, column]
    return cut, count > 0


def _last(found: Bools) -> Ints:
    """The last true column of every row (the last column where there is none)."""
    last: Ints = found.shape[1] - 1 - np.argmax(found[:, ::-1], axis=1)
    return last


Edge = tuple[int, int]


def convex_pieces(corners: Floats) -> list[list[int]]:
    """The convex pieces of a polygon (n, 2), each by the numbers of its corners; all counter-clockwise."""
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


def _edges(piece: list[int]) -> list[Edge]:
    return list(zip(piece, piece[1:] + piece[:1], strict=True))


def _beginning_with(corner: int, piece: list[int]) -> list[int]:
    place = piece.index(corner)
    return piece[place:] + piece[:place]


def _height(ear: list[int], edge: Edge, x: list[complex]) -> float:
    """Height of a triangle over its longest edge, in lengths of that edge; infinite over the others."""
    lengths = {(a, b): abs(x[b] - x[a]) for a, b in _edges(ear)}
    if lengths[edge] < max(lengths.values()):
        return float("inf")
    a, b, c = (x[k] for k in ear)
    return ((b - a).conjugate() * (c - a)).imag / lengths[edge] ** 2


def _left(a: complex, b: complex, c: complex) -> bool:
    """Return True if the way from a over b to c turns left or goes straight on, up to a sine of 1e-9 for rounding."""
    return ((b - a).conjugate() * (c - b)).imag >= -1e-9 * abs(b - a) * abs(c - b)
