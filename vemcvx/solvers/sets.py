"""The answer on given sets: what sticks, what slips and where to, which limits act (one step of an active-set method).

Sticking terms give equations B_i d = b_i; a slipping one, with direction q_i and curvature h_i, the linearised
multiplier lam_i = w_i q_i + h_i (I - q_i q_i') (B_i d - b_i). An acting limit gives the equation D_j d = e_j where it
is a bound and the multiplier p_j = (D_j d - e_j) / c_j where it is soft, so that

    (K + B'HB + D'C^{-1}D) d = g - B'(w q) + B'H b + D'C^{-1}e  on slipping terms and soft limits that act,
    B_i d = b_i  on the sticking terms,   D_j d = e_j  on the bounds that act.

On absolute values (block 1) H vanishes and the answer on the right sets is the solution itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Bools, Floats, Ints, directions, lengths
from vemcvx.linear import Matrix, corrected
from vemcvx.program.norms import transverse
from vemcvx.program.operators import Operators, restricted
from vemcvx.program.step_program import StepProgram

SHIFT = 0.1
"""Of the sets, in units of one over the flexibilities. At .1 the paper's scene takes 3-7 iterations from a cold start;
at 1 and beyond undamped active sets cycle on it, and degenerate terms (|lam_i| = w_i, s_i = 0) count as slipping for a
rounding error of s_i: the gap is linear in that slip."""

INEXACT = 0.03
"""Part of the forces out of balance that iterative linear solvers leave of them at each set: of 12 steps in space .1
takes a half more sets and a tenth more conjugate gradients, .01 as many sets and as many of these."""
STIFFEST = 1e8
"""Largest curvature of slipping discs, in units of one over the flexibilities. Where several discs share a node, more
would leave too little of the stiffness of the body beside it."""


@dataclass(frozen=True)
class Sets:
    """Sticking terms, direction (m, block) and curvature (m,) of the others (0 where they stick), acting limits."""

    stick: Bools
    direction: Floats
    curvature: Floats
    act: Bools
    idle: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(k,) rows of sticking terms that follow from others' rows"""
    shares: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """(k, m * block): how those share what they carry, shares @ lam = shares @ (what they carried before)"""

    def same(self, other: Sets) -> bool:
        """Whether the other sets lead to the same answer."""
        return (
            bool((self.stick == other.stick).all())
            and bool((self.act == other.act).all())
            and np.array_equal(self.direction, other.direction)
        )


@dataclass(frozen=True)
class Iterate:
    """Increments d (n,) with multipliers lam (m, block) and p (r,)."""

    d: Floats
    lam: Floats
    p: Floats


@dataclass(frozen=True)
class Shifts:
    """How strongly slips (m,) and excesses (r,) count against multipliers; units of stiffness."""

    norms: Floats
    limits: Floats

    def __mul__(self, factor: float) -> Shifts:
        return Shifts(factor * self.norms, factor * self.limits)

    @staticmethod
    def of(operators: Operators) -> Shifts:
        """SHIFT times the stiffness that norm terms and limits feel."""
        return Shifts(SHIFT * operators.norm_stiffness, SHIFT * operators.limit_stiffness)


def sets_at(program: StepProgram, at: Iterate, shift: Shifts) -> Sets:
    """The sets at a point: q = lam + shift s sticks where |q| <= w, else slips along q; p + shift (z - c p) > 0 acts.

    The curvature shift w / (|q| - w) is that of Newton's method on lam = P_w(lam + shift s) after lam is
    eliminated (Kunisch and Stadler 2005; Hueber, Stadler and Wohlmuth 2008); at a solution it is w / |s|.
    """
    q = at.lam + shift.norms[:, None] * program.slip(at.d)
    size = lengths(q)
    stick = size <= program.w
    slip, curvature = ~stick, np.zeros(len(size))
    direction = slip[:, None] * directions(q, size)
    if program.operators.block > 1:
        stiff = shift.norms[slip] * program.w[slip]
        least = stiff * program.operators.norm_flexibility[slip] / STIFFEST
        curvature[slip] = stiff / np.maximum(size[slip] - program.w[slip], least)
    act = np.zeros(len(at.p), dtype=bool)
    if len(act):
        act = at.p + shift.limits * (program.excess(at.d) - program.operators.compliance * at.p) > 0
    return Sets(stick, direction, curvature, act)


