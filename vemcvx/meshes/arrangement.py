"""Polygons between segments that meet at their ends: the faces of plane graphs, many graphs at once.

Every segment is walked in both directions, a polygon on the left of each. At its end the walk turns as far to the left
as it can: the segments of a node are sorted by their angles, and what follows a walk a -> b is the one before b -> a,
counter-clockwise. So walks close to rings (as in a doubly connected edge list; de Berg et al., *Computational
Geometry*, 2.2): counter-clockwise those of the polygons, clockwise the one around each connected graph.

Graphs in several pieces have polygons with holes, segments with the same polygon on both sides end nowhere or bridge,
and rings may touch themselves. Shapely is asked for these.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.polygons import cross, distinct, offsets_of, rows_in_order, smallest_linked, spans, triangles_of


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
    found, offsets, corners
        The owner (p,) of each polygon, and where in `ends`, row by row, its nodes stand. Polygons with holes are cut in
        triangles.
    """
    rings = _rings(owner, ends, at)
    awkward = _awkward(owner, ends, rings)
    kept = (rings.area > 0.0) & ~awkward[rings.of]
    offsets, corners = rows_in_order(rings.offsets, rings.walks, np.flatnonzero(kept))
    found = rings.of[kept]
    if not awkward.any():
        return found, offsets, corners
    some, graphs = np.flatnonzero(awkward[owner]), np.flatnonzero(awkward)
    segments = np.dstack([at[some], 2 * some[:, None] + [0, 1]])
    others, rows, more = _by_shapely(np.searchsorted(graphs, owner[some]), segments)
    found, sizes = np.concatenate([found, graphs[others]]), np.concatenate([np.diff(offsets), np.diff(rows)])
    order = np.argsort(found, kind="stable")
    return found[order], *rows_in_order(offsets_of(sizes), np.concatenate([corners, more]), order)


class _Rings(NamedTuple):
    """Walks that close: walk 2 k begins at the first end of segment k and goes along it, walk 2 k + 1 comes back."""

    offsets: Ints
    walks: Ints
    of: Ints
    """the owner of each ring"""
    area: Floats
    """twice the area, negative where it runs clockwise"""


def _rings(owner: Ints, ends: Ints, at: Floats) -> _Rings:
    """The rings of all walks, in order of their owners."""
    walks, of = np.arange(2 * len(owner)), np.repeat(owner, 2)
    here, there = at.reshape(-1, 2), at[:, ::-1].reshape(-1, 2)
    arm = there - here
    node = of * (int(ends.max(initial=0)) + 1) + ends.ravel()
    order = np.lexsort((np.arctan2(arm[:, 1], arm[:, 0]), node))
    first = np.flatnonzero(np.diff(node[order], prepend=-1))
    before = walks - 1
    before[first] = np.append(first[1:], len(order)) - 1
    rank = np.empty_like(order)
    rank[order] = walks
    follow = order[before[rank[walks ^ 1]]]
    # The smallest walk of each ring leads; all rings go on at once, and leave when they are back at it.
    head = distinct(smallest_linked(np.column_stack([walks, follow]), len(walks)))
    head = head[np.argsort(of[head], kind="stable")]
    ring, walk, found = np.arange(len(head)), head, list[tuple[Ints, Ints]]()
    while len(walk):
        found.append((ring, walk))
        walk = follow[walk]
        on = walk != head[ring]
        ring, walk = ring[on], walk[on]
    ring, walk = (np.concatenate(parts) for parts in zip(*found, strict=True))
    offsets, walk = offsets_of(np.bincount(ring)), walk[np.argsort(ring, kind="stable")]
    origin = np.repeat(here[walk[offsets[:-1]]], np.diff(offsets), axis=0)
    area = np.add.reduceat(cross(here[walk] - origin, there[walk] - origin), offsets[:-1])
    return _Rings(offsets, walk, of[head], area)


def _awkward(owner: Ints, ends: Ints, rings: _Rings) -> Bools:
    """Return True for each owner whose rings are not all outlines of polygons, or the one around them."""
    (offsets, walk, of, area), graphs = rings, int(owner.max(initial=-1)) + 1
    awkward: Bools = np.bincount(of, area <= 0.0, graphs) != np.bincount(owner, minlength=graphs).astype(bool)
    ring_of = np.empty_like(walk)
    ring_of[walk] = np.repeat(np.arange(len(of)), np.diff(offsets))
    awkward[owner[ring_of[::2] == ring_of[1::2]]] = True
    again = np.sort(ring_of * (int(ends.max(initial=0)) + 1) + ends.ravel())
    twice = again[1:][again[1:] == again[:-1]]
    awkward[of[twice // (int(ends.max(initial=0)) + 1)]] = True
    return awkward


def _by_shapely(owner: Ints, segments: Floats) -> tuple[Ints, Ints, Ints]:
    """The same polygons; segments (s, 2, 3) have as third coordinates where their ends stand."""
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
