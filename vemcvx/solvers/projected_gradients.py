"""Projected gradients on multipliers: which discs stick and slip and where to, before any system is factorised.

The dual of a step's program in the multipliers x = (lam, p) of the rows A = [B; D] is to minimise

    1/2 x'(W + C) x - x'(A K^{-1} g - [b; e])        |lam_i| <= w_i,  p >= 0,        W = A K^{-1} A',

C being the compliances of limits. A gradient step on it is the projection of x - a ((W + C) x - A K^{-1} g + [b; e]) on
discs and half lines, and costs one product with a matrix of as many rows as A. Its length a is one over what W + C is
along the last step dx, dx'dx / dx'(W + C) dx once and dx'(W + C) dx / |(W + C) dx|^2 twice in turns (Barzilai and
Borwein 1988; Dai and Fletcher 2005): the function may rise, and some thirty steps tell the sets. Once each takes a
twentieth more of them. Where weights follow p each
projection is on discs of the radius w(p): that is no minimisation, and the fixed points are the solutions of Coulomb's
law (:mod:`vemcvx.solvers.coulomb`). Nothing is proven here; what sets lead to is.

Units: x_i in those of u_i, alike in a block, in which W + C has a diagonal near one.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import EPS
from vemcvx.program.operators import PressureLaw, product
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.solver import Iterate

SWEEPS = 100
"""Projected gradients at most."""
SWEPT = 1e-7
"""Part of the multipliers below which a change by a sweep is the last. Where 1,089 discs press on a plane under
Coulomb's law sixteen steps took 902 sweeps and 20 systems, all of which prove what they find; with 1e-6 they took 670
and 27, with 1e-5 some 400 and 36, and a system of all of them costs more than 60 sweeps. Given weights need no proof,
and half as many digits tell their sets: 16 steps of 289 discs took .075 s with 1e-3 and 1e-4, and .118 s with 1e-7."""
NONE = 1e-300
"""Added to squares of lengths that are divided by."""


def swept(program: StepProgram, law: PressureLaw, start: Iterate, part: float = SWEPT) -> Iterate:
    """A point near a solution of the step whose weights follow the law, to a part of its multipliers."""
    operators, (unit, softness) = program.operators, program.operators.softness
    norms, limits, block = slice(len(program.b)), slice(len(program.b), None), operators.block
    piece, disc, press = law.piece(start.p), unit[norms][::block], unit[limits]
    follow, free, parts = piece.slope.read, operators.factor.solve(program.g), np.ones(block)
    without = (piece.weights - follow(piece.forces)) / disc
    ahead = unit * np.append(program.slip(free), program.excess(free))
    x = np.append(start.lam, start.p) / unit
    off = product(softness, x) - ahead
    step, turn = off, product(softness, off)
    for sweep in range(SWEEPS):
        size, bent = step @ step, step @ turn
        if bent <= EPS * size:
            break  # Rows that follow from others: nothing yields to this.
        last, x = x, x - (size / bent if sweep % 3 == 0 else bent / (turn @ turn)) * off
        lam, p = x[norms].reshape(-1, block), x[limits]
        np.maximum(p, 0.0, out=p)
        bound = np.maximum(without + follow(press * p) / disc, 0.0)
        lam *= np.minimum(bound / np.sqrt(lam**2 @ parts + NONE), 1.0)[:, None]
        step = x - last
        if step @ step <= part**2 * (x @ x):
            break
        before, off = off, product(softness, x) - ahead
        turn = off - before
    x = unit * x
    lam, p = operators.blocks(x[norms]), x[limits]
    return Iterate(operators.factor.solve(program.g - program.multiplier_force(lam, p)), lam, p)
