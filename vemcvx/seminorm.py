"""Asking a solver for one step, also where K has a kernel: the proximal point method on the anchors.

Solvers are asked for positive definite programs only; the theory stands in :mod:`vemcvx.kernel`. Each proximal point
is judged by the gap of the program that was posed, in the seminorm of K.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vemcvx.certificate import duality_gap
from vemcvx.kernel import Kernel, refuse_unheld, unheld
from vemcvx.program import Answer, StepProgram
from vemcvx.solvers import Prepared

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_POINTS = 60
PATIENCE = 3
"""Proximal points in a row that may bring no better gap: solvers stop at their own rounding."""
SHARP = 1e-4
"""Points go on below the target, down to this part of it: they are cheap."""


def answered(prepared: Prepared, program: StepProgram, target: float, lam: Floats) -> Answer:
    """The solver's answer to a step, with admissible multipliers.

    Parameters
    ----------
    prepared : Prepared
        For ``program.form.regular``.
    program : StepProgram
    target : float
        Duality gap that is good enough.
    lam : (m, block) array
        Multipliers to start from.
    """
    if program.form.kernel is None:
        answer = prepared.solve(program, target, lam)
        return replace(answer, lam=program.project(answer.lam))
    return _proximal(prepared, program, target, lam)


def refuse_unbalanced(program: StepProgram, kernel: Kernel, touched: Ints, n: int, t: float) -> None:
    """Raise SceneError when no friction forces balance the load of step `n` on K's kernel.

    Parameters
    ----------
    touched : (m,) array
        The unknowns of `kernel` that the program has.
    """
    form = program.form
    motion = unheld(program.w, form.grip, form.kernel.T @ program.g)  # type: ignore[union-attr]
    if motion is None:
        return
    field = form.kernel @ motion  # type: ignore[operator]
    field /= np.abs(field).max()
    felt = np.linalg.norm(form.blocks(form.rows.read(field)), axis=1)
    parts = np.linalg.lstsq(kernel.modes[touched], field, rcond=None)[0]
    refuse_unheld(kernel, parts, program.w, float(field @ program.g), felt, n, t)


def _proximal(prepared: Prepared, program: StepProgram, target: float, lam: Floats) -> Answer:
    form = program.form
    d = np.zeros(len(program.g))
    best, least, waited = Answer(d, program.project(lam), 0, "nothing answered"), np.inf, 0
    iterations = safeguards = 0
    for _ in range(MOST_POINTS):
        nearby = StepProgram(form.regular, program.g + form.anchor * d, program.w, program.b)
        answer = prepared.solve(nearby, target, lam)
        iterations, safeguards = iterations + answer.iterations, safeguards + answer.safeguards
        d, lam = answer.d, program.project(answer.lam)
        gap = duality_gap(program, d, lam)
        waited = 0 if gap <= 0.5 * least else waited + 1
        if gap < least:
            best, least = replace(answer, lam=lam), gap
        if least <= SHARP * target or waited >= PATIENCE:
            break
    return replace(best, iterations=iterations, safeguards=safeguards)
