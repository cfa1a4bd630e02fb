"""Which steps to split, and where.

A step that loses much has data that bend or jump inside it, and these are instants from then on; or it is halved. The
steps that together make up a given part of the loss are split at once: the smallest set, as of cells
(:mod:`vemcvx.estimate.adapt.marking`).
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.estimate.adapt.marking import largest
from vemcvx.estimate.budget import Finer
from vemcvx.estimate.budget.data_in_time import HAIR

SPLIT = 0.8
"""Part of the squared loss that is split at once."""
GREATLY = 4.0
"""Steps are cut into more than two at once where the error exceeds this many times what is allowed."""


def split_steps(times: Floats, finer: Finer, allowed: float) -> Floats:
    """The instants of a run, more where its steps lose most.

    Parameters
    ----------
    times : (N + 1,) array
    finer : Finer
        The run beside one in finer steps.
    allowed : float
        The energy error that is wanted.
    """
    error = float(finer.errors.max())
    lost = np.where(np.diff(times) > HAIR * (times[-1] - times[0]), finer.added, 0.0)
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
