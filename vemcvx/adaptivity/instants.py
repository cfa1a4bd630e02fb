"""Instants that follow the load: where it bends there has to be one.

What steps miss of it (:mod:`vemcvx.budget.missed`) is looked at step by step. A load made of straight pieces is missed
most just where it bends, and that instant is found to round-off; a curved one is halved until what is missed is small.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vemcvx.budget.missed import missed_by
from vemcvx.scene.pose import Posed

Floats = NDArray[np.float64]

NEAR = 1e-3
"""The search knows a bend to 1e-8 of the step; lines through two points on either side meet there to round-off."""
ROUNDS, MOST = 40, 4000
"""Beyond so many instants a load is not followed further: it jumps, or the accuracy asked of it is rounding."""


def follow_load(
    posed: Posed, times: Floats, allowed: float, respond: Callable[[Floats], Floats]
) -> tuple[Floats, Floats]:
    """Instants between `times` so that what steps miss of the load is together no more than `allowed`.

    Parameters
    ----------
    respond : callable
        K^{-1}, for the dual norm of a force.

    Returns
    -------
    times : (N + 1,) array
    missed : (N,) array
        Energy norm of what each step misses, doubled.
    """
    missed = {}
    for _ in range(ROUNDS):
        for ends in pairwise(times):
            if ends not in missed:
                missed[ends] = missed_by(posed, *ends, respond)
        found = np.array([missed[ends][0] for ends in pairwise(times)])
        coarse = found > allowed / np.sqrt(len(found))
        if np.linalg.norm(found) <= allowed or not coarse.any() or len(times) + coarse.sum() > MOST:
            break
        bends = [
            _bend(posed, times[n], times[n + 1], missed[times[n], times[n + 1]][1]) for n in np.flatnonzero(coarse)
        ]
        times = np.union1d(times, bends)
    return times, found


def _bend(posed: Posed, a: float, b: float, response: Floats) -> float:
    """Where the load's work on the response leaves the straight line most."""
    from scipy.optimize import minimize_scalar

    start, stop = (float(posed.system.force(t) @ response) for t in (a, b))

    def off(s: float) -> float:
        return -abs(float(posed.system.force(a + s * (b - a)) @ response) - ((1 - s) * start + s * stop))

    peak = float(minimize_scalar(off, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-9}).x)
    # Data need not exist outside the step.
    near = min(NEAR, 0.4 * peak, 0.4 * (1.0 - peak))
    far_left, left, right, far_right = (off(peak + k * near) for k in (-2, -1, 1, 2))
    rise, fall = (left - far_left) / near, (far_right - right) / near
    meet = peak
    if abs(rise - fall) > 0:
        meet += (right - left - near * (rise + fall)) / (rise - fall)
    return float(a + (meet if abs(meet - peak) < near else peak) * (b - a))
