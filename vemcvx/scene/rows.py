"""Rows of contact: conditions at nodes, on the displacement of a node or on its jump to a node of another body.

A row reads n . u(i) against an obstacle, n . (u(i) - u(j)) between bodies, with n the outward normal of the first;
likewise along tangents. It owns ends of edges at its node, each with half the edge's length: int phi_i over that edge.
Rows of several parts that make one term own the union of their ends, an edge that two parts share counts once, and a
row bears the part of another's force that is the share of the other's length that both own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Floats, Ints
from vemcvx.effects import ContactSurface, Support
from vemcvx.meshes.polygons import found_in
from vemcvx.vem.boundary import DIRECTION_TOLERANCE


def pairs_of(parts: Sequence[ContactSurface | Support]) -> tuple[Ints, Ints]:
    """Return the nodes (m,) of the rows of all parts, one part after the other, and their partners (m,), or -1."""
    none = np.zeros(0, dtype=np.int64)
    alone = [np.full(len(part.nodes), -1) if part.partners is None else part.partners for part in parts]
    return np.concatenate([none, *(part.nodes for part in parts)]), np.concatenate([none, *alone])


def pair_numbers(nodes: Ints, partners: Ints, largest: int) -> Ints:
    """One number (m,) for each pair of node and partner, ordered by node; `largest` is that of all nodes."""
    return nodes * (largest + 2) + partners + 1


def distinct_pairs(nodes: Ints, partners: Ints) -> tuple[Ints, Ints]:
    """The first row of each pair of node and partner, ordered by node, and the pair of each row (m,)."""
    numbers = pair_numbers(nodes, partners, int(partners.max(initial=0)))
    _, first, pair = np.unique(numbers, return_index=True, return_inverse=True)
    return first, pair


def jump_rows(nodes: Ints, partners: Ints, directions: Floats, points: Floats) -> sp.csr_matrix:
    """(m * q, n_u) the matrix of d . jump, for q directions (m, q, dim) a row."""
    m, q, dim = directions.shape
    columns = np.repeat(nodes[:, None] * dim + np.arange(dim), q, axis=0).ravel()
    indptr = np.arange(0, m * q * dim + 1, dim)
    own = sp.csr_matrix((directions.ravel(), columns, indptr), shape=(m * q, points.size))
    joined = np.flatnonzero(partners >= 0)
    if len(joined) == 0:
        return own
    other = jump_rows(partners[joined], np.full(len(joined), -1), directions[joined], points)
    return sp.csr_matrix(own - summing((joined[:, None] * q + np.arange(q)).ravel(), m * q) @ other)


def summing(group: Ints, count: int) -> sp.csr_matrix:
    """(count, k) the matrix that adds up rows (k, ...) of one group, their number below `count`."""
    return sp.csr_matrix((np.ones(len(group)), (group, np.arange(len(group)))), shape=(count, len(group)))


@dataclass(frozen=True, kw_only=True)
class ContactRows:
    """Rows of contact: of one table of a scene's surfaces, frictions and obstacles, joined where they are one."""

    nodes: Ints  # (m,) the nodes on which rows act; on their partners they act the other way
    partners: Ints  # (m,) nodes of other bodies; -1 where a row reads its node alone
    normals: Floats  # (m, dim) outward unit normals
    ends: sp.csr_matrix  # (m, e) the half lengths of the ends of edges that each row owns
    names: Ints  # (e, 2) of each end its node, and the other node of its edge; -1 for all of a part without `ends`

    @classmethod
    def of(cls, parts: Sequence[ContactSurface], dim: int) -> ContactRows:
        """The rows of all parts, one after the other."""
        nodes, partners = pairs_of(parts)
        row, beyond, half, first = [nodes[:0]], [nodes[:0]], [np.zeros(0)], 0
        for part in parts:
            own = part.ends
            row.append(first + (np.arange(len(part.nodes)) if own is None else own.row))
            beyond.append(np.full(len(part.nodes), -1) if own is None else own.beyond)
            half.append(part.lengths if own is None else own.lengths)
            first += len(part.nodes)
        rows = np.concatenate(row)
        names = np.column_stack([nodes[rows], np.concatenate(beyond)])
        names, column = np.unique(names, axis=0, return_inverse=True)
        ends = sp.csr_matrix((np.concatenate(half), (rows, column.ravel())), shape=(len(nodes), len(names)))
        normals = np.concatenate([np.zeros((0, dim)), *(part.normals for part in parts)])
        return cls(nodes=nodes, partners=partners, normals=normals, ends=ends, names=names)

    def __len__(self) -> int:
        return len(self.nodes)

    def __getitem__(self, rows: Ints | slice) -> ContactRows:
        picked = {name: column if name == "names" else column[rows] for name, column in self.columns.items()}
        return ContactRows(**picked)

    def owners(self, of: Ints) -> Ints:
        """(e,) the number in `of` (m,) of the row that owns each end; -1 where none of these rows does."""
        each, found = self.ends.tocoo(), np.full(len(self.names), -1)
        found[each.col] = of[each.row]
        return found

    @property
    def columns(self) -> dict[str, Any]:
        """The columns of the table, of which records of terms and limits are made."""
        return {name: getattr(self, name) for name in ("nodes", "partners", "normals", "ends", "names")}

    @cached_property
    def lengths(self) -> Floats:
        """(m,) integrals of the nodal basis functions over the edges of each row: of all parts that meet in it."""
        return np.asarray(self.ends.sum(axis=1)).ravel().astype(float)

    def find(self, rows: ContactRows) -> Ints:
        """A row (k,) with the node and partner of each of the k `rows`; -1 where there is none."""
        largest = int(max(self.partners.max(initial=0), rows.partners.max(initial=0)))
        known, wanted = (pair_numbers(table.nodes, table.partners, largest) for table in (self, rows))
        return found_in(known, wanted)

    def matrix(self, directions: Floats, points: Floats) -> sp.csr_matrix:
        """(m * q, n_u) the matrix of d . jump, for q directions (m, q, dim) a row."""
        return jump_rows(self.nodes, self.partners, directions, points)

    def normal_rows(self, points: Floats) -> sp.csr_matrix:
        """(m, n_u) the matrix of n . jump, row by row."""
        return self.matrix(self.normals[:, None, :], points)

    def joined(self, first: Ints, group: Ints) -> ContactRows:
        """One row a group, with the node and normal of its `first` row; ends that several rows own count once."""
        each, (count, width) = self.ends.tocoo(), (len(first), self.ends.shape[1])
        key, place = np.unique(group[each.row] * width + each.col, return_inverse=True)
        length = np.zeros(len(key))
        np.maximum.at(length, place, each.data)
        ends = sp.csr_matrix((length, np.divmod(key, max(width, 1))), shape=(count, width))
        return replace(self[first], ends=ends)

    def shares(self, of: ContactRows) -> sp.csr_matrix:
        """(m, r) which share of a force on each of r rows the edges of these rows bear."""
        common = sp.csr_matrix((self.ends > 0).astype(float) @ of.ends.T)
        return sp.csr_matrix(common @ sp.diags_array(1.0 / of.lengths))


