"""Sums of local matrices into one sparse matrix, by counting sorts instead of a sort of all triples.

The pattern lives on nodes: an entry (i, j) is a dim x dim block. Every pair of vertices of every cell is one
contribution; two stable counting sorts (by column, then by row) bring the contributions to one block
together, in the order of cells. The blocks (i, j) and (j, i) are then sums of the same numbers in the same
order: local matrices that are symmetric to the bit give a global one that is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isqrt

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.vem.space import Space

# 2^16 numbers of eight bytes and a few temporaries of that size stay in a second-level cache.
CHUNK = 2**16
TRIED = 64
"""Cells by which it is seen whether many are translates of others: to find which costs a fifth of a local matrix."""


def assemble_cells(
    space: Space, local: Callable[..., Floats], filled: Bools, moduli: Sequence[Floats]
) -> sp.csr_matrix:
    """Sum of local matrices: `local` gives those of a piece of a group and its moduli, (c, n, n, dim, dim).

    Cells (n_cells,) that are not `filled` have none, where any are. `moduli` are arrays (n_cells, ...). Cells that are
    translates of each other, to the bit, and have the same share one matrix; mirror images have one of their own, which
    is one more in a piece of thousands.
    """
    partly = filled.any() and not filled.all()
    groups = [group.part(np.flatnonzero(filled[group.cells])) if partly else group for group in space.groups]
    dim = space.mesh.points.shape[1]
    found, which, first = list[Floats](), list[Ints](), 0
    for group in groups:
        for chunk in group.chunks(CHUNK):
            pairs = chunk.nodes.shape[1] ** 2
            own = [each[chunk.cells] for each in moduli]
            some, same = distinct([*chunk.shapes, *own])
            found.append(local(chunk.part(some), *(each[some] for each in own)).reshape(-1, dim * dim))
            which.append((first + pairs * same.astype(np.int32)[:, None] + np.arange(pairs, dtype=np.int32)).ravel())
            first += len(found[-1])
    return assemble([group.nodes for group in groups], np.concatenate(found), np.concatenate(which), space.mesh.n_nodes)


def distinct(arrays: Sequence[Floats]) -> tuple[Ints | slice, Ints]:
    """Places of one each of the rows of arrays (c, ...) that differ, and (c,) which of them a row is.

    All are taken for different where many are.
    """
    every = np.arange(len(arrays[0]))
    if all((each == each[:1]).all() for each in arrays):
        return slice(1), np.zeros_like(every)
    rows = np.hstack([each.reshape(len(each), -1) for each in arrays])
    if len(np.unique(rows[:TRIED], axis=0)) > TRIED // 2:
        return slice(None), every
    # Of their bits, modulo 2^64: sums of numbers would be equal where these differ by rounding.
    weights = np.random.default_rng(0).integers(2**64, size=rows.shape[1], dtype=np.uint64) | np.uint64(1)
    hashes = (rows.view(np.uint64) * weights).sum(axis=1)
    _, some, same = np.unique(hashes, return_index=True, return_inverse=True)
    return (some, same) if (rows == rows[some[same]]).all() else (slice(None), every)


def assemble(nodes: Sequence[Ints], blocks: Floats, which: Ints, n_nodes: int) -> sp.csr_matrix:
    """Add up blocks that couple the vertices of cells; column indices are sorted, without duplicates.

    `nodes` are the vertices (c, n) of the cells, one array a number of vertices; `which` (pairs,) of the `blocks` (k,
    dim^2) are added: arrays of `nodes` in turn, cell by cell, vertex i by vertex j.
    """
    small = [group.astype(np.int32) for group in nodes]  # half the memory traffic; enough for 2e9 nodes
    rows = np.concatenate([np.repeat(group, group.shape[1]) for group in small])
    columns = np.concatenate([np.tile(group, group.shape[1]).ravel() for group in small])
    order = _counting_sort(columns, n_nodes)
    order = order[_counting_sort(rows[order], n_nodes)]
    columns, begins = columns[order], np.ones(len(order), dtype=bool)
    np.not_equal(columns[1:], columns[:-1], out=begins[1:])
    ends = np.cumsum(sum(group.shape[1] * np.bincount(group.ravel(), minlength=n_nodes) for group in small))
    indptr = np.append(0, ends)
    begins[indptr[:-1][np.diff(indptr) > 0]] = True
    first = np.flatnonzero(begins)
    gather = sp.csr_matrix(
        (np.ones(len(order)), which[order], np.append(first, len(order))), shape=(len(first), len(blocks))
    )
    indptr = np.searchsorted(first, indptr)
    dim = isqrt(blocks.shape[1])
    shape = (dim * n_nodes, dim * n_nodes)
    return sp.bsr_matrix(((gather @ blocks).reshape(-1, dim, dim), columns[first], indptr), shape=shape).tocsr()


def _counting_sort(keys: Ints, n: int) -> Ints:
    """Stable argsort of integers below n in linear time: the rows of a column-wise copy of a one-entry-a-row matrix."""
    m = len(keys)
    columns = sp.csr_matrix((np.empty(m, dtype=np.int8), keys, np.arange(m + 1)), shape=(m, n)).tocsc()
    return np.asarray(columns.indices)
