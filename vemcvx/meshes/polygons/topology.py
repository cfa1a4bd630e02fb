"""Cells as rows of different lengths, laid end to end, and who touches whom: edges, boundary, neighbouring cells.

Row c is ``flat[offsets[c]:offsets[c + 1]]``. With the vertices of cells as rows, corner k of that flat list starts the
directed edge from ``vertices[k]`` to the next vertex of the same cell. Packing an undirected edge {a, b}, a < b, into
the one integer a * n_nodes + b makes "which corners share an edge" a single sort.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from vemcvx.arrays import Bools, Ints


def spans(starts: Ints, counts: Ints) -> Ints:
    """The numbers starts[0], starts[0] + 1, ... (counts[0] of them), then those from starts[1] and so on."""
    before = np.cumsum(counts) - counts
    return np.repeat(starts - before, counts) + np.arange(counts.sum())


def offsets_of(counts: Ints) -> Ints:
    """The offsets at which rows of these lengths begin, and the last one's end."""
    return np.concatenate([[0], np.cumsum(counts)])


def rows_in_order(offsets: Ints, flat: Ints, order: Ints) -> tuple[Ints, Ints]:
    """Offsets and entries of the rows with the given numbers, in this order."""
    counts = np.diff(offsets)[order]
    return offsets_of(counts), flat[spans(offsets[order], counts)]


def turned(offsets: Ints, vertices: Ints, backwards: Bools) -> Ints:
    """Vertices with the given rows listed the other way round, each from the same first vertex."""
    counts = np.repeat(np.diff(offsets), np.diff(offsets))
    start = np.repeat(offsets[:-1], np.diff(offsets))
    place = np.arange(len(vertices)) - start
    mirrored = start + (counts - place) % counts
    return np.where(np.repeat(backwards, np.diff(offsets)), vertices[mirrored], vertices)


def same_rows(offsets: Ints, vertices: Ints) -> tuple[Ints, Ints]:
    """Rows of the same entries, in any order, are one: the first of each, and which of these each row is."""
    counts = np.diff(offsets)
    leader = np.arange(len(counts))
    for count in np.unique(counts):
        listed = np.flatnonzero(counts == count)
        rows = np.sort(vertices[offsets[listed, None] + np.arange(count)], axis=1)
        order = np.lexsort(rows.T[::-1])
        rows = rows[order]
        starts = np.concatenate([[True], (rows[1:] != rows[:-1]).any(axis=1)])
        leader[listed[order]] = listed[order[np.flatnonzero(starts)]][np.cumsum(starts) - 1]
    first = np.unique(leader)
    return first, np.searchsorted(first, leader)


def matching_rows(offsets: Ints, flat: Ints, wanted_offsets: Ints, wanted: Ints) -> Ints:
    """Number of the row that has the same entries as each wanted row, in any order; -1 where there is none."""
    count = len(offsets) - 1
    whole = np.concatenate([offsets, offsets[-1] + wanted_offsets[1:]])
    first, number = same_rows(whole, np.concatenate([flat, wanted]))
    found: Ints = first[number[count:]]
    return np.where(found < count, found, -1)


def first_in_row(flags: Bools, offsets: Ints) -> Ints:
    """Place of the first True in each row, counted from the beginning of the row; 0 if there is none."""
    place = np.arange(len(flags)) - np.repeat(offsets[:-1], np.diff(offsets))
    none = len(flags)
    first = np.minimum.reduceat(np.where(flags, place, none), offsets[:-1])
    return np.where(first == none, 0, first)


def rotation(offsets: Ints, first: Ints) -> Ints:
    """Positions of all entries with every row turned so that it begins with its entry number ``first``."""
    counts = np.diff(offsets)
    begin, count = np.repeat(offsets[:-1], counts), np.repeat(counts, counts)
    turned: Ints = (np.arange(offsets[-1]) - begin + np.repeat(first, counts)) % count
    return begin + turned


def next_corner(offsets: Ints) -> Ints:
    """Position of the corner that follows each corner in its own cell."""
    follow = np.arange(1, offsets[-1] + 1)
    follow[offsets[1:] - 1] = offsets[:-1]
    return follow


def previous_corner(offsets: Ints) -> Ints:
    """Position of the corner that precedes each corner in its own cell."""
    before = np.arange(-1, offsets[-1] - 1)
    before[offsets[:-1]] = offsets[1:] - 1
    return before


def next_vertex(offsets: Ints, vertices: Ints) -> Ints:
    """Vertex that follows each corner's vertex in its own cell."""
    return vertices[next_corner(offsets)]


def cell_of_corner(offsets: Ints) -> Ints:
    """Cell that each corner belongs to."""
    return np.repeat(np.arange(len(offsets) - 1), np.diff(offsets))


def directed_edges(offsets: Ints, vertices: Ints) -> Ints:
    """The edge (a, b) that starts at each corner, (n_corners, 2)."""
    return np.column_stack([vertices, next_vertex(offsets, vertices)])


def edge_keys(edges: Ints, n_nodes: int) -> Ints:
    """One integer for each undirected edge (m, 2): min * n_nodes + max (exact below 3e9 nodes)."""
    return np.minimum(edges[:, 0], edges[:, 1]) * n_nodes + np.maximum(edges[:, 0], edges[:, 1])


def positions(wanted: Ints, edges: Ints, n_nodes: int) -> Ints:
    """The positions of wanted edges (k, 2) among the edges (m, 2), in either direction; all must be there."""
    keys = edge_keys(edges, n_nodes)
    order = np.argsort(keys)
    return order[np.searchsorted(keys, edge_keys(wanted, n_nodes), sorter=order)]


@dataclass(frozen=True, eq=False)
class SharedEdges:
    """Corners of a mesh sorted by the undirected edge they start."""

    corners: Ints
    """(n_corners,) all corners, those of one edge side by side, in the order of their cells"""
    first: Ints
    """(n_edges,) where in `corners` each edge begins"""
    counts: Ints
    """(n_edges,) how many cells share it: 1 on the boundary, 2 inside, more only in broken meshes"""

    @property
    def alone(self) -> Ints:
        """Corners whose edge belongs to one cell only, in the order of the cells."""
        return np.sort(self.corners[self.first[self.counts == 1]])

    @property
    def twice(self) -> tuple[Ints, Ints]:
        """The corners that start each edge of two cells: in the one of lower number, and in the other."""
        first = self.first[self.counts == 2]
        return self.corners[first], self.corners[first + 1]


def shared_edges(offsets: Ints, vertices: Ints, n_nodes: int) -> SharedEdges:
    """Sort the corners by undirected edge (see `SharedEdges`)."""
    keys = edge_keys(directed_edges(offsets, vertices), n_nodes)
    # Not only for the order: keys of meshes come in runs, and this takes a sixth of the time of a quicksort.
    corners = np.argsort(keys, kind="stable")
    keys = keys[corners]
    first = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
    return SharedEdges(corners, first, np.diff(np.append(first, len(keys))))


def neighbours(offsets: Ints, shared: SharedEdges) -> Ints:
    """Pairs of cells that share an edge, (m, 2), the smaller number first; a pair appears once an edge."""
    return cell_of_corner(offsets)[np.column_stack(shared.twice)]


def smallest_linked(pairs: Ints, count: int) -> Ints:
    """Connected components: for each number below `count` the smallest that pairs (m, 2) link it to, (count,)."""
    links = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    label = connected_components(links, directed=False)[1]
    first: Ints = np.unique(label, return_index=True)[1]
    return first[label]
