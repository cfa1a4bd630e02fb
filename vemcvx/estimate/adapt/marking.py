"""Which cells to refine: the largest indicators.

The smallest set that carries a given part theta of the squared indicators (Dorfler, *A convergent adaptive
algorithm for Poisson's equation*, SIAM J. Numer. Anal. 33, 1996). Where less is enough to reach the target, less is
taken: the squared indicator of a cell drops to a quarter when it is split in four, as h^2 does.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Floats

GAIN = 0.75
"""Part of its squared indicator that a smooth cell loses when it is split."""
MARGIN = 0.9
"""Of the target: what the last pass aims at, so that it need not be followed by another."""


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
    return largest(squares, min(theta, max(excess, 0.0)))


def largest(values: Floats, part: float) -> Bools:
    """The fewest entries that make up this part of the sum."""
    if part <= 0.0:
        return np.zeros(len(values), dtype=bool)
    order = np.argsort(-values, kind="stable")
    sums = np.cumsum(values[order])
    count = int(np.searchsorted(sums, part * sums[-1])) + 1
    chosen = np.zeros(len(values), dtype=bool)
    chosen[order[:count]] = True
    return chosen
