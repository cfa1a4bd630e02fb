"""The linear system of Coulomb's law on given sets (:mod:`vemcvx.solvers.coulomb_sets`), solved, and judged.

All unknowns but the multipliers are eliminated (:mod:`vemcvx.solvers.response`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from scipy.linalg import LinAlgError, lapack

from vemcvx.arrays import EPS, Floats
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.response import Response
from vemcvx.solvers.sets import Iterate, Sets

SOLVED = 1e-6
"""Corrections larger than this part of the answer say that the system is all but singular: its sets hold nothing."""
ROUNDINGS = 64.0
"""Roundings that an inequality may miss."""


@dataclass(frozen=True)
class WeightLaw:
    """How weights (m,) follow the forces p (r,) of the limits, piecewise affinely, and the derivative (m, r)."""

    weights: Callable[[Floats], Floats]
    slope: Callable[[Floats], sp.csr_matrix]

    def scaled(self, up: Floats, down: Floats) -> WeightLaw:
        """The law in units in which weights are `up` (m,) times as many, and forces are `down` (r,) of these."""

        def slope(p: Floats) -> sp.csr_matrix:
            J = self.slope(down * p)
            entries = np.repeat(up, np.diff(J.indptr)) * J.data * down[J.indices]
            return sp.csr_matrix((entries, J.indices, J.indptr), shape=J.shape)

        return WeightLaw(lambda p: up * self.weights(down * p), slope)


@dataclass(frozen=True)
class Piece:
    """The affine piece of a law at the forces p_0 (r,): weights (m,) there, and their derivative (m, r)."""

    weights: Floats
    slope: sp.csr_matrix
    forces: Floats


@dataclass(frozen=True, kw_only=True)
class Found:
    """The solution of the system of some sets, its last correction, and the rounding of its rows."""

    sets: Sets
    point: Iterate
    error: float
    forces: float
    """what multipliers may be off by"""
    motions: Floats
    """(m * block + r,) what s and z may be off by"""
    inverse: Callable[[Floats], Floats]
    """of the system's matrix, on the rows of terms that slip: (N, k) -> (N, k)"""

    def holds(self, program: StepProgram, law: WeightLaw, sets: Sets) -> bool:
        """Whether the inequalities that the sets stand for hold, to rounding."""
        point, operators = self.point, program.operators
        if not np.isfinite(self.error):
            return False
        w, size = law.weights(np.maximum(point.p, 0.0)), np.linalg.norm(point.lam, axis=1)
        s, z = program.slip(point.d), program.excess(point.d)
        blur = operators.blocks(self.motions[: s.size]).max(axis=1), self.motions[s.size :]
        slips = np.linalg.norm(s, axis=1)
        within = np.where(sets.stick, size <= w + self.forces, np.abs(size - w) <= self.forces)
        turned = np.linalg.norm(slips[:, None] * point.lam - size[:, None] * s, axis=1)
        forth = sets.stick | (turned <= 2 * (self.forces * slips + size * blur[0]))
        pressed = np.where(sets.act, point.p >= -self.forces, z <= blur[1])
        # Where rows follow from others', what sticks is held by these.
        still = ~sets.stick | (slips <= self.motions.max(initial=0.0))
        return bool(within.all() and forth.all() and pressed.all() and still.all())

    def next_point(self, program: StepProgram, law: WeightLaw, sets: Sets) -> Iterate:
        """The point to take the next sets at, where others decide what discs do that share their nodes, at edges.

        A disc that sticks, but is moved by others, is to slip that way: one that slides along another face until it
        meets its own moves by the gap that was left there. A disc that slips, but is held by others, is to slip again:
        two of them that together are too weak would stick in turns.
        """
        point, s = self.point, program.slip(self.point.d)
        if program.operators.block == 1:
            return point
        size, w, blur = np.linalg.norm(s, axis=1), law.weights(np.maximum(point.p, 0.0)), self.motions.max(initial=0.0)
        moved, held = sets.stick & (size > blur), ~sets.stick & (size <= blur)
        lam = np.where(held[:, None], (1.0 + ROUNDINGS * EPS) * point.lam, point.lam)
        lam[moved] = (w[moved] / size[moved])[:, None] * s[moved]
        return replace(point, lam=lam)


def _balances(program: StepProgram, lam: Floats, p: Floats) -> bool:
    """Whether forces balance, to SOLVED of the loads, on motions that K does not feel.

    Where sets leave such a motion free, their system is singular but for rounding, and what solves it is so far away
    that nothing measured against it would tell.
    """
    operators = program.operators
    if operators.kernel is None:
        return True
    pushed = np.abs(operators.kernel).T @ np.abs(program.g)
    left, blur = operators.kernel_balance.imbalance(lam, p, operators.kernel.T @ program.g, pushed)
    return bool((np.abs(left) <= blur + SOLVED * pushed).all())


