"""Quadrature of degree 5 on polygons: Radon's seven points on every triangle of a cell.

Strains of closed forms are no polynomials, and one of low degree hides what is to be measured: at the centroids of
squares the strains of the numerical answer superconverge. The rule (J. Radon, Monatsh. Math. 52 (1948)): the centroid
with weight 9/40, and with a = (6 -+ sqrt 15) / 21 the points of barycentric coordinates (a, a, 1 - 2a) with weight
(155 -+ sqrt 15) / 1200 each.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.estimate.measures.convex_parts import convex_pieces
from vemcvx.meshes.polygons.triangles import fans, places
from vemcvx.vem import Space


def _radon() -> tuple[Floats, Floats]:
    points, weights = [np.full((1, 3), 1.0 / 3.0)], [9.0 / 40.0]
    for root in (-np.sqrt(15.0), np.sqrt(15.0)):
        a = (6.0 + root) / 21.0
        points.append(np.full((3, 3), a) + (1.0 - 3.0 * a) * np.eye(3))
        weights += 3 * [(155.0 + root) / 1200.0]
    return np.concatenate(points), np.array(weights)


RADON_POINTS, RADON_WEIGHTS = _radon()


def cell_rule(space: Space) -> tuple[Floats, Floats, Ints]:
    """Points (q, 2), weights (q,) that add up to the areas, and the cell (q,) of each point."""
    pieces = convex_pieces(space)
    triangles = fans(pieces.corners, pieces.owner)
    points = places(triangles.corners, RADON_POINTS).reshape(-1, 2)
    weights = triangles.areas[:, None] * RADON_WEIGHTS
    return points, weights.ravel(), np.repeat(triangles.owner, len(RADON_WEIGHTS))
