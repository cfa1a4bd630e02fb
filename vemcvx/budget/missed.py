"""What steps miss of the load, which backward Euler takes at their ends.

The load between, less the straight line between the ends, g(t) = l(t) - (linear), moves the answer by no more than its
variation in the dual norm (Theorem 2.5 of the paper): twice its largest value, if it rises and falls once. Loads in
proportion to time, or made of straight pieces whose bends are instants, are missed by nothing. What several steps miss
is put together as squares, like independent errors; the plain sum would be a bound, and for curved loads one of order k
for an error of order k^2.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vemcvx.program.condensation import Condensation
from vemcvx.scene.pose import Posed

Floats = NDArray[np.float64]

PROBES = (0.25, 0.5, 0.75)
ROUNDED = 8 * float(np.finfo(float).eps)


def missed_by(posed: Posed, a: float, b: float, respond: Callable[[Floats], Floats]) -> tuple[float, Floats]:
    """Twice the energy norm of the largest deviation at the probes of the step from a to b, and the response to it."""
    start, stop = posed.system.force(a), posed.system.force(b)
    largest, response = 0.0, np.zeros_like(start)
    for s in PROBES:
        g = posed.system.force(a + s * (b - a)) - ((1 - s) * start + s * stop)
        if np.abs(g).max(initial=0.0) <= ROUNDED * max(np.abs(start).max(initial=0.0), np.abs(stop).max(initial=0.0)):
            continue
        x = respond(g)
        if (square := float(g @ x)) > largest:
            largest, response = square, x
    return 2.0 * float(np.sqrt(largest)), response


def missed_loads(posed: Posed, times: Floats) -> Floats:
    """(N,) what each step misses; K is factorised only if something is."""
    factor: list[Condensation] = []

    def respond(g: Floats) -> Floats:
        if not factor:
            factor.append(Condensation(posed.system, condense=False))
        return factor[0].solve(g)

    return np.array([missed_by(posed, float(a), float(b), respond)[0] for a, b in pairwise(times)])
