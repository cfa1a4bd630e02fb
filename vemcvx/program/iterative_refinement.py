"""Iterative refinement of a step against the original K, where its factors have lost too many digits.

Near incompressibility or at high contrast the Schur complement S carries the rounding of the factorisation,
cond(K) times a unit: 1e-7 in energy at nu = .49999999. The residual of the full system, taken in extended
precision, then drives corrections with the same factors: what sticks stays, what slips moves by S_FF^{-1} r_F, the
multipliers of what sticks and the unknowns inside follow. A soft limit acts where z = D y - e > 0, and with

    r = f - B'lam - D'p - K y,    q = z_+ / c - p of soft limits,    C^{-1} of those that act,

the correction solves K dy = r - D'dp, dp = q + C^{-1} D dy, so that on the retained unknowns that are free

    (S + D'C^{-1}D) dy_c = tau_r - D'q,

and c p = z to rounding afterwards (q does not pass through K^{-1}, which weak springs make large).

On x86 a long double has 64 bits of mantissa against 53; where it is no longer than a double, the rounding unit says so
and nothing else changes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vemcvx.arrays import EPS, Bools, Floats
from vemcvx.linear import residual, sizes
from vemcvx.program.certificate import Certificate
from vemcvx.program.condensation import Condensation
from vemcvx.program.operators import Operators, restricted, transverse
from vemcvx.program.system import System
from vemcvx.program.tolerances import COARSE_FACTORS

TAIL = 175.75163111741583
"""The quotient of F's distribution with 1 and SAMPLES degrees of freedom that is exceeded once in a million, which
scipy.special.fdtri(1, SAMPLES, 1 - 1e-6) gives: importing that takes a tenth of the time of importing this package."""


def needs_refinement(condensation: Condensation, accuracy: float) -> bool:
    """Return True if one solve with the factors, or with S, errs by more than COARSE_FACTORS of `accuracy`.

    Residuals in double precision are good enough to tell. Tried on the response x to a force of one on every unknown,
    which the softest motions answer, and on the response w to S x_c: what K w is on the retained unknowns, S w_c is.
    (On x itself this would tell how well the solver holds x_c, which is known to 1e-11 only at 131k unknowns.) Where
    a sample of what solves lose leaves no doubt neither is tried.
    """
    enough = (COARSE_FACTORS * accuracy) ** 2
    operators, c, K = condensation.operators, condensation.retained, condensation.system.K
    # A solve may lose more, in squares, than a sample: on 72 systems, among them slender ones, up to 29 times.
    if 100.0 * condensation.factor.lost <= enough:
        return False
    force = _off_kernel(condensation.system, np.ones(K.shape[0]))
    x = condensation.factor.solve(force)
    left = _off_kernel(condensation.system, force - condensation.regular @ x)
    off, size = condensation.factor.energy(left), float(abs(force @ x))
    if 0 < len(c) < len(x):
        w = condensation.response(x[c])
        off = max(off, operators.factor.energy((K @ w)[c] - operators.K @ w[c]))
    return off > enough * size


def refined(
    condensation: Condensation,
    operators: Operators,
    force: Floats,
    y: Floats,
    *,
    gap: Floats,
    lam: Floats,
    p: Floats,
    stick: Bools,
    slip: Floats,
) -> tuple[Floats, Floats, Floats]:
    """All unknowns y (n,) and multipliers, corrected until K y = force - B'lam - D'p to rounding.

    Parameters
    ----------
    force, y : (n,) arrays
    gap : (r,) array
        e of the limits, z = D y - e.
    lam, p : (m, block) and (r,) arrays
        Bounds with p > 0 act and stay as they are; soft limits act where z > 0.
    stick : (m,) array of bool
        Terms whose increment stays as it is; needs rows that read one unknown each.
    slip : (m, block) array
        Of the others, with whose directions those of their multipliers turn.
    """
    held = np.zeros(len(condensation.retained), dtype=bool)
    # Rows of B, then rows of D: each reads one unknown of its own.
    columns = np.concatenate([operators.rows.columns, operators.limits.columns])
    coefficient = np.concatenate([operators.B.data, operators.D.data])
    act = np.concatenate([np.repeat(stick, operators.block), (p > 0) & (operators.compliance == 0)])
    held[columns[act]] = True
    F = np.flatnonzero(~held)
    turns = _turning(operators, lam, slip, stick)
    best, springs, soft, S_FF = np.inf, np.zeros_like(p), operators.compliance > 0, None
    for _ in range(4):  # Each round gains as many digits as the factors have; two are usual.
        r = residual(force, condensation.system.K, y, condensation.system.multiplier_force(lam, p))
        left = condensation.reduce(r, remembered=False)
        # 1 / c of the soft limits that act, z > 0, and what the multipliers p of all soft ones lack of z_+ / c.
        z = operators.limits.read(y[condensation.retained]) - gap
        stiffness = np.divide(1.0, operators.compliance, out=np.zeros_like(p), where=soft & (z > 0))
        lacking = np.where(soft, stiffness * z - p, 0.0)
        if S_FF is None or not np.array_equal(stiffness, springs):
            springs, K = stiffness, operators.regular.stiffened(turns, stiffness)
            S_FF = operators.factor.within(restricted(K, F), F)
        load, step = left.retained - operators.limits.force_of(lacking), np.zeros(len(held))
        step[F] = S_FF.solve(load[F])
        pressed = lacking + stiffness * operators.limits.read(step)
        # The energy of the correction to y and soft limits; what the held unknowns are pushed with is for multipliers.
        size = left.work_inside(left) + float(load @ step) + float(pressed @ (operators.compliance * pressed))
        if size >= 0.25 * best:
            break
        best = size
        push = left.retained - operators.K @ step
        y = y + condensation.recover(step, left)
        change = np.where(act, push[columns] / coefficient, 0.0)
        lam, p = lam + operators.blocks(change[: lam.size]), p + change[lam.size :] + pressed
        lam = lam + np.einsum("ijk,ik->ij", turns, operators.blocks(operators.rows.read(step)))
    return y, lam, p


def _turning(operators: Operators, lam: Floats, slip: Floats, stick: Bools) -> Floats:
    """(m, block, block) how multipliers turn with their slips, |lam| / |s| (I - ss'/|s|^2); zero where none does.

    Slips of rounding turn as those whose curvature is K's own entry over sqrt(EPS): a larger one, 1e18 has been seen,
    leaves no digit of the stiffness along s.
    """
    size = np.linalg.norm(slip, axis=1)
    turns = ~stick & (size > 0)
    size = np.where(turns, size, 1.0)
    entries = operators.K.diagonal()[operators.rows.columns] / operators.B.data**2
    own = operators.blocks(entries).max(axis=1, initial=0.0)
    curvature = np.where(turns, np.minimum(np.linalg.norm(lam, axis=1) / size, own / np.sqrt(EPS)), 0.0)
    turning: Floats = curvature[:, None, None] * transverse(slip / size[:, None])
    return turning


def full_certificate(
    condensation: Condensation, force: Floats, y: Floats, held: Floats, own: Certificate
) -> Certificate:
    """The certificate of the full system: r = force - held - K y over all unknowns, in extended precision.

    `held` (n,) is B'lam + D'p; or, where the condensed program's certificate knows the error of the retained unknowns
    without the multipliers, what holds those in place: r is then what condensing has lost.

    The floor is what the rounding of K's and the force's own entries brings about (:func:`rounding`).
    Norm terms and limits see retained unknowns only; their parts are of the condensed program's `own` certificate.
    """
    r, size = out_of_balance(condensation.system, force, y, held)
    return replace(own, equilibrium=0.5 * condensation.factor.energy(r), floor=rounding(condensation, size))


def out_of_balance(system: System, force: Floats, y: Floats, held: Floats) -> tuple[Floats, Floats]:
    """The force r = force - held - K y, less what motions of no energy feel, and the size of its terms' sum.

    All (n,), or (n, k) for as many states.
    """
    r, size = residual(force, system.K, y, held), np.abs(force) + np.abs(held)
    if y.any():
        size += sizes(system.K, y)
    return _off_kernel(system, r), size


def _off_kernel(system: System, force: Floats) -> Floats:
    """A force (n,) without what pushes along motions of no energy: multipliers hold that, not the anchors."""
    return force if (kernel := system.kernel) is None else force - kernel.basis @ (kernel.basis.T @ force)


def rounding(condensation: Condensation, size: Floats) -> float:
    """Energy that rounding adds at most to what forces bring about whose sums of terms are `size` (n,) in size.

    Every term, a force or a product K_ij y_j, is known to a relative rounding error of its own, even within +-EPS / 2,
    of variance EPS^2 / 12. That of K_ij acts on i and on j, so that with |e_i + e_j|^2 <= 2 |e_i|^2 + 2 |e_j|^2 the
    mean of the energy is at most 1/2 EPS^2 / 6 sum size_i^2 (K^{-1})_ii. Errors and samples alike have energies
    sum_k l_k x_k^2, x_k normal; their quotient spreads most where one l_k counts alone: Fisher's F.
    """
    return 0.5 * TAIL * EPS * EPS / 6 * condensation.factor.random_energy(size)
