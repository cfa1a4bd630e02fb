"""Friction that depends on the pressure: a fixed point of convex programs inside each step.

With T(w) the answer of the step's convex program for the weights w, and p(T(w)) its pressures, Coulomb's law asks for

    w = law(p(T(w))),     w_{k+1} = law(p(T(w_k))),   from the pressures of the step before.

While |d_{k+1} - d_k|_K <= rate |d_k - d_{k-1}|_K, which is measured and kept in the history, the fixed point d
satisfies

    |d_k - d|_K <= (error of T(w_k)) + rate / (1 - rate) |d_k - d_{k-1}|_K.

An iterate is accepted when this is at the accuracy, or when it is certified as it stands for the weights that its own
pressures call for: the duality gap of (d_k, lam_k, p_k), lam_k made admissible for law(p_k). (That gap is linear in the
difference of the weights, its root reaches 1e-8 and no further.) The smaller of the two is its certificate. Uniqueness
and contraction hold for small coefficients (Necas, Jarusek and Haslinger 1980); nothing is claimed beyond, and an
iteration that does not contract is an error.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vemcvx.errors import NotContracting
from vemcvx.program.certificate import Certificate

if TYPE_CHECKING:
    from collections.abc import Callable

    from vemcvx.stepping.state import State

Floats = NDArray[np.float64]

MOST_PROGRAMS = 200
SLOWEST = 0.98
"""Iterations that contract more slowly than this, ten times in a row, will not get there in MOST_PROGRAMS."""
IDLE = 25
"""Programs in a row that may fail to halve the best gap: a contraction of .986 halves it in that many."""


def resolved(
    solve: Callable[[Floats], State],
    certified: Callable[[State, Floats], State],
    law: Callable[[Floats], Floats],
    distance: Callable[[State, State], float],
    accuracy: float,
    start: Floats,
    n: int,
) -> State:
    """The state whose weights are those that its own pressures call for.

    Parameters
    ----------
    solve : weights (m,) -> state
    certified : (state, weights) -> the state certified for other weights
    law : pressures (r,) -> weights
    distance : energy norm of the difference of two states
    accuracy : float
        Certified relative energy error at which to stop.
    start : (m,) array
        Weights of the first program.
    n : int
        The step, for messages.

    Raises
    ------
    NotContracting
        Successive iterates do not come closer, or too slowly.
    """
    w, before, apart, rate, slow, iterations = start, None, np.inf, np.nan, 0, 0
    least, idle = np.inf, 0
    for _ in range(MOST_PROGRAMS):
        state = solve(w)
        iterations += state.iterations
        wanted = law(state.p)
        own = certified(state, wanted)
        if before is not None:
            now = distance(state, before)
            rate = now / apart if 0 < apart < np.inf else rate
            slow, apart = slow + 1 if rate > SLOWEST else 0, now
        own = replace(_better(own, state, apart, rate), iterations=iterations, rate=rate)
        if own.accepted(accuracy):
            return own
        idle = 0 if own.certificate.gap <= 0.5 * least else idle + 1
        least = min(least, own.certificate.gap)
        if slow >= 10 or idle >= IDLE:
            break
        w, before = wanted, state
    raise NotContracting(
        f"step {n} at t = {state.t:.6g}: Coulomb's fixed point contracts with the rate {rate:.3g} only: "
        f"its certified error is "
        f"{own.certificate.error / (own.unit(accuracy) or np.inf):.1e}, asked was {accuracy:.1e}. Take a smaller "
        "coefficient, a cap, NormalCompliance in place of UnilateralContact, smaller steps, or a sharper solver "
        "(Newton).",
        step=n,
        time=state.t,
        rate=float(rate),
    )


def _better(own: State, state: State, apart: float, rate: float) -> State:
    """An iterate certified for the weights of its own pressures, or by its contraction, whichever says more."""
    if not rate < SLOWEST:
        return own
    error = state.certificate.error + apart * rate / (1.0 - rate)
    if error >= own.certificate.error:
        return own
    parts = state.certificate
    none = np.zeros_like(parts.friction), np.zeros_like(parts.limits)
    return replace(state, certificate=Certificate(0.5 * error * error, none[0], parts.floor, none[1]))
