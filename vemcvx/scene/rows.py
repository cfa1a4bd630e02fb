"""Rows of contact: linear functions of displacements u at nodes.

A node i touches an obstacle, or a *partner* node j on another body. The *jump* is u(i) at an obstacle, and
u(i) - u(j) at a partner. The row is n . jump, where n is the outward normal or a tangent at i. The *ends* of a row are
the contact edges or faces at i. The length of an end is the integral of node i's basis function over the end.
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
from vemcvx.meshes.polygons import find_in
from vemcvx.vem.boundary import DIRECTION_TOLERANCE


def pairs_of(parts: Sequence[ContactSurface | Support]) -> tuple[Ints, Ints]:
    """Return the nodes and the partners (or -1) of all rows."""
    none = np.zeros(0, dtype=np.int64)
    alone = [np.full(len(part.nodes), -1) if part.partners is None else part.partners for part in parts]
    return np.concatenate([none, *(part.nodes for part in parts)]), np.concatenate([none, *alone])


def repeat_by_row(parts: Sequence[ContactSurface | Support], numbers: Sequence[int]) -> Ints:
    """Return ``numbers[k]`` for each row of part k."""
    return np.repeat(np.array(numbers, dtype=np.int64), [len(part.nodes) for part in parts])


def slices_of(parts: Sequence[ContactSurface | Support]) -> list[slice]:
    """Return the slice of each part in the rows of all parts."""
    ends = np.cumsum([len(part.nodes) for part in parts])
    return [slice(end - len(part.nodes), end) for part, end in zip(parts, ends, strict=True)]


def pair_numbers(nodes: Ints, partners: Ints, largest: int) -> Ints:
    """Return a unique integer for each pair (node, partner), ordered by node."""
    return nodes * (largest + 2) + partners + 1


def distinct_pairs(nodes: Ints, partners: Ints) -> tuple[Ints, Ints]:
    """Return the first row of each distinct pair, and the pair of each row."""
    numbers = pair_numbers(nodes, partners, int(partners.max(initial=0)))
    _, first, pair = np.unique(numbers, return_index=True, return_inverse=True)
    return first, pair


def jump_rows(nodes: Ints, partners: Ints, directions: Floats, points: Floats) -> sp.csr_matrix:
    """Return the matrix from u to d . jump, for q directions d per row."""
    m, q, dim = directions.shape
    columns = np.repeat(nodes[:, None] * dim + np.arange(dim), q, axis=0).ravel()
    indptr = np.arange(0, m * q * dim + 1, dim)
    own = sp.csr_matrix((directions.ravel(), columns, indptr), shape=(m * q, points.size))
    joined = np.flatnonzero(partners >= 0)
    if len(joined) == 0:
        return own
    other = jump_rows(partners[joined], np.full(len(joined), -1), directions[joined], points)
    return sp.csr_matrix(own - build_summation((joined[:, None] * q + np.arange(q)).ravel(), m * q) @ other)


def build_summation(group: Ints, count: int) -> sp.csr_matrix:
    """Return the matrix that sums the rows of each group."""
    return sp.csr_matrix((np.ones(len(group)), (group, np.arange(len(group)))), shape=(count, len(group)))


@dataclass(frozen=True, kw_only=True)
class ContactRows:
    """A table of contact rows."""

    nodes: Ints  # node i of each row (m,)
    partners: Ints  # partner j of each row, or -1 (m,)
    normals: Floats  # outward unit normals (m, dim)
    ends: sp.csr_matrix  # lengths of ends (m, e)
    names: Ints  # (e, 2) node i, then the edge's other node, or in space the face; -1 if none

    @classmethod
    def from_parts(cls, parts: Sequence[ContactSurface], dim: int) -> ContactRows:
        """Return the rows of all parts."""
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

    def owners(self, values: Ints) -> Ints:
        """Return the value of the row of each end, or -1 for ends without a row."""
        each, found = self.ends.tocoo(), np.full(len(self.names), -1)
        found[each.col] = values[each.row]
        return found

    @property
    def columns(self) -> dict[str, Any]:
        """The columns of the table by name."""
        return {name: getattr(self, name) for name in ("nodes", "partners", "normals", "ends", "names")}

    @cached_property
    def lengths(self) -> Floats:
        """The lengths of rows, summed over ends."""
        return np.asarray(self.ends.sum(axis=1)).ravel().astype(float)

    def find(self, rows: ContactRows) -> Ints:
        """Return the row of this table for each pair (node, partner) of `rows`, or -1."""
        largest = int(max(self.partners.max(initial=0), rows.partners.max(initial=0)))
        known, wanted = (pair_numbers(table.nodes, table.partners, largest) for table in (self, rows))
        return find_in(known, wanted)

    def matrix(self, directions: Floats, points: Floats) -> sp.csr_matrix:
        """Return `jump_rows` of this table."""
        return jump_rows(self.nodes, self.partners, directions, points)

    def normal_rows(self, points: Floats) -> sp.csr_matrix:
        """Return the matrix from u to n . jump."""
        return self.matrix(self.normals[:, None, :], points)

    def merge(self, first: Ints, group: Ints) -> ContactRows:
        """Return one row per group, with all ends of the group."""
        each, (count, width) = self.ends.tocoo(), (len(first), self.ends.shape[1])
        key, place = np.unique(group[each.row] * width + each.col, return_inverse=True)
        length = np.zeros(len(key))
        np.maximum.at(length, place, each.data)
        ends = sp.csr_matrix((length, np.divmod(key, max(width, 1))), shape=(count, width))
        return replace(self[first], ends=ends)

    def shares(self, other: ContactRows) -> sp.csr_matrix:
        """Return the matrix that distributes forces on `other` over the rows of this table."""
        common = sp.csr_matrix((self.ends > 0).astype(float) @ other.ends.T)
        return sp.csr_matrix(common @ sp.diags_array(1.0 / other.lengths))


def merge_terms(
    pairs: tuple[Ints, Ints], normals: Floats, signed: bool = False, kinds: Ints | None = None, within: float = SAME
) -> tuple[Ints, Ints]:
    """Return the first row of each group of equal rows, and the group of each row."""
    place = distinct_pairs(*pairs)[1]
    term, first = np.full(len(place), -1), [np.zeros(0, dtype=np.int64)]
    while (left := np.flatnonzero(term < 0)).size:
        # The first remaining row of each pair begins a new group.
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


def straighten_normals(supports: Sequence[Support], parts: Sequence[Any]) -> list[Any]:
    """Replace contact normals by nearly parallel directions of earlier parts."""
    if not parts:
        return []
    everything = (*supports, *parts)
    each = np.concatenate([*(one.directions for one in supports), *(part.normals for part in parts)])
    pairs, given = pairs_of(everything), sum(len(one.nodes) for one in supports)
    place, lead = distinct_pairs(*pairs)[1], merge_terms(pairs, each, within=DIRECTION_TOLERANCE)[0]
    # At fully held nodes, coordinate axes must not replace the normal of an inclined obstacle.
    fully_held = np.bincount(place[lead[lead < given]], minlength=len(place)) >= each.shape[1]
    of_those = np.where(np.arange(len(place)) < given, fully_held[place], 0)
    first, group = merge_terms(pairs, each, kinds=of_those, within=DIRECTION_TOLERANCE)
    straight = each[first][group]
    straight *= np.sign(np.einsum("ij,ij->i", each, straight))[:, None]
    turned = np.linalg.norm(each - straight, axis=1) > SAME
    normals = np.split(np.where(turned[:, None], straight, each), np.cumsum([len(part.nodes) for part in everything]))
    return [replace(part, normals=own) for part, own in zip(parts, normals[len(supports) :], strict=False)]


def along(tangents: Floats, vectors: Floats) -> Floats:
    """Return the tangential components of vectors as one array."""
    return np.einsum("kbd,kd->kb", tangents, vectors).ravel()
