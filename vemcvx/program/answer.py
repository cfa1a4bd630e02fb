"""A solver's answer to a step's program, and what is taken for one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vemcvx.arguments import is_whole
from vemcvx.arrays import Floats, brief
from vemcvx.errors import SceneError, SolverFailed
from vemcvx.outline import ArrayRecord
from vemcvx.program.checks import of_shape
from vemcvx.program.step_program import StepProgram

PROMISED = "return vx.Answer(d, lam, iterations), (d, lam, p), (d, lam), or d"
LARGEST = 1e100
"""Entries of answers to scaled programs, whose data are about 1, are no answer above it: their squares are no numbers.
NaN is left to the certificate, which is infinite."""


@dataclass(frozen=True, repr=False, eq=False)
class Answer(ArrayRecord):
    """A solver's answer to one step; nothing is claimed about it before it is certified.

    Parameters
    ----------
    d : (n,) array
        Increments. Those beyond their bounds are moved back onto them.
    lam : (m, block) array
        Multipliers of the norm terms, K d = g - B'lam - D'p. Where they are too large they are projected.
    iterations : int
        As the solver counts them.
    status : str
        In the solver's own words, for messages.
    safeguards : int
        How many of the iterations were steps of a globally convergent method that stood in for a faster one.
    p : (r,) array
        Multipliers of the limits; negative ones are taken for zero.
    """

    d: Floats
    lam: Floats
    iterations: int
    status: str = ""
    safeguards: int = 0
    p: Floats = field(default_factory=lambda: np.zeros(0))


def fitting(answer: Answer, program: StepProgram, solver: str) -> Answer:
    """What a solver answered, if it is an answer to this program.

    Raises
    ------
    SolverFailed
        It is no Answer, its arrays are none of the program's shapes, or it has diverged.
    """
    if not isinstance(answer, Answer) or not is_whole(answer.iterations):
        raise SolverFailed(f"solver {solver}: found the answer {brief(answer)}; wanted Answer(d, lam, iterations).")
    for name, shape in program.shapes.items():
        found = getattr(answer, name)
        if not isinstance(found, np.ndarray) or found.shape != shape or found.dtype != float:
            raise SolverFailed(f"solver {solver}: found {name} = {brief(found)}; wanted an array of floats {shape}.")
        size = float(np.abs(found).max(initial=0.0))
        if size > LARGEST:
            raise SolverFailed(
                f"solver {solver}: {name} reaches {size:.1e}, and the program is scaled: the solver has diverged."
            )
    return answer


def read_answer(raw: Any, program: StepProgram, solver: str) -> Answer:
    """What somebody's `solve` returned, as an Answer; multipliers that are missing are recovered.

    Raises
    ------
    SolverFailed
        It is none, or of other sizes than the program's.
    """
    said = raw if isinstance(raw, Answer) else None
    parts = (said.d, said.lam, said.p) if said is not None else raw if isinstance(raw, tuple) else (raw,)
    shapes = program.shapes
    given = {key: np.zeros(shape) for key, shape in shapes.items() if 0 in shape}
    given |= {key: part for key, part in zip(shapes, parts, strict=False) if _there(part)}
    if len(parts) > len(shapes) or "d" not in given:
        raise SolverFailed(f"solver {solver}: found the answer {brief(raw)}; it must {PROMISED}.")
    try:
        read = {key: of_shape(part, f"solver {solver}: {key}", shapes[key]) for key, part in given.items()}
    except SceneError as error:
        raise SolverFailed(str(error)) from None
    d, lam, p = read["d"], read.get("lam"), read.get("p")
    if lam is None or p is None:
        with np.errstate(over="ignore", invalid="ignore"):  # What has diverged is refused for its size.
            d, lam, p = program.admissible_point(d, lam, p)
    if said is None:
        return Answer(d, lam, 0, p=p)
    return Answer(d, lam, said.iterations, said.status, said.safeguards, p=p)


def _there(raw: Any) -> bool:
    """Whether multipliers were given; an Answer's are empty by default."""
    return raw is not None and not (isinstance(raw, np.ndarray) and raw.size == 0)
