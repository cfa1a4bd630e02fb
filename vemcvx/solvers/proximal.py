"""The safeguard: the proximal point method on the multipliers, each step by a line-searched Newton method.

With centre lam and shifts c > 0, minimise the convex, continuously differentiable function

    psi(d) = 1/2 d'Kd - g'd + sum_i [ |q_i|^2 - (|q_i| - w_i)_+^2 - |lam_i|^2 ] / (2 c_i),   q = lam + c (Bd - b)

(the norms replaced by Moreau envelopes), whose gradient is K d - g + B'P_w(q), then move the centre to
P_w(q). The outer iteration is Rockafellar's proximal point algorithm on the dual (SIAM J. Control Optim. 14,
1976), which converges from any centre and for any c; the inner one is a semismooth Newton method with
Armijo's rule on a strongly convex function (Li, Sun and Toh, SIAM J. Optim. 28, 2018), which converges
from any start, and in finitely many steps where the envelope is piecewise quadratic (block 1).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.program import StepProgram

Floats = NDArray[np.float64]

ARMIJO = 1e-4
GROWTH = 4.0
"""Shifts grow from centre to centre; the method converges for any, faster for larger ones."""
MOST_INNER = 60


def proximal_points(
    program: StepProgram, d: Floats, lam: Floats, shift: Floats
) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Yield (d, lam, shift) after every Newton step, centre after centre, for ever; the caller stops."""
    lam = program.project(lam)
    while True:
        for _ in range(MOST_INNER):
            d, moved = _newton_step(program, d, lam, shift)
            yield d, _multiplier(program, d, lam, shift), shift
            if not moved:
                break
        lam = _multiplier(program, d, lam, shift)
        shift = GROWTH * shift


def _multiplier(program: StepProgram, d: Floats, lam: Floats, shift: Floats) -> Floats:
    return program.project(lam + shift[:, None] * program.slip(d))


def _newton_step(program: StepProgram, d: Floats, lam: Floats, shift: Floats) -> tuple[Floats, bool]:
    """One damped Newton step on psi; also whether it moved by more than rounding."""
    q = lam + shift[:, None] * program.slip(d)
    gradient = -program.residual(d, program.project(q))
    every = np.arange(len(d))
    step = program.form.factor.within(_hessian(program, q, shift), every).solve(-gradient)
    slope = float(gradient @ step)
    start = _psi(program, d, lam, shift)
    if -slope <= 4 * np.finfo(float).eps * abs(start):
        return d + step, False
    length = 1.0
    while _psi(program, d + length * step, lam, shift) > start + ARMIJO * length * slope and length > 1e-12:
        length *= 0.5
    return d + length * step, True


def _hessian(program: StepProgram, q: Floats, shift: Floats) -> Floats | sp.csr_matrix:
    """K + B'HB with H_i = c on sticking blocks, c (w/|q|)(I - qq'/|q|^2) on slipping ones."""
    form = program.form
    size = np.linalg.norm(q, axis=1)
    slip = size > program.w
    share = np.ones_like(size)
    share[slip] = program.w[slip] / size[slip]
    unit = np.zeros_like(q)
    unit[slip] = q[slip] / size[slip, None]
    tangential = np.eye(form.block) - np.einsum("ij,ik->ijk", unit, unit)
    return form.stiffened((shift * share)[:, None, None] * tangential)


def _psi(program: StepProgram, d: Floats, lam: Floats, shift: Floats) -> float:
    q = np.linalg.norm(lam + shift[:, None] * program.slip(d), axis=1)
    envelope = (q * q - np.maximum(q - program.w, 0.0) ** 2 - np.einsum("ij,ij->i", lam, lam)) / (2 * shift)
    return float(0.5 * d @ (program.form.K @ d) - program.g @ d + envelope.sum())