def answer_on(program: StepProgram, sets: Sets, near: Iterate | None = None) -> Iterate:
    """The point that the sets lead to; its multipliers are not yet projected.

    Where linear systems are solved iteratively, from the point `near`, if there is one, and as far as INEXACT says.
    """
    operators = program.operators
    soft = sets.act & (operators.compliance > 0)
    spring = np.divide(1.0, operators.compliance, out=np.zeros(len(soft)), where=soft)
    at_bound = program.w[:, None] * sets.direction
    M, load = operators.K, program.g - program.multiplier_force(at_bound, -spring * program.e)
    S: sp.csr_matrix | None = None
    bends = sets.curvature.any()
    if bends or soft.any():
        H = sets.curvature[:, None, None] * transverse(sets.direction)
        S = operators.stiffening(H, spring)
        M = operators.plus(S)
        load = load + operators.rows.force_of(np.einsum("ijk,ik->ij", H, operators.blocks(program.b)).ravel())
    stick = np.flatnonzero(np.repeat(sets.stick, operators.block))
    stop = np.flatnonzero(sets.act & ~soft)
    own = operators.own_columns
    if own is None:
        d, reaction, stopped = _held(M, load, program, stick, stop)
    else:
        columns = np.concatenate([own[0][stick], own[1][stop]])
        iterative = not operators.factor.exact
        begin = _Near(near.d, sp.csr_matrix(M.shape) if S is None else S) if near and iterative else None
        d, reaction, stopped = _held_coordinates(M, load, program, stick, stop, columns=columns, near=begin)
    lam = (at_bound + np.einsum("ijk,ik->ij", H, program.slip(d)) if bends else at_bound).ravel()
    lam[stick] = reaction
    p = spring * program.excess(d)
    p[stop] = stopped
    return Iterate(d, operators.blocks(lam), p)


@dataclass(frozen=True)
class _Near:
    """Where an iterative linear solver begins, and the stiffness that is added to K."""

    d: Floats
    S: sp.csr_matrix


def _held(M: Matrix, load: Floats, program: StepProgram, stick: Ints, stop: Ints) -> tuple[Floats, Floats, Floats]:
    """Minimise 1/2 d'Md - load'd subject to B_i d = b_i and D_j d = e_j on the rows given; d and the reactions."""
    operators = program.operators
    A = sp.vstack([operators.B[stick], operators.D[stop]], format="csr")
    value = np.concatenate([program.b[stick], program.e[stop]])
    factor = operators.factor.within(M, np.arange(len(load)))
    spread = factor.solve(A.T.toarray())
    small = A @ spread

    def correct(force: Floats, gap: Floats) -> tuple[Floats, Floats]:
        free = factor.solve(force)
        # Redundant rows make the small system singular; least squares picks one of the equal reactions.
        push = np.linalg.lstsq(small, A @ free - gap, rcond=None)[0] if len(gap) else gap
        return free - spread @ push, push

    d, reaction = correct(load, value)
    # One step of refinement: A d = value then holds to the rounding of d instead of cond(K) times that.
    more, push = correct(load - M @ d - A.T @ reaction, value - A @ d)
    reaction = reaction + push
    return d + more, reaction[: len(stick)], reaction[len(stick) :]


def _held_coordinates(
    M: Matrix,
    load: Floats,
    program: StepProgram,
    stick: Ints,
    stop: Ints,
    *,
    columns: Ints,
    near: _Near | None = None,
) -> tuple[Floats, Floats, Floats]:
    """The same where every row reads its own unknown, those of the rows given `columns`: the held ones are known."""
    operators = program.operators
    coefficient = np.concatenate([operators.B.data[stick], operators.D.data[stop]])
    value = np.concatenate([program.b[stick], program.e[stop]])
    d = np.zeros(len(load)) if near is None else near.d.copy()
    d[columns] = value / coefficient
    free = np.ones(len(load), dtype=bool)
    free[columns] = False
    cycle = None if near is None else operators.factor.cycle(near.S, free)
    if cycle is not None:
        d = corrected(M, d, load, free, cycle=cycle, part=INEXACT)
    else:
        F = np.flatnonzero(free)
        rest = load - M @ d if value.any() else load
        within = operators.principal(F) if M is operators.K else operators.factor.within(restricted(M, F), F)
        d[F] = within.solve(rest[F])
    reaction = (load - M @ d)[columns] / coefficient
    return d, reaction[: len(stick)], reaction[len(stick) :]
