"""Polygons between segments that meet at their ends: the faces of plane graphs, many graphs at once.

Every segment is walked in both directions, a polygon on the left of each. At its end the walk turns as far to the left
as it can: the segments of a node are sorted by their angles, and what follows a walk a -> b is the one before b -> a,
counter-clockwise. So walks close to rings (as in a doubly connected edge list; de Berg et al., *Computational
Geometry*, 2.2): counter-clockwise those of the polygons, clockwise the one around each connected graph. Rings are found
by doubling steps, as many times as the logarithm of the longest.

Graphs in several pieces have polygons with holes, segments with the same polygon on both sides end nowhere or bridge,
and rings may touch themselves. Shapely is asked for these.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.polygons import cross, offsets_of, rows_in_order, smallest_linked, spans, triangles_of


def polygons_between(owner: Ints, ends: Ints, at: Floats) -> tuple[Ints, Ints, Ints]:
    """The polygons between segments of one owner, in order of these, in either direction.

    Parameters
    ----------
    owner : (s,) array
        The graph that each segment is of, all below some number.
    ends : (s, 2) array
        The nodes at its ends, called by any numbers.
    at : (s, 2, 2) array
        Where these are in the plane of the owner.

    Returns
    -------
    found, offsets, nodes
        The owner (p,) of each polygon, and its nodes. Polygons with holes are cut in triangles.
    """
    rings = _rings(owner, ends, at)
    awkward = _awkward(owner, ends, rings)
    kept = (rings.area > 0.0) & ~awkward[rings.of]
    offsets, walks = rows_in_order(rings.offsets, rings.walks, np.flatnonzero(kept))
    found, nodes = rings.of[kept], ends.T.ravel()[walks]
    if not awkward.any():
        return found, offsets, nodes
    some, graphs = np.flatnonzero(awkward[owner]), np.flatnonzero(awkward)
    others, rows, names = _by_shapely(np.searchsorted(graphs, owner[some]), np.dstack([at[some], ends[some]]))
    found, sizes = np.concatenate([found, graphs[others]]), np.concatenate([np.diff(offsets), np.diff(rows)])
    order = np.argsort(found, kind="stable")
    return found[order], *rows_in_order(offsets_of(sizes), np.concatenate([nodes, names]), order)


class _Rings(NamedTuple):
    """Walks that close: walk k < s goes along segment k, and walk k + s back."""

    offsets: Ints
    walks: Ints
    of: Ints
    """the owner of each ring"""
    area: Floats
    """twice the area, negative where it runs clockwise"""


def _rings(owner: Ints, ends: Ints, at: Floats) -> _Rings:
    """The rings of all walks, in order of their owners."""
    count = len(owner)
    start, of = ends.T.ravel(), np.tile(owner, 2)
    here, there = np.concatenate([at[:, 0], at[:, 1]]), np.concatenate([at[:, 1], at[:, 0]])
    arm = there - here
    node = of * (int(start.max(initial=0)) + 1) + start
    order = np.lexsort((np.arctan2(arm[:, 1], arm[:, 0]), node))
    first = np.flatnonzero(np.diff(node[order], prepend=-1))
    sizes = np.diff(np.append(first, len(order)))
    before = np.arange(-1, len(order) - 1)
    before[first] = first + sizes - 1
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    walks = np.arange(2 * count)
    follow = order[before[rank[(walks + count) % (2 * count)]]]
    leader = smallest_linked(np.column_stack([walks, follow]), 2 * count)
    steps, ahead = (walks != leader).astype(np.int64), np.where(walks == leader, walks, follow)
    while (ahead != leader).any():
        steps, ahead = steps + steps[ahead], ahead[ahead]
    # The leader has no steps to go and comes first; then the one with most.
    walk = np.lexsort((np.where(walks == leader, -len(walks), -steps), leader))
    begin = np.flatnonzero(np.diff(leader[walk], prepend=-1))
    ring = np.append(begin, len(walk))
    origin = np.repeat(here[walk[begin]], np.diff(ring), axis=0)
    area = np.add.reduceat(cross(here[walk] - origin, there[walk] - origin), begin)
    by_owner = np.argsort(of[walk[begin]], kind="stable")
    rows, walk = rows_in_order(ring, walk, by_owner)
    return _Rings(rows, walk, of[walk[rows[:-1]]], area[by_owner])


def _awkward(owner: Ints, ends: Ints, rings: _Rings) -> Bools:
    """Return True for each owner whose rings are not all outlines of polygons, or the one around them."""
    (ring, walk, of, area), graphs, count = rings, int(owner.max(initial=-1)) + 1, len(owner)
    awkward: Bools = np.bincount(of, area <= 0.0, graphs) != np.bincount(owner, minlength=graphs).astype(bool)
    ring_of = np.empty_like(walk)
    ring_of[walk] = np.repeat(np.arange(len(of)), np.diff(ring))
    awkward[owner[ring_of[:count] == ring_of[count:]]] = True
    node = ends.T.ravel()[walk]
    order = np.lexsort((node, ring_of[walk]))
    again = (np.diff(node[order]) == 0) & (np.diff(ring_of[walk[order]]) == 0)
    awkward[of[ring_of[walk[order[1:][again]]]]] = True
    return awkward


def _by_shapely(owner: Ints, segments: Floats) -> tuple[Ints, Ints, Ints]:
    """The same polygons; segments (s, 2, 3) have the numbers of their ends as third coordinates."""
    import shapely

    lines = shapely.linestrings(segments)
    order = np.argsort(owner, kind="stable")
    counts = np.bincount(owner)
    width, begin = 2 ** np.ceil(np.log2(counts)).astype(np.int64), offsets_of(counts)
    polygons, of = [], []
    for size in np.unique(width):
        rows = np.flatnonzero(width == size)
        table = np.full((len(rows), size), None, dtype=object)
        table[np.arange(size) < counts[rows, None]] = lines[order[spans(begin[rows], counts[rows])]]
        parts, row = shapely.get_parts(shapely.polygonize(table), return_index=True)
        polygons.append(parts)
        of.append(rows[row])
    every, found = np.concatenate(polygons), np.concatenate(of)
    holed = shapely.get_num_interior_rings(every) > 0
    corners, ring = shapely.get_coordinates(every[~holed], include_z=True, return_index=True)
    first = np.diff(ring, append=-1) == 0  # without the last corner, which is the first again
    names, sizes, found_in = corners[first, 2], np.bincount(ring[first]), found[~holed]
    if holed.any():
        corners, ring = shapely.get_coordinates(every[holed], include_z=True, return_index=True)
        owner, triangle = triangles_of(
            every[holed], offsets_of(np.bincount(ring)), np.arange(len(ring)), corners[:, :2]
        )
        names, sizes = np.append(names, corners[triangle, 2]), np.append(sizes, np.full(len(triangle), 3))
        found_in = np.append(found_in, found[holed][owner])
    ranked = np.argsort(found_in, kind="stable")
    return found_in[ranked], *rows_in_order(offsets_of(sizes), names.astype(np.int64), ranked)
