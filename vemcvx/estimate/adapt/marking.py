"""Which cells to refine, and which steps to split: the largest indicators.

The smallest set of cells that carries a given part theta of the squared indicators (Dorfler, *A convergent adaptive
algorithm for Poisson's equation*, SIAM J. Numer. Anal. 33, 1996). Where less is enough to reach the target, less is
taken: the squared indicator of a cell drops to a quarter when it is split in four, as h^2 does.

A step that loses much has data that bend or jump inside it, and these are instants from then on; or it is halved. The
steps that together make up a given part of the loss are split at once: the smallest set, as of cells.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools, Floats
from vemcvx.estimate.budget import Finer
from vemcvx.estimate.budget.data_in_time import ACROSS

GAIN = 0.75
"""Part of its squared indicator that a smooth cell loses when it is split."""
MARGIN = 0.9
"""Of the target: what the last pass aims at, so that it need not be followed by another."""
SPLIT = 0.8
"""Part of the squared loss that is split at once."""
GREATLY = 4.0
"""Steps are cut into more than two at once where the error exceeds this many times what is allowed."""


def cells_to_refine(squares: Floats, goal: float, theta: float) -> Bools:
    """The cells whose squared indicators (n_cells,) make up `theta` of the sum, or fewer if that reaches the goal."""
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


def split_steps(times: Floats, finer: Finer, allowed: float) -> Floats:
    """The instants (N + 1,) of a run, more where its steps lose most, if its energy error is beyond the one allowed."""
    error = float(finer.errors.max())
    lost = np.where(np.diff(times) > ACROSS * (times[-1] - times[0]), finer.added, 0.0)
    if error <= allowed or not lost.any():
        return times
    marked = largest(lost**2, SPLIT)
    # Where loads are smooth the error falls with the square of the step.
    parts = 2 if error <= GREATLY * allowed else 3
    new = [times]
    for n in np.flatnonzero(marked):
        a, b = times[n], times[n + 1]
        inside = finer.bends[(finer.bends > a) & (finer.bends < b)]
        new.append(inside if len(inside) else np.linspace(a, b, parts + 1)[1:-1])
    return np.unique(np.concatenate(new))
