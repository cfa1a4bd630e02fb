"""Instants that follow the load: where it bends there has to be one.

Backward Euler takes the load at the ends of its steps. What a step misses of it, g(t) = l(t) - (linear between the
ends), moves the answer by at most the variation of g in the dual norm (Theorem 2.5 of the paper), twice its largest
value if g rises and falls once. A load made of straight pieces is missed most just where it bends, and that instant
is found to round-off; a curved one is halved until what is missed is small.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vemcvx.pose import Posed

Floats = NDArray[np.float64]

PROBES = (0.25, 0.5, 0.75)
NEAR = 1e-3
"""The search knows a bend to 1e-8 of the step; lines through two points on either side meet there to round-off."""
ROUNDS = 40


def follow_load(
    posed: Posed, times: Floats, allowed: float, respond: Callable[[Floats], Floats]
) -> tuple[Floats, Floats]:
    """Instants between `times` so that what steps miss of the load adds up to no more than `allowed`.

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
                missed[ends] = _missed(posed, *ends, respond)
        found = np.array([missed[ends][0] for ends in pairwise(times)])
        coarse = found > allowed / len(found)
        if found.sum() <= allowed or not coarse.any():
            break
        bends = [
            _bend(posed, times[n], times[n + 1], missed[times[n], times[n + 1]][1]) for n in np.flatnonzero(coarse)
        ]
        times = np.union1d(times, bends)
    return times, found


def _missed(posed: Posed, a: float, b: float, respond: Callable[[Floats], Floats]) -> tuple[float, Floats]:
    """Twice the energy norm of the largest deviation at the probes, and the response to it."""
    start, stop = posed.system.force(a), posed.system.force(b)
    largest, response = 0.0, np.zeros_like(start)
    for s in PROBES:
        g = posed.system.force(a + s * (b - a)) - ((1 - s) * start + s * stop)
        size = np.abs(g).max()
        if size <= 8 * np.finfo(float).eps * max(np.abs(start).max(), np.abs(stop).max()):
            continue
        x = respond(g)
        if (square := float(g @ x)) > largest:
            largest, response = square, x
    return 2.0 * float(np.sqrt(largest)), response


def _bend(posed: Posed, a: float, b: float, response: Floats) -> float:
    """Where the load's work on the response leaves the straight line most."""
    from scipy.optimize import minimize_scalar

    start, stop = (float(posed.system.force(t) @ response) for t in (a, b))

    def off(s: float) -> float:
        return -abs(float(posed.system.force(a + s * (b - a)) @ response) - ((1 - s) * start + s * stop))

    peak = float(minimize_scalar(off, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-9}).x)
    far_left, left, right, far_right = (off(peak + k * NEAR) for k in (-2, -1, 1, 2))
    rise, fall = (left - far_left) / NEAR, (far_right - right) / NEAR
    meet = peak
    if abs(rise - fall) > 0:
        meet += (right - left - NEAR * (rise + fall)) / (rise - fall)
    return float(a + (meet if abs(meet - peak) < NEAR else peak) * (b - a))
