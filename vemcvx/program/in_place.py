"""Sticking terms and acting limits, put exactly in place and paid for in the certificate.

The gap is linear in a slip that should be none: with |lam| < w it is w|s| - lam.s, 1e-16 for a slip of that size, and
the error that it certifies is the root, 1e-8. Where a row reads one unknown of its own such slips are exact zeros;
where it reads several, rounding leaves them. They are paid for quadratically instead:

    Theorem.  For every field v and admissible lam, p, |r|^2 = r'K^{-1}r of the residual at d, and T(v) the parts of
    norm terms and limits in the gap at d - v, which has the slips s - B v and the excesses z - D v,

        |d - d*|_K <= 2 |v|_K + sqrt(|r|^2 + 2 T(v)).

Proof. |d - d*|_K <= |v|_K + |d - v - d*|_K. The residual at d - v is r + K v, and 1/2 |d - v - d*|_K^2 <=
1/2 |r + K v|^2 + T(v) by the theorem of :mod:`vemcvx.program.certificate`, with |r + K v| <= |r| + |K v| =
|r| + |v|_K; at last sqrt((a + b)^2 + c) <= b + sqrt(a^2 + c).  QED

No assumption is made about v, nor about which rows are in place: with v = 0 it is the gap itself, and the smaller bound
is taken. v is chosen such that A v = x on the rows A of terms that seem to stick and of limits that seem to act, x
their slips s and their excesses z - c p over what they press (soft limits; of bounds, z):

    v = K^{-1}A'y,   W y = x,   W = A K^{-1}A',      so that  |v|_K^2 = x'W^{-1}x.

Rows that depend on others make W singular. Least squares then puts in place what can be; what cannot stays in T, where
it counts linearly, as do the slips of all other terms after the move. A row seems to stick or act if its part of the
gap is at least x_i^2 / f_i, f_i = W_ii, the energy that it costs to put it alone in place (those in place already do),
and if x_i is rounding: larger slips are for solvers to mend, and the gap stays primal minus dual objective.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import EPS, Bools, Floats, lengths
from vemcvx.program.certificate import limit_gaps, norm_gaps
from vemcvx.program.operators import Operators, energy_norm

Parts = tuple[Floats, Floats]
"""Of norm terms (m,) and of limits (r,) in the gap."""
SLIP_ROUNDING = 1e-13
"""Part of |A_i||d| + |b_i|: sums of a few hundred products, and what a solve leaves of its equations."""
INDEPENDENT = 1e-12
"""Of W's singular values, the part of the largest below which rows depend on others."""


def put_in_place(
    operators: Operators,
    parts: Parts,
    *,
    at: tuple[Floats, Floats, Floats],
    slip: Floats,
    excess: Parts,
    read: tuple[Floats, Floats, Floats],
) -> tuple[float, Parts]:
    """2 |v|_K, and the parts of the gap at d - v.

    Parameters
    ----------
    operators : Operators
    parts : (m,) and (r,) arrays
        Of the gap at d.
    at : (m,), (m, block) and (r,) arrays
        Weights w, and admissible multipliers lam and p.
    slip : (m, block) array
    excess : (r,) arrays
        z, and its rounding.
    read : (n,), (m * block,) and (r,) arrays
        d, b and e: slips are B d - b, excesses D d - e.
    """
    (w, lam, p), (z, blur), (d, b, e) = at, excess, read
    over = z - operators.compliance * p
    x = np.concatenate([slip.ravel(), over])
    cost = parts[0], np.where(operators.compliance > 0, parts[1], p * np.abs(z))
    pairs = (operators.rows, b), (operators.limits, e)
    size = np.concatenate([rows.absolute.read(np.abs(d)) + np.abs(offset) for rows, offset in pairs])
    held = (np.abs(x) <= SLIP_ROUNDING * size) & _in_place(operators, cost, slip, over)
    if not held.any():
        return 0.0, parts
    A = sp.vstack([operators.B, operators.D], format="csr")[held]
    x = x[held]
    spread = operators.factor.solve(A.T.toarray())
    W = A @ spread
    v = np.zeros(len(d))
    for _ in range(2):  # The second time for what the first one's rounding has left.
        v = v + spread @ np.linalg.lstsq(W, x - A @ v, rcond=INDEPENDENT)[0]
    s, moved = slip - operators.blocks(operators.B @ v), operators.D @ v
    blur = blur + EPS * len(v) * (abs(operators.D) @ np.abs(v))
    found = norm_gaps(w, lam, s), limit_gaps(operators.compliance, p, z - moved, blur)
    return 2.0 * energy_norm(operators.K, v), found


def _in_place(operators: Operators, cost: Parts, slip: Floats, over: Floats) -> Bools:
    """(m * block + r,) the rows of norm terms that seem to stick, and of limits that seem to act.

    Of bounds the cost is p|z| on either side: within its rounding an excess has no part in the gap.
    """
    sticks = lengths(slip) ** 2 <= cost[0] * operators.norm_flexibility
    acts = over**2 <= cost[1] * operators.limit_flexibility
    return np.concatenate([np.repeat(sticks, operators.block), acts])
