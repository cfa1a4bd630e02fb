"""Friction that follows pressure or slip, for solvers that take given weights only: a fixed point of programs.

With T(w) the answer of the step's program for the weights w, the law asks for w = law(p(T(w)), |s(T(w))|). The next
weights come from one Newton step on the active sets of the answer, with the slopes of the law; where sets have settled
they are those of the solution. Newton's method itself (:mod:`vemcvx.solvers.newton`) takes laws as they are.

Whichever way an answer was found, its certificate is that of the program whose weights are those of the answer's own
pressure and slip: a bound on the error for the given friction. What the law's answer is off beside that, in weights,
is none: the law is met exactly by what is certified.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vemcvx.base.arrays import Floats, lengths
from vemcvx.program.step_program import Answer, StepProgram, fitting
from vemcvx.solvers import Solver
from vemcvx.solvers.law import StepLaw
from vemcvx.solvers.newton import PreparedNewton, gap_under
from vemcvx.solvers.solver import SHARE

MOST_PROGRAMS = 40
PATIENCE = 12
"""Programs in a row that do not halve the least gap before the fixed point is given up."""


def followed(
    solver: Solver, prepared: Any, program: StepProgram, law: StepLaw, target: float, guess: tuple[Floats, Floats]
) -> Answer:
    """The answer of a scaled step under a law: its own pressures and slips have the weights that it answers."""
    if solver.follows:
        return fitting(prepared.solve(program, target, *guess, law=law), program, solver.name)
    newton = PreparedNewton(program.operators, 1)
    # Friction under the earlier pressures may be too weak to hold a body without supports: at first it holds any load.
    floats = program.operators.kernel is not None
    w = np.full(len(program.w), np.abs(program.g).sum()) if floats else program.w
    best, least, waited, iterations = None, np.inf, 0, 0
    for _ in range(MOST_PROGRAMS):
        posed = replace(program, w=w)
        answer = fitting(prepared.solve(posed, SHARE * target, *guess), posed, solver.name)
        d, lam, p = posed.admissible_point(answer.d, answer.lam, answer.p)
        answer, iterations = replace(answer, d=d, lam=lam, p=p), iterations + answer.iterations
        gap = gap_under(program, law, answer)
        waited = 0 if gap <= 0.5 * least else waited + 1
        if best is None or gap < least:
            best, least = answer, gap
        if least <= target or waited == PATIENCE or iterations >= solver.max_iterations:
            break
        guess = lam, p
        # Where that has gained nothing the plain weights are taken: they break cycles of sets.
        ahead = answer if waited else newton.begun_at(program, law, answer)
        w = law.at(ahead.p, lengths(program.slip(ahead.d)))
    assert best is not None
    return replace(best, iterations=iterations)