def merged(
    pairs: tuple[Ints, Ints], normals: Floats, signed: bool = False, kinds: Ints | None = None, within: float = SAME
) -> tuple[Ints, Ints]:
    """Rows of one pair, kind and normal (up to sign) are one term: its first row, and the term of every row."""
    place = distinct_pairs(*pairs)[1]
    term, first = np.full(len(place), -1), [np.zeros(0, dtype=np.int64)]
    while (left := np.flatnonzero(term < 0)).size:
        # The first row left of each pair leads; the rows that are as it is follow.
        lead, mine = np.unique(place[left], return_index=True, return_inverse=True)[1:]
        leader = left[lead][mine]
        cosine = np.einsum("ij,ij->i", normals[left], normals[leader])
        apart = np.linalg.norm(normals[left] - cosine[:, None] * normals[leader], axis=1)
        same = (apart < within) & ((cosine > 0) | (not signed))
        if kinds is not None:
            same &= kinds[left] == kinds[leader]
        term[left[same]] = mine[same] + sum(map(len, first))
        first.append(left[lead])
    return np.concatenate(first), term


def straightened(supports: Sequence[Support], parts: Sequence[Any]) -> list[Any]:
    """Return the parts of contact, whose normals at a node are those of a support, or of an earlier part, if near.

    Supports that hold a node altogether give it none: theirs are axes, as a rule, and along these a node that is lifted
    off a floor half a degree askew would rub on it by a hundredth of the way.
    """
    if not parts:
        return []
    everything = (*supports, *parts)
    each = np.concatenate([*(one.directions for one in supports), *(part.normals for part in parts)])
    pairs, given = pairs_of(everything), sum(len(one.nodes) for one in supports)
    place, lead = distinct_pairs(*pairs)[1], merged(pairs, each, within=DIRECTION_TOLERANCE)[0]
    altogether = np.bincount(place[lead[lead < given]], minlength=len(place)) >= each.shape[1]
    of_those = np.where(np.arange(len(place)) < given, altogether[place], 0)
    first, group = merged(pairs, each, kinds=of_those, within=DIRECTION_TOLERANCE)
    straight = each[first][group]
    straight *= np.sign(np.einsum("ij,ij->i", each, straight))[:, None]
    turned = np.linalg.norm(each - straight, axis=1) > SAME
    normals = np.split(np.where(turned[:, None], straight, each), np.cumsum([len(part.nodes) for part in everything]))
    return [replace(part, normals=own) for part, own in zip(parts, normals[len(supports) :], strict=False)]


def along(tangents: Floats, vectors: Floats) -> Floats:
    """(k * (dim - 1),) the components of vectors (k, dim) along the tangents (k, dim - 1, dim) of each row."""
    return np.einsum("kbd,kd->kb", tangents, vectors).ravel()
