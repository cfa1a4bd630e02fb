"""Weights that follow the forces of the limits: the step solved whole on given sets, and proof that the sets are right.

With w = W(p) a step is a *quasi*-variational inequality, which no energy minimises: find d, lam, p with

    K d = g - B'lam - D'p,      |lam_i| <= W_i(p),   lam_i . s_i = W_i(p) |s_i|,         s = B d - b
                                p_j >= 0,   z_j <= c_j p_j,   p_j (c_j p_j - z_j) = 0    z = D d - e       (Q)

On given sets, and with W(p) = w + J (p - p_0) near p_0, (Q) is one linear system, not symmetric because of J:

    s_i = 0  on sticking terms,           lam_i = q_i W_i(p) + h_i (I - q_i q_i') s_i  on slipping ones,
    z_j = c_j p_j  on acting limits,      p_j = 0  on the others.

Theorem. Let W be piecewise affine and the terms absolute values (block 1). If the solution of the system of some sets
has |lam_i| <= W_i(p) where it sticks, q_i s_i >= 0 where it slips, p_j >= 0 where limits act, z_j <= 0 where they do
not, and W at p is what the system took it for, then it solves (Q).
Proof. Every line of (Q) is an equation of the system or one of these inequalities.  QED

Rows of bounds that act and terms that stick may follow from one another, at corners: the system is singular then, and
what each carries is not determined. Of those that follow, terms are given a share q_i, |q_i| <= 1, of W_i(p) to carry,
and bounds nothing; that s_i = 0 nevertheless is looked at afterwards, and the theorem holds.

So whoever found another d knows how far it is from *a* solution: |d - d_sets|_K, plus the error of d_sets, which is
that of one solve of a linear system: the last correction of its iterative refinement. (One solution: where
coefficients are not small there may be more.) In blocks of two and more the direction of slip turns with the answer
and the curvature h makes this Newton's method; what it converges to is then close to a solution, and not proven to be.

The sets are those of the last answer, as in :mod:`vemcvx.solvers.sets`: a semismooth Newton method on (Q) (Alart and
Curnier 1991; Hueber, Stadler and Wohlmuth 2008), which may cycle, wherefore it is begun anew from answers of convex
programs with weights held fast (:mod:`vemcvx.stepping.fixed_point`).

All unknowns but the multipliers are eliminated (:mod:`vemcvx.solvers.response`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import scipy.sparse as sp
from scipy.linalg import LinAlgError, lapack

from vemcvx.arrays import EPS, Floats
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.response import Response
from vemcvx.solvers.sets import Iterate, Sets, Shifts, sets_at, without_redundant_rows

SHIFT_SHARE = 0.1
"""Newton's shifts times this: less of what is nearly at its bound changes sides."""
MOST_ROUNDS = 25
"""Sets in a row before another start is wanted; those that settle do so in fewer than ten."""
SOFTER = 1e-6
STEEPER = 10**0.5
"""Laws that are softened at first become steeper by this factor at a time: of 180 random problems with a steep law
sets did not settle in 4, in 18 of the first 60 where the law was steep at once, in 6 with a factor of 10."""
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


@dataclass(frozen=True)
class SetsSolution:
    """A point that solves (Q) to rounding."""

    point: Iterate
    weights: Floats
    error: float
    """|d - d'|_K to the solution d' of the sets' own system: of the solve"""
    proven: bool
    """whether that solves (Q) by the theorem above; else it is the limit of Newton's method"""


def solution_near(
    program: StepProgram, law: WeightLaw, start: Iterate, response: Response, rounds: Iterator[int]
) -> SetsSolution | None:
    """A solution of (Q) from the sets at `start`; None where the sets do not settle.

    A law that rises steeply and levels off is met on its level or at zero, in turns, and never on its slope. The softer
    law W(share p), share = SOFTER, is met on its slope, and steeper ones from its answer, up to share = 1: with
    p / STEEPER in place of p each begins on the same piece. And what slips with given weights seems to stick beside the
    larger ones that its forces ask for: the sets are those of the given weights then.

    Parameters
    ----------
    program : StepProgram
        `start` is its answer.
    response : Response
        Of its operators.
    rounds : iterator
        One is taken for the system of every sets; it gives up where there are no more.
    """
    found = _from_sets(program, law, start, response, rounds)
    found = found or _from_sets(program, law, start=start, response=response, rounds=rounds, w=program.w)
    if found is not None:
        return found
    share, point = SOFTER, start
    while share < 1.0:
        softer = law.scaled(np.ones(len(program.w)), np.full(len(start.p), share))
        found = _from_sets(program, softer, point, response, rounds)
        if found is None:
            return None
        point, share = replace(found.point, p=found.point.p / STEEPER), share * STEEPER
    return _from_sets(program, law, point, response, rounds)


