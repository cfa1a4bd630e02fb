"""Projected gradients on multipliers: which discs stick and slip and where to, before any system is factorised.

The dual of a step's program in the multipliers x = (lam, p) of the rows A = [B; D] is to minimise

    1/2 x'(W + C) x - x'(A K^{-1} g - [b; e])        |lam_i| <= w_i,  p >= 0,        W = A K^{-1} A',

C being the compliances of limits. A gradient step on it is the projection of x + t (A K^{-1} g - [b; e] - (W + C) x) on
discs and half lines, t <= 1 / |W + C|. It costs one product with a matrix of as many rows as A, and with momentum
(Nesterov 1983), which begins anew where it led back (O'Donoghue and Candes 2015), some thirty of them tell the sets.
Where weights follow p each projection is on discs of the radius w(p): that is no minimisation, and the fixed points are
the solutions of Coulomb's law (:mod:`vemcvx.solvers.coulomb`). Nothing is proven here; what sets lead to is.

Units: x_i in those of u_i, alike in a block, in which W + C has a diagonal near one, and the largest eigenvalue is one.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from vemcvx.program.operators import Operators, Rows
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.solver import Iterate
from vemcvx.weight_law import PressureLaw

SWEEPS = 50
"""Projected gradients at most. Of 420 discs that press on a plane under Coulomb's law eight steps took 74 systems
without, 50 after 30 of them, 31 after 100; a system costs as much as 80."""
SWEPT = 1.5e-5
"""Part of the multipliers below which a change by a sweep is the last: the sets are then those of fifty as a rule."""


def sweepable(operators: Operators) -> bool:
    """Return True if there are discs to sweep over, and K has no kernel: W is then that of a body which is held."""
    return operators.block > 1 and operators.count > 0 and operators.anchor is None and operators.factor.exact


def swept(program: StepProgram, law: PressureLaw, start: Iterate) -> Iterate:
    """A point near a solution of the step whose weights follow the law."""
    operators, (unit, descent) = program.operators, program.operators.descent
    norms, limits = slice(len(program.b)), slice(len(program.b), None)
    piece = law.scaled(1.0 / unit[norms][:: operators.block], unit[limits]).piece(start.p / unit[limits])
    follow, free = Rows(piece.slope).read, operators.factor.solve(program.g)
    without, momentum = piece.weights - follow(piece.forces), 1.0
    ahead = unit * np.append(program.slip(free), program.excess(free))
    x = y = np.append(start.lam, start.p) / unit
    for _ in range(SWEEPS):
        last, x = x, ahead + descent @ y
        lam, p = operators.blocks(x[norms]), x[limits]
        np.maximum(p, 0.0, out=p)
        w, size = without + follow(p), np.sqrt(np.einsum("ij,ij->i", lam, lam))
        np.maximum(w, 0.0, out=w)
        np.maximum(size, np.finfo(float).tiny, out=size)
        lam *= np.minimum(w / size, 1.0)[:, None]
        change = x - last
        if change @ change <= SWEPT**2 * (x @ x):
            break
        if (y - x) @ change > 0:
            momentum = 1.0
        before, momentum = momentum, 0.5 + sqrt(0.25 + momentum**2)
        y = x + (before - 1.0) / momentum * change
    x = unit * x
    lam, p = operators.blocks(x[norms]), x[limits]
    return Iterate(operators.factor.solve(program.g - program.multiplier_force(lam, p)), lam, p)