def on_sets(program: StepProgram, law: Piece, sets: Sets, response: Response, near: Floats) -> Found:
    """Solve the system of the sets, with two corrections by its residual."""
    operators = program.operators
    solve, inverse = _factorised(operators, sets, law.slope, response)
    d, x = np.zeros(len(program.g)), np.zeros(len(response.compliance))
    norms, limits = response.norms, response.limits
    stick, act = np.repeat(sets.stick, operators.block), sets.act
    step, error = d, np.inf
    for _ in range(3):
        lam, p = operators.blocks(x[norms]), x[limits]
        bound = sets.direction * (law.weights + law.slope @ (p - law.forces))[:, None] + _bend(sets, program.slip(d))
        slip = operators.rows.read(d) - program.b
        wanted = np.zeros_like(x)
        wanted[norms] = np.where(stick, -slip, (bound - lam).ravel())
        if len(sets.idle):
            wanted[norms][sets.idle] = sets.shares @ (near - lam).ravel()
        wanted[limits] = np.where(act, operators.compliance * p - program.excess(d), -p)
        step, more = solve(program.residual(d, lam, p), wanted)
        d, x = d + step, x + more
        error = operators.energy_norm(step)
    size, last = np.abs(x[: limits.stop]), np.abs(more[: limits.stop]).max(initial=0.0)
    force, free = np.abs(program.g).max(initial=0.0), program.g @ operators.factor.solve(program.g)
    # What anchors answer to a motion is no force of the step: it is as large as any error of that motion.
    held = x[: limits.stop]
    norm = np.sqrt(abs(free)) + np.sqrt(abs(held @ response.matrix[: limits.stop, : limits.stop] @ held))
    solved = last <= SOLVED * max(force, size.max(initial=0.0)) and error <= SOLVED * norm
    reach, off = (response.absolute @ np.abs(d))[: limits.stop], (response.A @ step)[: limits.stop]
    # Sets that hold no motion without energy lead anywhere along it; its sign is that of rounding, and its work is not.
    solved = solved and size @ np.abs(off) <= SOLVED * norm**2
    if not solved or not _balances(program, operators.blocks(x[norms]), x[limits]):
        raise LinAlgError("singular")
    forces = 8 * last + ROUNDINGS * EPS * size.max(initial=0.0)
    motions = 8 * np.abs(off) + ROUNDINGS * EPS * (reach + np.abs(np.concatenate([program.b, program.e])))
    return Found(
        sets=sets,
        point=Iterate(d, operators.blocks(x[norms]), x[limits]),
        error=error,
        forces=forces,
        motions=motions,
        inverse=inverse,
    )


def _bend(sets: Sets, s: Floats) -> Floats:
    """h (I - q q') s, of vectors (m, block), or of k at once, (m, block, k)."""
    more = (np.newaxis,) * (s.ndim - 2)
    along = np.einsum("ij,ij...->i...", sets.direction, s)
    bent: Floats = sets.curvature[:, None, *more] * (s - sets.direction[(..., *more)] * along[:, None])
    return bent


def _factorised(
    operators: Operators, sets: Sets, J: sp.csr_matrix, response: Response
) -> tuple[Callable[[Floats, Floats], tuple[Floats, Floats]], Callable[[Floats], Floats]]:
    """(force, wanted) -> (d, x): K d = force - A'x, and each row's equation missing by `wanted`; and M^{-1}."""
    norms, limits = response.norms, response.limits
    M = response.matrix.copy()
    M[np.diag_indices_from(M)] += response.compliance
    slip = np.flatnonzero(np.repeat(~sets.stick, operators.block))
    bends = sets.curvature.any()
    own = response.matrix[norms].reshape(operators.count, operators.block, -1)
    M[slip] = _bend(sets, own).reshape(-1, len(M))[slip] if bends else 0.0
    M[slip, slip] += 1.0
    M[slip, limits] -= sets.direction.ravel()[slip, None] * J.toarray()[slip // operators.block]
    off = limits.start + np.flatnonzero(~sets.act)
    idle = np.concatenate([norms.start + sets.idle, off])
    M[idle] = 0.0
    M[off, off] = 1.0
    if len(sets.idle):
        M[norms.start + sets.idle, norms] = sets.shares
    lu, pivots, info = lapack.dgetrf(M, overwrite_a=1)
    if info > 0 or not np.isfinite(lu).all():
        raise LinAlgError("singular")

    def inverse(rhs: Floats) -> Floats:
        return np.asarray(lapack.dgetrs(lu, pivots, rhs)[0])

    def solve(force: Floats, wanted: Floats) -> tuple[Floats, Floats]:
        free = response.A @ operators.factor.solve(force)
        rhs = wanted.copy()
        met = np.ones(len(rhs), dtype=bool)
        met[slip], met[idle] = False, False
        rhs[met] = free[met] - wanted[met]
        rhs[slip] += _bend(sets, operators.blocks(free[norms])).ravel()[slip]
        x = inverse(rhs)
        return operators.factor.solve(force - response.act(x)), x

    return solve, inverse
