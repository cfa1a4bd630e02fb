"""Asking a solver for one step, also where K has a kernel: by the proximal point method on the anchors.

So solvers are asked that take positive definite programs only; the theory stands in :mod:`vemcvx.program.kernel`. Each
proximal point is judged by the gap of the program that was posed, in the seminorm of K.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import SceneError
from vemcvx.program.condensation import Condensation
from vemcvx.program.step_program import Answer, StepProgram
from vemcvx.program.tolerances import FURTHER_GAP

MOST_POINTS = 200
PATIENCE = 6
"""Proximal points in a row that may fail to halve the gap: solvers stop at their own rounding."""
IMPATIENCE = 2
"""The same of solvers that do not count their iterations."""
FARTHEST = 4.0
"""Times the last, which a centre may move: while a body slides on and on, secants go as far as their rounding says."""


Ask = Callable[[StepProgram, float, Floats, Floats, int], Answer]
"""(program, target, lam, p, iterations so far) -> the solver's answer"""


def answered(ask: Ask, program: StepProgram, target: float, lam: Floats, p: Floats) -> Answer:
    """The solver's answer to a step, with admissible multipliers.

    Parameters
    ----------
    ask : callable
    program : StepProgram
    target : float
        Duality gap that is good enough.
    lam, p : (m, block) and (r,) arrays
        Multipliers to start from.
    """
    answer = ask(program, target, lam, p, 0)
    d = program.feasible(answer.d)
    lam, p = program.admissible(answer.lam, answer.p, d)
    return replace(answer, d=d, lam=lam, p=p)


def refuse_unheld(program: StepProgram, condensation: Condensation, n: int, t: float) -> None:
    """Raise SceneError when no forces of friction and limits balance the load of step `n` on K's kernel."""
    operators, N, kernel = program.operators, program.operators.kernel, condensation.system.kernel
    motion = None if N is None else operators.hold.unheld(program.w, N.T @ program.g)
    if kernel is None or N is None or motion is None:
        return
    field = N @ motion
    parts = np.linalg.lstsq(kernel.modes[condensation.retained], field, rcond=None)[0].astype(float)
    # Unknowns of a joint that read a jump move by less than the bodies themselves.
    field /= np.abs(kernel.modes @ parts).max()
    felt = np.linalg.norm(operators.blocks(operators.rows.read(field)), axis=1)
    push, holds = float(field @ program.g), float(program.w @ felt)
    raise SceneError(
        f"step {n} at t = {t:.6g}: only friction and one-sided contact hold the body against {kernel.name(parts)}. "
        f"The load pushes it there with a force of {push:.6g} and friction holds {holds:.6g} at most: "
        f"{push - holds:.6g} are lacking, and there is no equilibrium. Change the load, raise the bound, add a "
        "support, or move the body by PrescribedDisplacement instead."
    )


def proximal(
    ask: Ask, most: float, program: StepProgram, target: float, lam: Floats, p: Floats, *, start: Floats | None = None
) -> Answer:
    """The same where K has a kernel and the solver takes none, in no more than `most` iterations and the last point's.

    Here `ask` answers programs of ``program.operators.regular``; the first centre is `start`, or zero. Points go on
    below the target while each still gains; but not with a solver that does not count its iterations (`most` is
    infinite): it may take long for each, and it stops at the target itself.
    """
    enough, patience = (FURTHER_GAP * target, PATIENCE) if most < np.inf else (target, IMPATIENCE)
    operators, d = program.operators, np.zeros(len(program.g)) if start is None else start
    lam, p = program.admissible(lam, p, d)
    best, least, waited = Answer(program.feasible(d), lam, 0, "nothing answered", p=p), np.inf, 0
    iterations = safeguards = 0
    centres = _Centres(np.flatnonzero(np.zeros(len(d)) if operators.anchor is None else operators.anchor))
    for _ in range(MOST_POINTS):
        answer = ask(program.proximal(d), target, lam, p, iterations)
        iterations, safeguards = iterations + answer.iterations, safeguards + answer.safeguards
        centre, d = d, program.feasible(answer.d)
        lam, p = program.admissible(answer.lam, answer.p, d)
        gap = program.duality_gap(d, lam, p)
        waited = 0 if gap <= 0.5 * least else waited + 1
        if gap < least:
            best, least = replace(answer, d=d, lam=lam, p=p), gap
        if least <= enough or waited >= patience or iterations >= most:
            break
        d = centres.next(centre, d)
    return replace(best, iterations=iterations, safeguards=safeguards)


def carried(program: StepProgram) -> Floats | None:
    """The motion without energy that goes best with b: where ground that moves would carry the body."""
    N = program.operators.kernel
    return None if N is None else N @ np.linalg.lstsq(program.operators.B @ N, program.b, rcond=None)[0]


class _Centres:
    """Where to put the next centre: Anderson's acceleration of the proximal points, in as many unknowns as anchors.

    The map from centre to proximal point is piecewise affine, so that secants through its last k + 1 values find its
    fixed point as soon as nothing changes sides any more. A centre that does worse than the one before starts anew.
    """

    def __init__(self, anchored: Ints):
        self._at = anchored
        self._centres: list[Floats] = []
        self._moves: list[Floats] = []

    def next(self, centre: Floats, d: Floats) -> Floats:
        """The next centre (n,), after the proximal point d of `centre`."""
        x, move = centre[self._at], (d - centre)[self._at]
        if self._moves and np.linalg.norm(move) > 2 * np.linalg.norm(self._moves[-1]):
            self._centres, self._moves = [], []
        self._centres, self._moves = [*self._centres, x][-len(x) - 1 :], [*self._moves, move][-len(x) - 1 :]
        ahead = d.copy()
        if len(self._moves) > 1:
            dx, df = np.diff(self._centres, axis=0).T, np.diff(self._moves, axis=0).T
            step = move - (dx + df) @ np.linalg.lstsq(df, move, rcond=1e-10)[0]
            size, far = np.linalg.norm(step), FARTHEST * np.linalg.norm(dx[:, -1])
            ahead[self._at] = x + (step * (far / size) if size > far else step)
        return ahead
