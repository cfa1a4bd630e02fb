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
what each carries is not determined, and chosen (:mod:`vemcvx.solvers.redundant_rows`); that s_i = 0 nevertheless is
looked at afterwards, and the theorem holds.

So whoever found another d knows how far it is from *a* solution: |d - d_sets|_K, plus the error of d_sets, which is
that of one solve of a linear system: the last correction of its iterative refinement. (One solution: where
coefficients are not small there may be more.) In blocks of two and more the direction of slip turns with the answer
and the curvature h makes this Newton's method; how far what it converges to is from a solution is proven in
:mod:`vemcvx.solvers.coulomb_existence`.

The sets are those of the last answer, as in :mod:`vemcvx.solvers.sets`: a semismooth Newton method on (Q) (Alart and
Curnier 1991; Hueber, Stadler and Wohlmuth 2008), which may cycle, wherefore it is begun anew from answers of convex
programs with weights held fast (:mod:`vemcvx.stepping.fixed_point`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError

from vemcvx.arrays import Floats
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.coulomb_existence import distance_to_a_solution
from vemcvx.solvers.coulomb_system import Found, Piece, WeightLaw, on_sets
from vemcvx.solvers.redundant_rows import without_redundant_rows
from vemcvx.solvers.response import Response
from vemcvx.solvers.sets import Iterate, Sets, Shifts, sets_at

SHIFT_SHARE = 0.1
"""Newton's shifts times this: less of what is nearly at its bound changes sides."""
MOST_ROUNDS, MOST_TURNS = 25, 40
"""Sets in a row before another start is wanted; of absolute values those that settle do so in fewer than ten, while
directions of discs turn for longer."""
RETURNS = 6
"""Times that sets of discs may come back to those that they have left; absolute values then cycle for ever."""
SOFTER = 1e-6
STEEPER = 10**0.5
"""Laws that are softened at first become steeper by this factor at a time: of 180 random problems with a steep law
sets did not settle in 4, in 18 of the first 60 where the law was steep at once, in 6 with a factor of 10."""
FINEST = 1.7
"""Where a steeper law of discs does not settle, the root of the factor is tried, if the factor is at least this."""


@dataclass(frozen=True)
class SetsSolution:
    """A point that solves (Q) to rounding."""

    point: Iterate
    weights: Floats
    error: float
    """of the solve; and to a solution of (Q), where that is not the sets' own"""
    proven: bool
    """whether there is one, by one of the theorems; else this is the limit of Newton's method"""


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
    met = _from_sets(program, law, start, response, rounds)
    met = met or _from_sets(program, law, start=start, response=response, rounds=rounds, w=program.w)
    met = met or _by_softer_laws(program, law, start, response, rounds)
    if met is None:
        return None
    (sets, found), point = met, met.point(program, law)
    away = distance_to_a_solution(program, law, sets, found, response) if program.operators.block > 1 else 0.0
    return SetsSolution(point, law.weights(point.p), found.error + (away or 0.0), away is not None)


def _by_softer_laws(
    program: StepProgram, law: WeightLaw, start: Iterate, response: Response, rounds: Iterator[int]
) -> _Settled | None:
    """A solution by way of laws that are softened at first."""
    share, point, factor = SOFTER, start, STEEPER
    last: tuple[Iterate, float] | None = None
    while True:
        softer = law if share >= 1.0 else law.scaled(np.ones(len(program.w)), np.full(len(start.p), share))
        met = _from_sets(program, softer, point, response, rounds)
        if met is not None and share >= 1.0:
            return met
        if met is not None:
            last = met.point(program, softer), share
        elif last is None or program.operators.block == 1 or factor < FINEST:
            return None
        else:
            factor = factor**0.5
        point, share = replace(last[0], p=last[0].p / factor), last[1] * factor


class _Settled(NamedTuple):
    """Sets whose inequalities hold, and what their system led to."""

    sets: Sets
    found: Found

    def point(self, program: StepProgram, law: WeightLaw) -> Iterate:
        """The point, admissible."""
        at, p = self.found.point, np.maximum(self.found.point.p, 0.0)
        d = program.feasible(_stuck_in_place(program, self.sets, at.d))
        return Iterate(d, replace(program, w=law.weights(p)).project(at.lam), p)


def _from_sets(
    program: StepProgram,
    law: WeightLaw,
    start: Iterate,
    response: Response,
    rounds: Iterator[int],
    w: Floats | None = None,
) -> _Settled | None:
    """A solution from the sets at `start`, beside weights `w` (m,) if given."""
    shift, point = Shifts.of(program.operators) * SHIFT_SHARE, start
    turns = program.operators.block > 1
    met: list[bytes] = []
    returns = 0
    for _ in islice(rounds, MOST_TURNS if turns else MOST_ROUNDS):
        sets, piece = _sets(program, law, point, shift, None if met else w)
        # The same terms may stick and press on another piece of the law: on its slope, and then on its level.
        parts = sets.stick, sets.act, piece.slope.data, piece.slope.indices, piece.slope.indptr
        mark = b"".join(part.tobytes() for part in (parts if turns else (*parts, sets.direction)))
        returns += mark in met and not (turns and mark == met[-1])
        if returns > (RETURNS if turns else 0):
            return None
        met.append(mark)
        found = _tried(program, piece, sets, response, point.lam)
        if found is None:
            return None
        if found.holds(program, law, sets):
            return _Settled(sets, found)
        point = found.next_point(program, law, sets)
    return None


def _tried(program: StepProgram, law: Piece, sets: Sets, response: Response, lam: Floats) -> Found | None:
    """The solution of the system of the sets near the multipliers `lam`; None if their system is singular."""
    with suppress(LinAlgError):
        return on_sets(program, law, sets, response, lam)
    with suppress(LinAlgError):
        once = without_redundant_rows(program.operators, sets, lam, law.weights)
        return on_sets(program, law, once, response, lam)
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