def _from_sets(
    program: StepProgram,
    law: WeightLaw,
    start: Iterate,
    response: Response,
    rounds: Iterator[int],
    w: Floats | None = None,
) -> SetsSolution | None:
    """A solution from the sets at `start`, beside weights `w` (m,) if given."""
    shift, point = Shifts.of(program.operators) * SHIFT_SHARE, start
    met: set[bytes] = set()
    for _ in islice(rounds, MOST_ROUNDS):
        sets, piece = _sets(program, law, point, shift, None if met else w)
        # The same terms may stick and press on another piece of the law: on its slope, and then on its level.
        parts = sets.stick, sets.direction, sets.act, piece.slope.data, piece.slope.indices, piece.slope.indptr
        mark = b"".join(part.tobytes() for part in parts)
        if mark in met and program.operators.block == 1:
            return None
        met.add(mark)
        found = _tried(program, piece, sets, response, point.lam)
        if found is None:
            return None
        point = found.point
        if found.holds(program, law, sets):
            d = program.feasible(_stuck_in_place(program, sets, point.d))
            p = np.maximum(point.p, 0.0)
            w = law.weights(p)
            lam = replace(program, w=w).project(point.lam)
            return SetsSolution(Iterate(d, lam, p), w, found.error, program.operators.block == 1)
    return None


def _tried(program: StepProgram, law: Piece, sets: Sets, response: Response, lam: Floats) -> _Found | None:
    """The solution of the system of the sets near the multipliers `lam`; None if their system is singular."""
    with suppress(LinAlgError):
        return _on_sets(program, law, sets, response)
    with suppress(LinAlgError):
        once = without_redundant_rows(program.operators, sets, lam, law.weights)
        return _on_sets(program, law, once, response)
    return None


def _stuck_in_place(program: StepProgram, sets: Sets, d: Floats) -> Floats:
    """The increments with those that stick where they are, to the last bit: large weights make work of the rest."""
    still = np.flatnonzero(np.repeat(sets.stick, program.operators.block) & program.operators.rows.single)
    entry = program.operators.B.indptr[still]
    d = d.copy()
    d[program.operators.B.indices[entry]] = program.b[still] / program.operators.B.data[entry]
    return d


def _sets(
    program: StepProgram, law: WeightLaw, at: Iterate, shift: Shifts, w: Floats | None = None
) -> tuple[Sets, Piece]:
    """The sets at a point, and the piece of the law there."""
    pressed = np.maximum(at.p + shift.limits * (program.excess(at.d) - program.operators.compliance * at.p), 0.0)
    piece = Piece(law.weights(pressed), law.slope(pressed), pressed)
    w = piece.weights if w is None else w
    sets = sets_at(replace(program, w=w), at, shift)
    # A weight of nothing holds nothing: as a row that sticks it may double another one, at a corner.
    return replace(sets, stick=sets.stick & (w > 0)), piece


@dataclass(frozen=True)
class _Found:
    """The solution of the system of some sets, its last correction, and the rounding of its rows."""

    point: Iterate
    error: float
    forces: float
    """what multipliers may be off by"""
    motions: Floats
    """(m * block + r,) what s and z may be off by"""

    def holds(self, program: StepProgram, law: WeightLaw, sets: Sets) -> bool:
        """Whether the inequalities that the sets stand for hold, to rounding."""
        point, operators = self.point, program.operators
        if not np.isfinite(self.error):
            return False
        w, size = law.weights(np.maximum(point.p, 0.0)), np.linalg.norm(point.lam, axis=1)
        s, z = program.slip(point.d), program.excess(point.d)
        blur = operators.blocks(self.motions[: s.size]).max(axis=1), self.motions[s.size :]
        along, slips = np.einsum("ij,ij->i", s, point.lam), np.linalg.norm(s, axis=1)
        within = np.where(sets.stick, size <= w + self.forces, np.abs(size - w) <= self.forces)
        forth = sets.stick | (along >= size * slips - 2 * (self.forces * slips + size * blur[0]))
        pressed = np.where(sets.act, point.p >= -self.forces, z <= blur[1])
        # Where rows follow from others', what sticks is held by these.
        still = ~sets.stick | (slips <= self.motions.max(initial=0.0))
        return bool(within.all() and forth.all() and pressed.all() and still.all())


def _balances(program: StepProgram, lam: Floats, p: Floats) -> bool:
    """Whether forces balance, to SOLVED of the loads, on motions that K does not feel.

    Where sets leave such a motion free, their system is singular but for rounding, and what solves it is so far away
    that nothing measured against it would tell.
    """
    operators = program.operators
    if operators.kernel is None:
        return True
    pushed = np.abs(operators.kernel).T @ np.abs(program.g)
    left, blur = operators.hold.imbalance(lam, p, operators.kernel.T @ program.g, pushed)
    return bool((np.abs(left) <= blur + SOLVED * pushed).all())


