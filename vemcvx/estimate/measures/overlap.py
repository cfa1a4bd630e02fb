"""One quadrature for two meshes, on every overlap of a cell of the one with a cell of the other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vemcvx.arrays import Floats, Ints, totals
from vemcvx.errors import MeshError
from vemcvx.meshes import PolygonMesh
from vemcvx.meshes.polygons.geometry import INNER, fans, outlines, overlaps, places


@dataclass(frozen=True, eq=False)
class CommonRule:
    """Points of quadrature on the overlaps of two meshes.

    They stand for polynomials on each overlap: in cells that are not convex some lie outside, with negative weights.
    """

    first: Ints
    """(q,) the cell of the first mesh that each point belongs to"""
    second: Ints
    weights: Floats
    """(q,) that add up to the area that the meshes share"""
    points: Floats
    """(q, 2)"""


@lru_cache(maxsize=4)
def common_rule(first: PolygonMesh, second: PolygonMesh) -> CommonRule:
    """A quadrature exact for what is quadratic on the cells of both meshes.

    The last few are kept: a history is compared step by step on the same two meshes.
    """
    i, j, shared = overlaps(*(outlines(mesh.points, mesh.offsets, mesh.vertices) for mesh in (first, second)))
    corners, areas, owner = fans(shared)
    points = places(corners, INNER).reshape(-1, 2)
    return CommonRule(np.repeat(i[owner], 3), np.repeat(j[owner], 3), np.repeat(areas / 3.0, 3), points)


def check_covered(rule: CommonRule, first: PolygonMesh, second: PolygonMesh, subject: str) -> None:
    """Raise MeshError unless both meshes cover the same domain."""
    for mine, mesh, name, other in ((rule.first, first, "first", "second"), (rule.second, second, "second", "first")):
        covered = totals(mine, rule.weights, mesh.n_cells) / mesh.areas
        # A cell is covered up to 1e-8 of its area, and a strip along it as wide as the rounding of both boundaries.
        allowed = 1e-8 + 1e-15 * np.abs(mesh.points).max() * mesh.diameters / mesh.areas
        worst = int(np.argmax(np.abs(covered - 1.0) - allowed))
        if abs(covered[worst] - 1.0) > allowed[worst]:
            raise MeshError(
                f"{subject}: the {other} mesh covers {100 * covered[worst]:.6g} % of cell {worst} of the {name} mesh, "
                f"at {mesh.centroids[worst]}; both must cover the same domain. Give common=True to measure on what "
                "they share."
            )
