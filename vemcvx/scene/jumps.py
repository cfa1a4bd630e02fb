"""The rows of contact: the jumps of displacement that they read, their normals, and the edges on which they act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from vemcvx.arrays import Floats, Ints
from vemcvx.effects import ContactSurface, Friction, Obstacle, Support

# What rows of contact read: the displacement of a node, or its jump to a node of another body at the same place.
#
# Against an obstacle a row reads n . u(i), between bodies n . (u(i) - u(j)) with n the outward normal of the first
# body; likewise along tangents. Nodes that rows join, directly or by way of others, make a *site*: the frames that
# say which directions are held and which are free are chosen for a site as a whole (:mod:`vemcvx.scene.supports`).
# Elsewhere every node is a site of its own.


@dataclass(frozen=True)
class Jumps:
    """The nodes (m,) of rows, and their partners (m,) in other bodies; -1 where a row reads its node alone."""

    nodes: Ints
    partners: Ints

    @classmethod
    def of(cls, parts: Sequence[Friction | Obstacle | ContactSurface | Support]) -> Jumps:
        """The jumps of all rows, one part after the other."""
        none = np.zeros(0, dtype=np.int64)
        alone = [np.full(len(part.nodes), -1) if part.partners is None else part.partners for part in parts]
        return cls(np.concatenate([none, *(part.nodes for part in parts)]), np.concatenate([none, *alone]))

    def __len__(self) -> int:
        return len(self.nodes)

    def __getitem__(self, rows: Ints | slice) -> Jumps:
        return Jumps(self.nodes[rows], self.partners[rows])

    @property
    def counts(self) -> Ints:
        """(m,) how many nodes each row reads: 1 or 2."""
        return 1 + (self.partners >= 0)

    @property
    def distinct(self) -> tuple[Ints, Ints]:
        """The first row of each pair of node and partner, ordered by node, and the pair of each row (m,)."""
        _, first, pair = np.unique(self._numbers(self._largest), return_index=True, return_inverse=True)
        return first, pair

    def find(self, jumps: Jumps) -> Ints:
        """The row of each of these jumps, where no two rows are one; -1 where there is none."""
        largest = max(self._largest, jumps._largest)
        known = self._numbers(largest)
        order = np.argsort(known)
        place = np.searchsorted(known[order], wanted := jumps._numbers(largest))
        found = np.append(order, -1)[place]
        return np.where((found >= 0) & (known[found] == wanted), found, -1) if len(self) else found

    @property
    def _largest(self) -> int:
        return int(max(self.nodes.max(initial=0), self.partners.max(initial=0)))

    def _numbers(self, largest: int) -> Ints:
        """(m,) one number for each pair, ordered by node."""
        number: Ints = self.nodes * (largest + 2) + self.partners + 1
        return number

    def over(self, members: Ints, directions: Floats) -> Floats:
        """(m, k * dim) what d . jump, with d (m, dim), reads of the values of k nodes (m, k), the row's among them."""
        own, other = members == self.nodes[:, None], (members == self.partners[:, None]) & (members >= 0)
        read: Floats = (own.astype(float) - other)[:, :, None] * directions[:, None, :] + 0.0
        return read.reshape(len(self), members.shape[1] * directions.shape[1])

    def matrix(self, directions: Floats, points: Floats) -> sp.csr_matrix:
        """(m * q, n_u) the matrix of d . jump, for q directions (m, q, dim) a row."""
        m, q = directions.shape[:2]
        own = _at_nodes(self.nodes, directions, points)
        joined = np.flatnonzero(self.partners >= 0)
        if len(joined) == 0:
            return own
        other = _at_nodes(self.partners[joined], directions[joined], points)
        rows = (joined[:, None] * q + np.arange(q)).ravel()
        return sp.csr_matrix(own - summing(rows, m * q) @ other)


def summing(group: Ints, count: int) -> sp.csr_matrix:
    """(count, k) the matrix that adds up rows (k, ...) of one group, their number below `count`."""
    return sp.csr_matrix((np.ones(len(group)), (group, np.arange(len(group)))), shape=(count, len(group)))


def _at_nodes(nodes: Ints, directions: Floats, points: Floats) -> sp.csr_matrix:
    m, q, dim = directions.shape
    columns = np.repeat(nodes[:, None] * dim + np.arange(dim), q, axis=0)
    indptr = np.arange(0, m * q * dim + 1, dim)
    return sp.csr_matrix((directions.ravel(), columns.ravel(), indptr), shape=(m * q, points.size))


# Which edges contact and friction act on: parts of the boundary meet at nodes, overlap, and end inside each other.
#
# A row, a node with a normal, owns ends of edges at its node, each with half the edge's length: int phi_i over that
# edge. Rows of several parts that make one term own the union of their ends, an edge that two parts share counts
# once, and what one row bears of another's force is the share of the other's length that both own.


