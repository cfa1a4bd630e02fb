"""The answer on given sets: which terms stick, which slip and where to (one step of an active-set method).

Sticking terms give equations B_i d = b_i; a slipping one, with direction q_i and curvature h_i, the
linearised multiplier lam_i = w_i q_i + h_i (I - q_i q_i') (B_i d - b_i), so that

    (K + B'HB) d = g - B'(w q) + B'H b  on the slipping terms,   B_i d = b_i  on the sticking ones.

On absolute values (block 1) H vanishes and the answer on the right sets is the solution itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.program import Form, StepProgram

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Sets:
    """Sticking terms, and direction (m, block) and curvature (m,) of the others (0 where they stick)."""

    stick: Bools
    direction: Floats
    curvature: Floats


def sets_at(program: StepProgram, lam: Floats, s: Floats, shift: Floats) -> Sets:
    """The sets at (lam, s): q = lam + shift s sticks where |q| <= w, otherwise slips along q.

    The curvature shift w / (|q| - w) is that of Newton's method on lam = P_w(lam + shift s) after lam is
    eliminated (Kunisch and Stadler 2005; Hueber, Stadler and Wohlmuth 2008); at a solution it is w / |s|.
    """
    q = lam + shift[:, None] * s
    size = np.linalg.norm(q, axis=1)
    stick = size <= program.w
    slip = ~stick
    direction, curvature = np.zeros_like(q), np.zeros_like(size)
    direction[slip] = q[slip] / size[slip, None]
    if program.form.block > 1:
        curvature[slip] = shift[slip] * program.w[slip] / (size[slip] - program.w[slip])
    return Sets(stick, direction, curvature)


def answer_on(program: StepProgram, sets: Sets) -> tuple[Floats, Floats]:
    """Increments d (n,) and multipliers lam (m, block), the latter not yet projected."""
    form = program.form
    pull = program.w[:, None] * sets.direction
    M, load = form.K, program.g - form.rows.pull(pull.ravel())
    bends = sets.curvature.any()
    if bends:
        tangential = np.eye(form.block) - np.einsum("ij,ik->ijk", sets.direction, sets.direction)
        H = sets.curvature[:, None, None] * tangential
        M = form.stiffened(H)
        load = load + form.rows.pull(np.einsum("ijk,ik->ij", H, form.blocks(program.b)).ravel())
    held = np.flatnonzero(np.repeat(sets.stick, form.block))
    solve = _held if form.rows.columns is None else _held_coordinates
    d, reaction = solve(M, load, form, held, program.b[held])
    lam = (pull + np.einsum("ijk,ik->ij", H, program.slip(d)) if bends else pull).ravel()
    lam[held] = reaction
    return d, form.blocks(lam)


def _held(M: Floats | sp.csr_matrix, load: Floats, form: Form, held: Ints, value: Floats) -> tuple[Floats, Floats]:
    """Minimise 1/2 d'Md - load'd subject to B_i d = value on the rows `held`; returns d and the reactions."""
    B = form.B[held]
    factor = form.factor.within(M, np.arange(len(load)))
    spread = factor.solve(B.T.toarray())
    small = B @ spread

    def correct(force: Floats, gap: Floats) -> tuple[Floats, Floats]:
        free = factor.solve(force)
        # Redundant rows make the small system singular; least squares picks one of the equal reactions.
        push = np.linalg.lstsq(small, B @ free - gap, rcond=None)[0] if len(gap) else gap
        return free - spread @ push, push

    d, reaction = correct(load, value)
    # One step of refinement: B d = value then holds to the rounding of d instead of cond(K) times that.
    more, push = correct(load - M @ d - B.T @ reaction, value - B @ d)
    return d + more, reaction + push


def _held_coordinates(
    M: Floats | sp.csr_matrix, load: Floats, form: Form, held: Ints, value: Floats
) -> tuple[Floats, Floats]:
    """The same where every row reads its own unknown: the held unknowns are known."""
    columns, coefficient = form.rows.columns[held], form.B.data[held]  # type: ignore[index]
    d = np.zeros(len(load))
    d[columns] = value / coefficient
    free = np.ones(len(load), dtype=bool)
    free[columns] = False
    F = np.flatnonzero(free)
    rows = M[F]
    d[F] = form.factor.within(rows[:, F], F).solve(load[F] - rows @ d if value.any() else load[F])
    return d, (load[columns] - M[columns] @ d) / coefficient
