"""Points, edges and plane faces in space: how far a point is from a face, which edges pierce or cross what.

A point is inside the outline of a face if a line from it in the plane of two coordinates (the one left out is that in
which the normal is longest) crosses the outline an odd number of times.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.polygons.segments import TOLERANCE
from vemcvx.meshes.polygons.topology import next_vertex, spans

PAIRS_AT_ONCE = 200_000
PARALLEL = 1e-12
"""Squared sine of the angle below which two edges count as parallel: they touch in end points only."""


def beside_faces(
    places: Floats, faces: Ints, points: Floats, offsets: Ints, vertices: Ints, normals: Floats
) -> tuple[Floats, Bools]:
    """Distance (m,) of places (m, 3) from the outlines of faces (m,), and whether they are inside these, seen along."""
    follow = next_vertex(offsets, vertices)
    distance, inside = np.empty(len(places)), np.empty(len(places), dtype=bool)
    for start in range(0, len(places), PAIRS_AT_ONCE):
        part = slice(start, start + PAIRS_AT_ONCE)
        counts = np.diff(offsets)[faces[part]]
        corner = spans(offsets[faces[part]], counts)
        rows = np.cumsum(counts) - counts
        at = np.repeat(places[part], counts, axis=0)
        a, b = points[vertices[corner]] - at, points[follow[corner]] - at
        distance[part] = np.minimum.reduceat(_from_origin(a, b), rows)
        longest = np.repeat(np.argmax(np.abs(normals[faces[part]]), axis=1), counts)[:, None]
        (au, bu), (av, bv) = (
            [np.take_along_axis(x, (longest + shift) % 3, axis=1)[:, 0] for x in (a, b)] for shift in (1, 2)
        )
        astride = (av > 0.0) != (bv > 0.0)
        # Where the outline crosses the line v = 0: at u = au - av (bu - au) / (bv - av).
        beyond = (au * bv - bu * av) * np.sign(bv - av) > 0.0
        inside[part] = np.add.reduceat(astride & beyond, rows, dtype=np.int64) % 2 == 1
    return distance, inside


def _from_origin(a: Floats, b: Floats) -> Floats:
    """Distance (m,) of the origin from segments (m, 3)."""
    edge = b - a
    length = np.einsum("ij,ij->i", edge, edge)
    along = np.clip(-np.einsum("ij,ij->i", a, edge) / length, 0.0, 1.0)
    distance: Floats = np.linalg.norm(a + along[:, None] * edge, axis=1)
    return distance


def crossing_distance(points: Floats, first: Ints, second: Ints) -> Floats:
    """How far edges (m, 2) pass by others (m, 2) where both are nearest in inner points; elsewhere infinite."""
    a, c = points[first[:, 0]], points[second[:, 0]]
    one, other, apart = points[first[:, 1]] - a, points[second[:, 1]] - c, a - c
    aa, bb, ab = (np.einsum("ij,ij->i", x, y) for x, y in ((one, one), (other, other), (one, other)))
    ar, br = np.einsum("ij,ij->i", one, apart), np.einsum("ij,ij->i", other, apart)
    square = aa * bb - ab * ab
    skew = square > PARALLEL * aa * bb
    divisor = np.where(skew, square, 1.0)
    s, t = (ab * br - bb * ar) / divisor, (aa * br - ab * ar) / divisor
    inner = skew & (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
    return np.where(inner, np.linalg.norm(apart + s[:, None] * one - t[:, None] * other, axis=1), np.inf)


def piercing(start: Floats, end: Floats, height_start: Floats, height_end: Floats) -> tuple[Bools, Floats]:
    """Whether edges (m, 3) leave a plane on both sides beyond rounding, and where they cross it, (m, 3)."""
    slack = TOLERANCE * np.maximum(np.abs(start).max(axis=1), np.abs(end).max(axis=1))
    low, high = np.minimum(height_start, height_end), np.maximum(height_start, height_end)
    through = (low < -slack) & (high > slack)
    part = np.divide(height_start, height_start - height_end, out=np.zeros_like(slack), where=through)
    return through, start + part[:, None] * (end - start)


def solid_angles(places: Floats, triangles: Floats) -> Floats:
    """Solid angles (m, t) of triangles (t, 3, 3) seen from places (m, 3), positive where normals point away."""
    return angles_seen(triangles[None] - places[:, None, None])


def angles_seen(arms: Floats) -> Floats:
    """Solid angles (...,) of triangles whose corners are at arms (..., 3, 3) from the eye.

    tan(angle / 2) = a . (b x c) / (abc + (a . b) c + (a . c) b + (b . c) a), the letters the arms and their lengths
    (A. van Oosterom and J. Strackee, IEEE Trans. Biomed. Eng. 30 (1983), 125-126).
    """
    a, b, c = (arms[..., k, :] for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
    ab, ac, bc = (np.einsum("...i,...i->...", x, y) for x, y in ((a, b), (a, c), (b, c)))
    volume = np.einsum("...i,...i->...", a, np.cross(b, c))
    angles: Floats = 2.0 * np.arctan2(volume, la * lb * lc + ab * lc + ac * lb + bc * la)
    return angles
