"""What every solver is: settings, prepared once for the operators of a run, then asked step by step.

A solver sees scaled programs only (:mod:`vemcvx.program.scaling`), knows nothing of what they are about, and is
believed in nothing: the caller certifies every answer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, Protocol

import numpy as np

from vemcvx.arguments import is_whole, part
from vemcvx.arrays import Floats, brief
from vemcvx.errors import SceneError
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import Answer, StepProgram


class Prepared(Protocol):
    """A solver ready for all steps of one run."""

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        """Answer one scaled step.

        Parameters
        ----------
        program : StepProgram
            Scaled, with the operators that were prepared.
        target : float
            The duality gap asked for, in the units of the scaled program.
        lam, p : (m, block) and (r,) arrays
            A guess: the multipliers of the step before; no forces of limits by default.
        """


class Solver(ABC):
    """Settings of a solver: a frozen dataclass without state.

    Its fields are what summaries name, what a resumed run compares, and what :func:`vemcvx.adapt` replaces. One of them
    is `accuracy`, the certified relative energy error asked of a step (the gap is its square). The class attribute
    `accepts` names the features of programs that it can solve, out of those in :mod:`vemcvx.program.operators`. A field
    `max_iterations`, if there is one, limits the iterations of a step; `polish` is named in advice.
    """

    accuracy: float
    accepts: ClassVar[frozenset[str]]
    semidefinite: ClassVar[bool] = False
    """whether it takes a K with a kernel; others are asked for proximal points (:mod:`vemcvx.program.kernel`)"""

    def __post_init__(self) -> None:
        """Refuse settings that mean nothing."""
        part(self.accuracy, self.name, "accuracy", "a relative energy error", "1e-6")

    @property
    def name(self) -> str:
        """The name that reports and files use."""
        return type(self).__name__

    @abstractmethod
    def prepare(self, operators: Operators) -> Prepared:
        """Do what all steps share.

        Raises
        ------
        NotAccepted
            The solver is not installed.
        """


def fitting(answer: Answer, program: StepProgram, solver: str) -> Answer:
    """What a solver answered, if it is an answer to this program.

    Raises
    ------
    SceneError
        It is no Answer, or its arrays are none of the program's shapes.
    """
    if not isinstance(answer, Answer) or not is_whole(answer.iterations):
        raise SceneError(f"solver {solver}: found the answer {brief(answer)}; wanted Answer(d, lam, iterations).")
    operators = program.operators
    shapes = {"d": program.g.shape, "lam": (operators.count, operators.block), "p": program.e.shape}
    for name, shape in shapes.items():
        found = getattr(answer, name)
        if not isinstance(found, np.ndarray) or found.shape != shape or found.dtype != float:
            raise SceneError(f"solver {solver}: found {name} = {brief(found)}; wanted an array of floats {shape}.")
    return answer
