"""Which edges contact and friction act on: parts of the boundary meet at nodes, overlap, and end inside each other.

A row, a node with a normal, owns ends of edges at its node, each with half the edge's length: int phi_i over that
edge. Rows of several parts that make one term own the union of their ends, an edge that two parts share counts once,
and what one row bears of another's force is the share of the other's length that both own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints
from vemcvx.effects import ContactSurface, Friction, Obstacle


def edge_ends(parts: Sequence[Friction | Obstacle | ContactSurface]) -> tuple[sp.csr_matrix, Ints]:
    """What the rows of all parts own, one after the other: (rows, e) half the length of each end of an edge.

    The names (e, 2) are each end's own node, and the other node of its edge; -1 for all that a part without `ends` has
    at a node.
    """
    row, name, half, count = [], [], [], 0
    for part in parts:
        if part.ends is None:
            at, beyond, length = np.arange(len(part.nodes)), np.full(len(part.nodes), -1), part.lengths
        else:
            at, beyond, length = part.ends.row, part.ends.beyond, part.ends.lengths
        row.append(count + at)
        name.append(np.column_stack([part.nodes[at], beyond]))
        half.append(length)
        count += len(part.nodes)
    if not parts:
        return sp.csr_matrix((0, 0)), np.zeros((0, 2), dtype=np.int64)
    names, column = np.unique(np.concatenate(name), axis=0, return_inverse=True)
    values = np.concatenate(half), (np.concatenate(row), column.ravel())
    return sp.csr_matrix(values, shape=(count, len(names))), names


def ends_of_groups(ends: sp.csr_matrix, group: Ints) -> sp.csr_matrix:
    """The ends that groups of rows own, (groups, e): what several rows of a group own counts once."""
    each = ends.tocoo()
    key, place = np.unique(group[each.row] * ends.shape[1] + each.col, return_inverse=True)
    length = np.zeros(len(key))
    np.maximum.at(length, place, each.data)
    where = np.divmod(key, max(ends.shape[1], 1))
    return sp.csr_matrix((length, where), shape=(group.max(initial=-1) + 1, ends.shape[1]))


def lengths_of(ends: sp.csr_matrix) -> Floats:
    """int phi_i over the edges of each row."""
    return np.asarray(ends.sum(axis=1)).ravel().astype(float)


def force_shares(by: sp.csr_matrix, force: sp.csr_matrix) -> sp.csr_matrix:
    """(rows of `by`, rows of `force`) which share of a force the edges of each row bear."""
    common = sp.csr_matrix((by > 0).astype(float) @ force.T)
    return sp.csr_matrix(common @ sp.diags_array(1.0 / lengths_of(force)))
