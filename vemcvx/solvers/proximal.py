"""The safeguard: the proximal point method on the multipliers, each step by a line-searched Newton method.

With centre (lam, p) and shifts a > 0, minimise the convex, continuously differentiable function

    psi(d) = 1/2 d'Kd - g'd + sum_i [ |q_i|^2 - (|q_i| - w_i)_+^2 - |lam_i|^2 ] / (2 a_i)    q = lam + a (Bd - b)
             + sum_j [ (x_j)_+^2 / (1 + a_j c_j) - p_j^2 ] / (2 a_j)                         x = p + a (Dd - e)

(every term replaced by its Moreau envelope), whose gradient is K d - g + B'P_w(q) + D' x_+ / (1 + a c), then move the
centre to (P_w(q), x_+ / (1 + a c)). The outer iteration is Rockafellar's proximal point algorithm on the dual (SIAM
J. Control Optim. 14, 1976), which converges from any centre and for any a; the inner one is a semismooth Newton
method with Armijo's rule on a strongly convex function (Li, Sun and Toh, SIAM J. Optim. 28, 2018), which converges
from any start, and in finitely many steps where the envelope is piecewise quadratic (block 1).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vemcvx.arrays import EPS, Floats
from vemcvx.linear import Matrix
from vemcvx.program.norms import transverse
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.sets import Iterate, Shifts

ARMIJO = 1e-4
GROWTH = 4.0
"""Shifts grow from centre to centre; the method converges for any, faster for larger ones."""
MOST_GROWTH = 1e8
"""Beyond this, a B'B in the Hessian would leave K no digits."""
MOST_INNER = 60
INNER = 0.01
"""Newton's decrement squared, in parts of how far the centre would move, after which the next centre is wanted: with
Rockafellar's criterion (B) the outer iteration then converges as fast as with exact minimisers."""
SHORTEST = 1e-12
LEVEL = 64 * EPS
"""Part of a value within which another is the same but for rounding."""


def proximal_points(program: StepProgram, start: Iterate, shift: Shifts) -> Iterator[tuple[Iterate, Shifts]]:
    """Yield a point and its shifts after every Newton step, centre after centre, for ever; the caller stops."""
    grown = 1.0
    centre = Iterate(start.d, program.project(start.lam), np.maximum(start.p, 0.0))
    while True:
        d = centre.d
        for _ in range(MOST_INNER):
            d, moved = _newton_step(program, d, centre, shift)
            yield Iterate(d, *_multipliers(program, d, centre, shift)), shift
            if not moved:
                break
        centre = Iterate(d, *_multipliers(program, d, centre, shift))
        if grown < MOST_GROWTH:
            grown, shift = GROWTH * grown, shift * GROWTH


def _unprojected(program: StepProgram, d: Floats, centre: Iterate, shift: Shifts) -> tuple[Floats, Floats]:
    return centre.lam + shift.norms[:, None] * program.slip(d), centre.p + shift.limits * program.excess(d)


def _multipliers(program: StepProgram, d: Floats, centre: Iterate, shift: Shifts) -> tuple[Floats, Floats]:
    q, x = _unprojected(program, d, centre, shift)
    return program.project(q), np.maximum(x, 0.0) / (1.0 + shift.limits * program.operators.compliance)


def _newton_step(program: StepProgram, d: Floats, centre: Iterate, shift: Shifts) -> tuple[Floats, bool]:
    """One damped Newton step on psi; also whether another one is worth its while at this centre.

    Armijo's rule ends the halving of the step. Where it asks for less than the rounding of psi, derivatives along the
    step tell: psi is convex, so psi(d + v) - psi(d) <= (psi'(d + v / 2) + psi'(d + v)) / 2 along v.
    """
    lam, p = _multipliers(program, d, centre, shift)
    gradient = -program.residual(d, lam, p)
    hessian = _hessian(program, *_unprojected(program, d, centre, shift), shift)
    step = program.operators.factor.within(hessian, np.arange(len(d))).solve(-gradient)
    slope = float(gradient @ step)
    start = _psi(program, d, centre, shift)
    if -slope <= 4 * EPS * abs(start):
        return d + step, False

    def rises(length: float) -> float:
        ahead = d + length * step
        return -float(program.residual(ahead, *_multipliers(program, ahead, centre, shift)) @ step)

    def descends(length: float) -> bool:
        if -ARMIJO * length * slope > LEVEL * abs(start):
            return _psi(program, d + length * step, centre, shift) <= start + ARMIJO * length * slope
        return 0.5 * (rises(0.5 * length) + rises(length)) <= ARMIJO * slope

    length = 1.0
    while length > SHORTEST and not descends(length):
        length *= 0.5
    near = -slope <= INNER * _moved(Iterate(d, lam, p), centre, shift)
    return d + length * step, length > SHORTEST and not near


def _moved(point: Iterate, centre: Iterate, shift: Shifts) -> float:
    """How far a centre would move, sum |dlam_i|^2 / a_i + sum dp_j^2 / a_j."""
    lam, p = point.lam - centre.lam, point.p - centre.p
    return float(np.einsum("ij,ij->i", lam, lam) @ (1 / shift.norms) + p * p @ (1 / shift.limits))


def _hessian(program: StepProgram, q: Floats, x: Floats, shift: Shifts) -> Matrix:
    """K + B'HB + D'diag D with H_i = a on sticking blocks, a (w/|q|)(I - qq'/|q|^2) on slipping ones."""
    operators = program.operators
    size = np.linalg.norm(q, axis=1)
    slip = size > program.w
    share = np.ones_like(size)
    share[slip] = program.w[slip] / size[slip]
    unit = np.zeros_like(q)
    unit[slip] = q[slip] / size[slip, None]
    pressed = np.where(x > 0, shift.limits / (1.0 + shift.limits * operators.compliance), 0.0)
    return operators.stiffened((shift.norms * share)[:, None, None] * transverse(unit), pressed)


def _psi(program: StepProgram, d: Floats, centre: Iterate, shift: Shifts) -> float:
    q, x = _unprojected(program, d, centre, shift)
    size = np.linalg.norm(q, axis=1)
    norms = size * size - np.maximum(size - program.w, 0.0) ** 2 - np.einsum("ij,ij->i", centre.lam, centre.lam)
    limits = np.maximum(x, 0.0) ** 2 / (1.0 + shift.limits * program.operators.compliance) - centre.p * centre.p
    envelopes = (norms / (2 * shift.norms)).sum() + (limits / (2 * shift.limits)).sum()
    return float(0.5 * d @ (program.operators.K @ d) - program.g @ d + envelopes)