@dataclass(frozen=True, kw_only=True)
class ContactRows:
    """Rows of contact: a node, or a pair of nodes, with a normal, and the ends of edges on which it acts.

    One table has the rows of all surfaces, frictions and obstacles of a scene. Terms of friction and limits are rows of
    it that were joined, where they are one, and picked, where something can move.
    """

    jumps: Jumps
    normals: Floats
    """(m, dim) outward unit normals"""
    ends: sp.csr_matrix
    """(m, e) the half lengths of the ends of edges that each row owns"""
    names: Ints
    """(e, 2) of each end its node, and the other node of its edge; -1 for all that a part without `ends` has there"""

    @property
    def nodes(self) -> Ints:
        """(m,) the nodes on which rows act; on their partners they act the other way."""
        return self.jumps.nodes

    @cached_property
    def lengths(self) -> Floats:
        """(m,) integrals of the nodal basis functions over the edges of each row: of all parts that meet in it."""
        return np.asarray(self.ends.sum(axis=1)).ravel().astype(float)

    @classmethod
    def of(cls, parts: Sequence[Friction | Obstacle | ContactSurface], dim: int) -> ContactRows:
        """The rows of all parts, one after the other."""
        none, normals = np.zeros(0, dtype=np.int64), np.concatenate([np.zeros((0, dim)), *(p.normals for p in parts)])
        row, name, half, count = [none], [np.zeros((0, 2), dtype=np.int64)], [none.astype(float)], 0
        for part in parts:
            at, beyond, length = np.arange(len(part.nodes)), np.full(len(part.nodes), -1), part.lengths
            if part.ends is not None:
                at, beyond, length = part.ends.row, part.ends.beyond, part.ends.lengths
            row.append(count + at)
            name.append(np.column_stack([part.nodes[at], beyond]))
            half.append(length)
            count += len(part.nodes)
        names, column = np.unique(np.concatenate(name), axis=0, return_inverse=True)
        entries = np.concatenate(half), (np.concatenate(row), column.ravel())
        ends = sp.csr_matrix(entries, shape=(count, len(names)))
        return cls(jumps=Jumps.of(parts), normals=normals, ends=ends, names=names)

    def __len__(self) -> int:
        return len(self.jumps)

    def __getitem__(self, rows: Ints | slice) -> ContactRows:
        picked = self.jumps[rows], self.normals[rows], self.ends[rows]
        return ContactRows(jumps=picked[0], normals=picked[1], ends=picked[2], names=self.names)

    def joined(self, first: Ints, group: Ints) -> ContactRows:
        """One row a group, with the node and normal of its `first` row; ends that several rows own count once."""
        each, (count, width) = self.ends.tocoo(), (len(first), self.ends.shape[1])
        key, place = np.unique(group[each.row] * width + each.col, return_inverse=True)
        length = np.zeros(len(key))
        np.maximum.at(length, place, each.data)
        ends = sp.csr_matrix((length, np.divmod(key, max(width, 1))), shape=(count, width))
        return ContactRows(jumps=self.jumps[first], normals=self.normals[first], ends=ends, names=self.names)

    def shares(self, of: ContactRows) -> sp.csr_matrix:
        """(m, r) which share of a force on each of r rows the edges of these rows bear."""
        common = sp.csr_matrix((self.ends > 0).astype(float) @ of.ends.T)
        return sp.csr_matrix(common @ sp.diags_array(1.0 / of.lengths))

    @property
    def columns(self) -> dict[str, Any]:
        """The fields, of which records of terms and limits are made."""
        return {"jumps": self.jumps, "normals": self.normals, "ends": self.ends, "names": self.names}


@dataclass(frozen=True)
class Sites:
    """The sites of a mesh: sets of nodes whose frames are chosen together.

    Attributes
    ----------
    of_node : (n_nodes,) int
        The site of every node, numbered by their first nodes.
    sizes : tuple of (s, k) int arrays
        The nodes of all sites of k nodes, for every k that occurs, ascending.
    """

    of_node: Ints
    sizes: tuple[Ints, ...]

    @property
    def count(self) -> int:
        """The number of sites."""
        return sum(map(len, self.sizes))

    @property
    def first(self) -> Ints:
        """(count,) the first node of each."""
        return np.unique(self.of_node, return_index=True)[1]

    def members(self, sites: Ints) -> Ints:
        """(q, k) the nodes of some sites, k of the largest of these; -1 where a site has none left."""
        size = np.zeros(len(self.of_node), dtype=np.int64)
        row = np.zeros_like(size)
        for members in self.sizes:
            number = self.of_node[members[:, 0]]
            size[number], row[number] = members.shape[1], np.arange(len(members))
        found = np.full((len(sites), int(size[sites].max(initial=1))), -1)
        for members in self.sizes:
            mine = np.flatnonzero(size[sites] == members.shape[1])
            if len(mine):
                found[mine, : members.shape[1]] = members[row[sites[mine]]]
        return found

    @classmethod
    def joined_by(cls, jumps: Jumps, n_nodes: int) -> Sites:
        """The sites of nodes that rows join."""
        pairs = jumps[np.flatnonzero(jumps.partners >= 0)]
        if len(pairs) == 0:
            every = np.arange(n_nodes)
            return cls(every, (every[:, None],))
        ones = np.ones(len(pairs))
        graph = sp.csr_matrix((ones, (pairs.nodes, pairs.partners)), shape=(n_nodes, n_nodes))
        label = connected_components(graph, directed=False)[1]
        first = np.unique(label, return_index=True)[1]
        rank = np.empty(len(first), dtype=np.int64)
        rank[np.argsort(first, kind="stable")] = np.arange(len(first))
        of_node = rank[label]
        order, count = np.argsort(of_node, kind="stable"), np.bincount(of_node)
        start = np.cumsum(count) - count
        sizes = tuple(order[start[count == k][:, None] + np.arange(k)] for k in np.unique(count))
        return cls(of_node, sizes)
