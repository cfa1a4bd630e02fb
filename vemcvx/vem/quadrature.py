"""Quadrature on polygons, exact for degree 2, that never leaves the cell; on polyhedra at the centroid.

With centroid c and second moments M = 1/|K| int_K (x - c)(x - c)' dx, the four points

    c +- sqrt(2) M^(1/2) e_x,   c +- sqrt(2) M^(1/2) e_y,   of weight |K|/4 each,

match all moments of degree 2. They lie on the ellipse |M^(-1/2)(x - c)|^2 = 2, which every convex cell
contains (Kannan, Lovasz, Simonovits, Discrete Comput. Geom. 13 (1995): radius sqrt((d + 2)/d) in d
dimensions); in a triangle it touches the sides. Cells where one of these points is not clearly inside are cut
into triangles: from the centroid if it sees all edges, else by clipping ears. A triangle has three inner points.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.polygons.segments import cross
from vemcvx.meshes.polygons.shapes import polygon_centroids
from vemcvx.meshes.polygons.triangles import INNER, clip_ears, places, signed_areas
from vemcvx.vem.cells import CellGroup
from vemcvx.vem.polyhedra import PolyhedronGroup

Rule = tuple[Floats, Floats, Ints]
# "Clearly inside": at least this far, in units of sqrt(|K|), on the inner side of each edge. It excludes the
# touching cases (triangles with hanging nodes), where round-off would decide; aspect ratios of 1e11 pass.
MARGIN = 1e-6
# Ears with less of the cell's area than this are flat, and their points on its boundary: they are left out.
FLAT = 1e-14


def cell_quadrature(group: CellGroup) -> Rule:
    """Points (q, dim) in the cells of a group, weights that add up to their areas, and positions in the group, (q,)."""
    if isinstance(group, PolyhedronGroup):
        return group.quadrature()
    corners = group.corners
    origin = group.points[group.nodes[:, 0]]
    if corners.shape[1] == 3:
        return _placed(_on_triangles(corners, np.arange(len(corners))), origin)
    areas, centres = polygon_centroids(corners)
    about = corners - centres[:, None]
    ring = _ring(about, areas)
    convex = _sees(ring, about, areas)
    rest = np.flatnonzero(~convex)
    star = _sees(np.zeros((len(rest), 1, 2)), about[rest], areas[rest])
    pieces = [
        _on_ring(ring[convex] + centres[convex, None], areas[convex], np.flatnonzero(convex)),
        _on_fan(corners[rest[star]], centres[rest[star]], rest[star]),
        _on_ears(corners[rest[~star]], rest[~star]),
    ]
    points, weights, owner = (np.concatenate(part) for part in zip(*pieces, strict=True))
    return _placed((points, weights, owner), origin)


def _placed(rule: Rule, origin: Floats) -> Rule:
    points, weights, owner = rule
    return points + origin[owner], weights, owner


def _ring(about: Floats, areas: Floats) -> Floats:
    """The four points (c, 4, 2) relative to the centroid, from vertices relative to the centroid."""
    after = np.roll(about, -1, axis=1)
    part = cross(about, after) / (12.0 * areas[:, None])
    both = about + after
    # int over the triangle (0, p, q): cross/24 (pp' + qq' + (p + q)(p + q)').
    M = 0.5 * sum(np.einsum("ci,cia,cib->cab", part, p, p) for p in (about, after, both))
    trace = M[:, 0, 0] + M[:, 1, 1]
    # det may round below zero on cells thinner than 1e-8 of their length; those do not pass _sees.
    root = np.sqrt(np.maximum(M[:, 0, 0] * M[:, 1, 1] - M[:, 0, 1] ** 2, 0.0))
    half = (M + root[:, None, None] * np.eye(2)) * np.sqrt(2.0 / (trace + 2.0 * root))[:, None, None]
    return np.concatenate([half, -half], axis=1)


def _sees(points: Floats, corners: Floats, areas: Floats) -> Bools:
    """Whether all points (c, p, 2) of a cell lie clearly left of all its edges: (c,)."""
    edge = np.roll(corners, -1, axis=1) - corners
    reach = MARGIN * np.sqrt(np.einsum("cia,cia->ci", edge, edge) * areas[:, None])
    left = cross(edge[:, :, None], points[:, None] - corners[:, :, None])
    sees: Bools = np.all(left > reach[:, :, None], axis=(1, 2))
    return sees


def _on_ring(points: Floats, areas: Floats, owner: Ints) -> Rule:
    return points.reshape(-1, 2), np.repeat(0.25 * areas, 4), np.repeat(owner, 4)


def _on_fan(corners: Floats, centres: Floats, owner: Ints) -> Rule:
    top = np.broadcast_to(centres[:, None], corners.shape)
    triangles = np.stack([top, corners, np.roll(corners, -1, axis=1)], axis=2)
    return _on_triangles(triangles.reshape(-1, 3, 2), np.repeat(owner, corners.shape[1]))


def _on_ears(corners: Floats, owner: Ints) -> Rule:
    ears = clip_ears(corners)
    triangles = corners[np.arange(len(corners))[:, None, None], ears]
    points, weights, owner = _on_triangles(triangles.reshape(-1, 3, 2), np.repeat(owner, ears.shape[1]))
    per_cell = weights.reshape(len(corners), 3 * ears.shape[1])
    kept = (np.abs(per_cell) > FLAT * per_cell.sum(axis=1)[:, None]).ravel()
    return points[kept], weights[kept], owner[kept]


def _on_triangles(triangles: Floats, owner: Ints) -> Rule:
    weights = np.repeat(signed_areas(triangles) / 3.0, 3)
    return places(triangles, INNER).reshape(-1, 2), weights, np.repeat(owner, 3)
