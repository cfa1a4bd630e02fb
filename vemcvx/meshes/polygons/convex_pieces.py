"""A simple polygon cut into convex pieces along diagonals (S. Hertel, K. Mehlhorn, FCT 1983, LNCS 158, 207-218).

Ears are clipped, then every diagonal is taken out again whose absence leaves no right turn: at most four times as many
pieces as the best. Ears may be flat (three corners in a line, as at the tips of a comb); the diagonal under the
flattest comes first, which joins it to what lies below.
"""

from __future__ import annotations

from vemcvx.arrays import Floats
from vemcvx.meshes.polygons.triangles import clip_ears

Edge = tuple[int, int]
# Sine of the angle by which a piece may turn right: rounding where it goes straight on.
STRAIGHT = 1e-9


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
    """Whether the way from a over b to c turns left or goes straight on."""
    return ((b - a).conjugate() * (c - b)).imag >= -STRAIGHT * abs(b - a) * abs(c - b)
