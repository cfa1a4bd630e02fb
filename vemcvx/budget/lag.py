"""What backward Euler misses between two instants.

Let U be linear between the states of the steps, and so the multipliers lam and the weights w of the norm terms. For
loads linear in time

    a(u - U, u' - U') <= (1 - s) (w_{n-1} |S'| - lam_{n-1} . S'),      s in (0, 1) the part of step n that has passed,

with S' the rate of slip in step n: all that is used of the true friction is |lam| <= w and lam . S' <= w |S'|.
Integrated over all steps, with S_n the slip increment,

    |u(t_n) - u_n|_a^2 <= |u(0) - u_0|_a^2 + sum over steps of (w_{n-1} |S_n| - lam_{n-1} . S_n).

After Nochetto, Savare and Verdi, *A posteriori error estimates for variable time-step discretizations of nonlinear
evolution equations* (Comm. Pure Appl. Math. 53, 2000). A step lags where something slips that was held back less, or
the other way, when it began: at the onset of slip and at reversals; where the load goes on as before there is no
error. Limits have no such theorem; the change of their force times their motion stands for it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vemcvx.stepping.trajectory import Trajectory

Floats = NDArray[np.float64]


def lagged(run: Trajectory) -> Floats:
    """(N,) what each step adds to the square of the error, energy times two."""
    return np.maximum(run.lag[1:], 0.0)