def _on_sets(program: StepProgram, law: Piece, sets: Sets, response: Response) -> _Found:
    """Solve the system of the sets, with two corrections by its residual."""
    operators = program.operators
    solve = _factorised(operators, sets, law.slope, response)
    d, x = np.zeros(len(program.g)), np.zeros(len(response.compliance))
    norms, limits = response.norms, response.limits
    stick, act = np.repeat(sets.stick, operators.block), sets.act
    step, error = d, np.inf
    for _ in range(3):
        lam, p = x[norms], x[limits]
        bound = sets.direction * (law.weights + law.slope @ (p - law.forces))[:, None] + _bend(sets, program.slip(d))
        slip = operators.rows.read(d) - program.b
        wanted = np.zeros_like(x)
        wanted[norms] = np.where(stick, -slip, bound.ravel() - lam)
        if sets.idle is not None:
            wanted[norms][sets.idle] = -lam.ravel()[sets.idle]
        wanted[limits] = np.where(act, operators.compliance * p - program.excess(d), -p)
        step, more = solve(program.residual(d, operators.blocks(lam), p), wanted)
        d, x = d + step, x + more
        error = operators.energy_norm(step)
    size, last = np.abs(x[: limits.stop]), np.abs(more[: limits.stop]).max(initial=0.0)
    force, free = np.abs(program.g).max(initial=0.0), program.g @ operators.factor.solve(program.g)
    # What anchors answer to a motion is no force of the step: it is as large as any error of that motion.
    held = x[: limits.stop]
    norm = np.sqrt(abs(free)) + np.sqrt(abs(held @ response.matrix[: limits.stop, : limits.stop] @ held))
    solved = last <= SOLVED * max(force, size.max(initial=0.0)) and error <= SOLVED * norm
    if not solved or not _balances(program, operators.blocks(x[norms]), x[limits]):
        raise LinAlgError("singular")
    forces = 8 * last + ROUNDINGS * EPS * size.max(initial=0.0)
    reach = response.absolute @ np.abs(d)
    reach[: limits.stop] += np.abs(np.concatenate([program.b, program.e]))
    motions = 8 * np.abs(response.A @ step) + ROUNDINGS * EPS * reach
    return _Found(Iterate(d, operators.blocks(x[norms]), x[limits]), error, forces, motions[: limits.stop])


def _bend(sets: Sets, s: Floats) -> Floats:
    """h (I - q q') s, of vectors (m, block), or of k at once, (m, block, k)."""
    more = (np.newaxis,) * (s.ndim - 2)
    along = np.einsum("ij,ij...->i...", sets.direction, s)
    bent: Floats = sets.curvature[:, None, *more] * (s - sets.direction[(..., *more)] * along[:, None])
    return bent


def _factorised(
    operators: Operators, sets: Sets, J: sp.csr_matrix, response: Response
) -> Callable[[Floats, Floats], tuple[Floats, Floats]]:
    """(force, wanted) -> (d, x): K d = force - A'x, and each row's equation missing by `wanted`."""
    norms, limits = response.norms, response.limits
    M = response.matrix.copy()
    M[np.diag_indices_from(M)] += response.compliance
    slip = np.flatnonzero(np.repeat(~sets.stick, operators.block))
    bends = sets.curvature.any()
    own = response.matrix[norms].reshape(operators.count, operators.block, -1)
    M[slip] = _bend(sets, own).reshape(-1, len(M))[slip] if bends else 0.0
    M[slip, slip] += 1.0
    M[slip, limits] -= sets.direction.ravel()[slip, None] * J.toarray()[slip // operators.block]
    still = np.zeros(0, dtype=np.int64) if sets.idle is None else norms.start + np.flatnonzero(sets.idle)
    idle = np.concatenate([still, limits.start + np.flatnonzero(~sets.act)])
    M[idle] = 0.0
    M[idle, idle] = 1.0
    lu, pivots, info = lapack.dgetrf(M, overwrite_a=1)
    if info > 0 or not np.isfinite(lu).all():
        raise LinAlgError("singular")

    def solve(force: Floats, wanted: Floats) -> tuple[Floats, Floats]:
        free = response.A @ operators.factor.solve(force)
        rhs = wanted.copy()
        met = np.ones(len(rhs), dtype=bool)
        met[slip], met[idle] = False, False
        rhs[met] = free[met] - wanted[met]
        rhs[slip] += _bend(sets, operators.blocks(free[norms])).ravel()[slip]
        x = lapack.dgetrs(lu, pivots, rhs)[0]
        return operators.factor.solve(force - response.act(x)), x

    return solve
