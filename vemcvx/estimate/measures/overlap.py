"""One quadrature for two meshes, on every overlap of convex pieces of their cells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints, totals
from vemcvx.errors import MeshError
from vemcvx.meshes import PolygonMesh
from vemcvx.meshes.polygons.convex import clip
from vemcvx.meshes.polygons.geometry import INNER, clip_ears, cross, fans, overlapping_boxes, places, signed_areas
from vemcvx.vem import CellGroup, Space

# Cells in convex pieces: convex cells as they are, others cut into triangles.
#
# A cell counts as convex if every vertex lies left of the line through every edge, up to CONVEX times the size of the
# cell: that is what clipping by these lines relies on. (Neighbouring edges alone would not do: an edge of 1e-12 h has
# a direction that round-off turns by 1e-4, and its line would cut off as much of the cell.)


CONVEX = 1e-12
# All pieces share one array as wide as the widest; few cells have more vertices than this, and those are cut.
WIDEST = 12


@dataclass(frozen=True, eq=False)
class Pieces:
    """Convex pieces of the cells of a mesh."""

    corners: Floats
    """(p, w, 2) vertices, counter-clockwise, the last one repeated up to the width w"""
    owner: Ints
    """(p,) the cell of each piece"""


def convex_pieces(space: Space) -> Pieces:
    """The cells of a mesh in convex pieces."""
    corners, owner = zip(*[part for group in space.groups for part in _of_group(group)], strict=True)
    width = max(part.shape[1] for part in corners)
    wide = [np.pad(part, ((0, 0), (0, width - part.shape[1]), (0, 0)), mode="edge") for part in corners]
    return Pieces(np.concatenate(wide), np.concatenate(owner))


def _of_group(group: CellGroup) -> Iterator[tuple[Floats, Ints]]:
    # Temporary arrays of the tests below have 2^20 numbers.
    for chunk in group.chunks(2**20):
        corners, cells = chunk.points[chunk.nodes], chunk.cells
        n = corners.shape[1]
        convex = np.full(len(cells), n <= WIDEST)
        if 3 < n <= WIDEST:
            about = chunk.corners
            convex = inside(about, about)
        yield corners[convex], cells[convex]
        if not convex.all():
            ears = clip_ears(chunk.corners[~convex])
            triangles = corners[~convex][np.arange(len(ears))[:, None, None], ears].reshape(-1, 3, 2)
            # Ears on a straight side are flat, up to round-off of either sign.
            kept = signed_areas(triangles) > 0.0
            yield triangles[kept], np.repeat(cells[~convex], n - 2)[kept]


def inside(points: Floats, corners: Floats) -> Bools:
    """True if all points (c, p, 2) lie left of all edges of the polygons (c, n, 2), up to CONVEX of their size."""
    edge = np.roll(corners, -1, axis=1) - corners
    size = np.ptp(corners, axis=1).max(axis=1)
    reach = CONVEX * size[:, None] * np.hypot(edge[..., 0], edge[..., 1])
    left = cross(edge[:, :, None], points[:, None] - corners[:, :, None])
    within: Bools = np.all(left >= -reach[:, :, None], axis=(1, 2))
    return within


# One quadrature for two meshes: points and weights on every overlap of a cell of the one with a cell of the other.
#
# Cells are taken in convex pieces. A piece that lies in a piece of the other mesh is its own overlap, so that
# refinements cost a search and no clipping; what is left is clipped, pair by pair.


# Pairs of pieces in one go: temporaries of a few tens of megabytes.
PAIRS_AT_ONCE = 2**14


@dataclass(frozen=True, eq=False)
class CommonRule:
    """Points of quadrature on the overlaps of two meshes."""

    first: Ints
    """(q,) the cell of the first mesh that each point lies in"""
    second: Ints
    weights: Floats
    """(q,) that add up to the area that the meshes share"""
    points: Floats | None
    """(q, 2); None for degree 0, where any point of an overlap will do"""


@lru_cache(maxsize=4)
def common_rule(first: PolygonMesh, second: PolygonMesh, degree: int) -> CommonRule:
    """A quadrature exact for piecewise constants (degree 0) or piecewise quadratics (degree 2) on both meshes.

    The last few are kept: a history is compared step by step on the same two meshes.
    """
    parts = _rules(convex_pieces(Space(first)), convex_pieces(Space(second)), degree)
    i, j, weights, points = (np.concatenate(part) for part in zip(*parts, strict=True))
    return CommonRule(i, j, weights, points if degree else None)


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


Rule = tuple[Ints, Ints, Floats, Floats]


def _rules(a: Pieces, b: Pieces, degree: int) -> Iterator[Rule]:
    """Owners, weights and points of the overlaps, a few thousand pairs of pieces at a time."""
    i, j = _meeting(_boxes(a), _boxes(b))
    a_in_b, b_in_a = _contained(a, b, i, j), _contained(b, a, j, i)
    whole_a, whole_b = a_in_b, b_in_a & ~a_in_b
    done_a, done_b = np.zeros(len(a.owner), dtype=bool), np.zeros(len(b.owner), dtype=bool)
    done_a[i[a_in_b]] = True
    done_b[j[b_in_a]] = True
    cut = ~(a_in_b | b_in_a | done_a[i] | done_b[j])
    for kind, chosen in (("a", whole_a), ("b", whole_b), ("cut", cut)):
        pairs = np.flatnonzero(chosen)
        for start in range(0, max(len(pairs), 1), PAIRS_AT_ONCE):
            mine, other = i[pairs[start : start + PAIRS_AT_ONCE]], j[pairs[start : start + PAIRS_AT_ONCE]]
            polygons = a.corners[mine] if kind == "a" else b.corners[other]
            if kind == "cut" and len(mine):
                polygons = clip(polygons, a.corners[mine])
            yield _on(polygons, a.owner[mine], b.owner[other], degree)


def _meeting(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> tuple[Ints, Ints]:
    """The pairs of boxes that share more than a side."""
    i, j = overlapping_boxes(*first, *second)
    shared = np.minimum(first[1][i], second[1][j]) - np.maximum(first[0][i], second[0][j])
    smaller = np.minimum((first[1] - first[0])[i], (second[1] - second[0])[j])
    # Boxes that share less than this part of the smaller one's width or height only touch.
    meet = (shared > 1e-12 * smaller).all(axis=1)
    return i[meet], j[meet]


def _boxes(pieces: Pieces) -> tuple[Floats, Floats]:
    return pieces.corners.min(axis=1), pieces.corners.max(axis=1)


def _contained(small: Pieces, large: Pieces, i: Ints, j: Ints) -> Bools:
    """Return True if piece i of the one set lies in piece j of the other, pair by pair."""
    within = np.zeros(len(i), dtype=bool)
    low, high = _boxes(large)
    reach = 1e-9 * (high - low).max(axis=1)[:, None]
    its_low, its_high = _boxes(small)
    likely = np.flatnonzero(((its_low[i] >= (low - reach)[j]) & (its_high[i] <= (high + reach)[j])).all(axis=1))
    for start in range(0, len(likely), PAIRS_AT_ONCE):
        part = likely[start : start + PAIRS_AT_ONCE]
        within[part] = inside(small.corners[i[part]], large.corners[j[part]])
    return within


def _on(polygons: Floats, first: Ints, second: Ints, degree: int) -> Rule:
    """The rule on convex polygons (p, w, 2): the area, or three points on every triangle."""
    triangles = fans(polygons, np.arange(len(polygons)))
    if not degree:
        total = totals(triangles.owner, triangles.areas, len(polygons))
        kept = total > 0.0
        return first[kept], second[kept], total[kept], np.empty((0, 2))
    owner = np.repeat(triangles.owner, 3)
    points = places(triangles.corners, INNER).reshape(-1, 2)
    return first[owner], second[owner], np.repeat(triangles.areas / 3.0, 3), points
