"""Which cells to refine, and which steps to split.

Cells: the smallest set that carries a given part theta of the squared indicators (Dorfler, *A convergent adaptive
algorithm for Poisson's equation*, SIAM J. Numer. Anal. 33, 1996). Where less is enough to reach the target, less is
taken: the squared indicator of a cell drops to a quarter when it is split in four, as h^2 does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

GAIN = 0.75
"""Part of its squared indicator that a smooth cell loses when it is split."""
MARGIN = 0.9
"""Of the target: what the last pass aims at, so that it need not be followed by another."""
MOST_PARTS = 100
"""A step is split into in one pass: beyond, the lag of a single long step says little about that of its parts."""


def cells_to_refine(squares: Floats, goal: float, theta: float) -> Bools:
    """The cells whose squared indicators make up `theta` of the sum, or fewer if these reach the goal.

    Parameters
    ----------
    squares : (n_cells,) array
    goal : float
        The sum that is wanted.
    theta : float
        In (0, 1).
    """
    total = float(squares.sum())
    excess = (total - MARGIN**2 * goal) / (GAIN * total) if total > 0 else 0.0
    return _largest(squares, min(theta, max(excess, 0.0)))


def steps_to_split(lags: Floats, goal: float) -> Ints:
    """Into how many equal parts to split each step, (N,), so that the lags add up to no more than the goal.

    The error is of first order, so m parts together have 1/m^2 of the lag of the whole (seen: 16 parts, 1/280). For a
    given sum the fewest parts then go with the third root.
    """
    wanted = MARGIN**2 * goal
    if lags.sum() <= wanted:
        return np.ones(len(lags), dtype=np.int64)
    root = np.cbrt(lags)
    parts = np.round(root * np.sqrt(root.sum() / wanted))
    if (lags / np.maximum(parts, 1.0) ** 2).sum() > goal:
        parts = np.ceil(root * np.sqrt(root.sum() / wanted))
    return np.clip(parts, 1, MOST_PARTS).astype(np.int64)


def _largest(values: Floats, part: float) -> Bools:
    """The fewest entries that make up this part of the sum."""
    if part <= 0.0:
        return np.zeros(len(values), dtype=bool)
    order = np.argsort(-values, kind="stable")
    sums = np.cumsum(values[order])
    count = int(np.searchsorted(sums, part * sums[-1])) + 1
    chosen = np.zeros(len(values), dtype=bool)
    chosen[order[:count]] = True
    return chosen
