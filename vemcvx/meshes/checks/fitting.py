"""Do the edges of a boundary fit together? They may meet in common nodes only, and wind once about what they bound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.polygons.segments import TOLERANCE, beside, cross, crossing, overlapping_boxes, rounding
from vemcvx.meshes.polygons.topology import smallest_linked

# A slit below this part of the edges beside it is a mistake (single precision, printed digits), not a geometry.
NARROW = 1e-6
# Between bodies, which may have been drawn apart by programs of six digits or less, one below this part.
NARROW_BETWEEN_BODIES = 1e-3


@dataclass(frozen=True)
class Misfit:
    """A place where edges do not fit together.

    Attributes
    ----------
    kind : {"crossing", "touching", "gap", "covered"}
        Edges cross; a node lies on an edge; it lies hardly beside one; the plane beside an edge is covered twice.
    edge, other : int
        Numbers of the edges: the other one crosses the edge, or starts from the node; of "covered" both are the edge.
    distance : float
        Width of a gap.
    """

    kind: str
    edge: int
    other: int
    distance: float = 0.0


def misfit_of(points: Floats, ends: Ints, shortest: Floats, bodies: Ints | None = None) -> Misfit | None:
    """Find the first place where the edges of a boundary do not fit together.

    Parameters
    ----------
    points : (n_nodes, 2) array
    ends : (m, 2) array of int
        The edges, what they bound on their left.
    shortest : (n_nodes,) array
        The shortest edge at each node.
    bodies : (m,) array of int, optional
        The body of each edge.
    """
    return _intersection(points, ends, shortest, bodies) or _covered(points, ends)


def shortest_edges(points: Floats, ends: Ints) -> Floats:
    """The shortest of the edges (m, 2) at each node, (n_nodes,)."""
    shortest = np.full(len(points), np.inf)
    np.minimum.at(shortest, ends.ravel(), np.repeat(_lengths(points, ends), 2))
    return shortest


def _lengths(points: Floats, ends: Ints) -> Floats:
    lengths: Floats = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    return lengths


def _intersection(points: Floats, ends: Ints, shortest: Floats, bodies: Ints | None) -> Misfit | None:
    """Edges must not cross, nor a node lie on or hardly beside another edge."""
    corners, lengths = points[ends], _lengths(points, ends)
    widest = NARROW if bodies is None else NARROW_BETWEEN_BODIES
    margin = widest * lengths[:, None] + TOLERANCE * np.abs(corners).max(axis=(1, 2))[:, None]
    low, high = corners.min(axis=1) - margin, corners.max(axis=1) + margin
    one, other = overlapping_boxes(low, high, low, high)
    different = one != other
    one, other = one[different], other[different]
    bad = np.flatnonzero(crossing(points, ends[one], ends[other]))
    if len(bad):
        return Misfit("crossing", int(one[bad[0]]), int(other[bad[0]]))
    # Boundary nodes start as many boundary edges as they end: looking at the starts is enough.
    apart = np.flatnonzero((ends[one] != ends[other, :1]).all(axis=1))
    one, other = one[apart], other[apart]
    node, start, end = ends[other, 0], points[ends[one, 0]], points[ends[one, 1]]
    distance, side = beside(points[node], start, end)
    bad = np.flatnonzero(distance <= rounding(points[node], start, end))
    if len(bad):
        return Misfit("touching", int(one[bad[0]]), int(other[bad[0]]))
    narrow = NARROW if bodies is None else np.where(bodies[one] == bodies[other], NARROW, NARROW_BETWEEN_BODIES)
    bad = np.flatnonzero((side < 0.0) & (distance <= narrow * np.minimum(shortest[node], lengths[one])))
    return Misfit("gap", int(one[bad[0]]), int(other[bad[0]]), float(distance[bad[0]])) if len(bad) else None


def _covered(points: Floats, ends: Ints) -> Misfit | None:
    """The boundary must wind once about the inside of each of its edges; edges do not meet but in nodes."""
    probes = _one_edge_a_chain(ends)
    vector = points[ends[:, 1]] - points[ends[:, 0]]
    steep = np.abs(vector[probes, 1]) >= np.abs(vector[probes, 0])
    quarter_turned = points[:, ::-1] * [1.0, -1.0]
    for chosen, plane in ((probes[steep], points), (probes[~steep], quarter_turned)):
        bad = chosen[_winding_inside(plane, ends, chosen) != 1] if len(chosen) else chosen
        if len(bad):
            return Misfit("covered", int(bad[0]), int(bad[0]))
    return None


def _one_edge_a_chain(ends: Ints) -> Ints:
    """One boundary edge of each chain; chains end where a node starts more than one (two cells meet in a point)."""
    order = np.argsort(ends[:, 0], kind="stable")
    starts, counts = np.unique(ends[:, 0], return_counts=True)
    simple = counts[np.searchsorted(starts, ends[:, 1])] == 1
    follower = order[np.searchsorted(ends[order, 0], ends[simple, 1])]
    return np.unique(smallest_linked(np.column_stack([np.flatnonzero(simple), follower]), len(ends)))


def _winding_inside(points: Floats, ends: Ints, probes: Ints) -> Ints:
    """Winding number of all edges just left of the middle of the probing ones, by rays along +x."""
    start, end = points[ends[:, 0]], points[ends[:, 1]]
    middle = 0.5 * (start[probes] + end[probes])
    far = np.column_stack([np.full(len(probes), np.inf), middle[:, 1]])
    probe, edge = overlapping_boxes(middle, far, np.minimum(start, end), np.maximum(start, end))
    y, low, high = middle[probe, 1], start[edge, 1], end[edge, 1]
    upward, downward = (low <= y) & (y < high), (high <= y) & (y < low)
    left = cross(end[edge] - start[edge], middle[probe] - start[edge])
    own = edge == probes[probe]  # left of an upward edge the ray crosses it, left of a downward one it does not
    step = np.where(upward & ((left > 0.0) | own), 1, 0) - np.where(downward & (left < 0.0) & ~own, 1, 0)
    return np.bincount(probe, weights=step, minlength=len(probes)).round().astype(np.int64)
