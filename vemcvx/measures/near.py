"""Pairs of boxes that meet, of two sets, whatever their sizes and shapes.

Boxes are sorted into classes by width and height, powers of four apart. Boxes of two classes can only meet if their
centres are, along each axis, no farther apart than the largest half-widths of both; in units of that sum this is a ball
of the maximum norm, and a search in two k-d trees. A single radius for all would pair every small box of a graded mesh
with everything around, and a single unit for both axes every box of a mesh of slivers with all above and below.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vemcvx.meshes.search import search_tree

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Boxes that share less than this part of the smaller one's width or height only touch.
TOUCH = 1e-12


def meeting_boxes(first: tuple[Floats, Floats], second: tuple[Floats, Floats]) -> tuple[Ints, Ints]:
    """Which boxes of two sets share more than a side.

    Parameters
    ----------
    first, second : pairs of (n, dim) arrays
        Lower and upper corners.

    Returns
    -------
    (k,) and (k,) arrays of int
        The pairs, as numbers in the first and in the second set.
    """
    found = [np.zeros((2, 0), dtype=np.int64)]
    origin = first[0].min(axis=0)
    classes = list(_classes(*second))
    for members, reach in _classes(*first):
        for others, other_reach in classes:
            unit = reach + other_reach
            tree, other = (
                search_tree((0.5 * (low[some] - origin) + 0.5 * (high[some] - origin)) / unit)
                for (low, high), some in ((first, members), (second, others))
            )
            # The radius is rounded up: a centre that is just too far to the last bit is still a candidate.
            near = tree.sparse_distance_matrix(other, 1.0 + 1e-9, p=np.inf, output_type="ndarray")
            found.append(np.stack([members[near["i"]], others[near["j"]]]))
    i, j = np.concatenate(found, axis=1)
    shared = np.minimum(first[1][i], second[1][j]) - np.maximum(first[0][i], second[0][j])
    smaller = np.minimum((first[1] - first[0])[i], (second[1] - second[0])[j])
    meet = (shared > TOUCH * smaller).all(axis=1)
    return i[meet], j[meet]


def _classes(low: Floats, high: Floats) -> Iterator[tuple[Ints, Floats]]:
    """The boxes of each class of widths: their numbers, and the largest half-width along each axis (dim,)."""
    half = 0.5 * (high - low)
    level = np.floor(0.5 * np.log2(half / half.max(axis=0)))
    _, which = np.unique(level, axis=0, return_inverse=True)
    which = which.ravel()
    for value in range(int(which.max()) + 1):
        members = np.flatnonzero(which == value)
        yield members, half[members].max(axis=0)
