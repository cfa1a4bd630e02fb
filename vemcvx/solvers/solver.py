"""The base of solvers: settings, prepared once for the operators of a run, then asked step by step.

A solver sees scaled programs (:mod:`vemcvx.program.scaling`), unless it says that it solves them in `any_units`. It
knows nothing of what they are about, and is believed in nothing: the caller certifies every answer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, Self

import numpy as np

from vemcvx.base.arrays import Floats, part
from vemcvx.base.errors import SolverFailed, VemcvxError
from vemcvx.program.operators import Operators
from vemcvx.program.scaling import Scaling
from vemcvx.program.step_program import Answer, StepProgram, read_answer

SHARE = 0.1
"""Part of an accuracy, or of a gap, that is asked for where other errors come on top: of a step that missed, whose size
is known now; of each program of a law; of the unknowns inside at a stored step; of Clarabel, whose gap is another."""
UNSEEN = 0.01
"""Part that does not count beside what is asked for: tolerances of residuals, which count by their squares, and those
whose meaning differs from solver to solver."""


class Prepared(Protocol):
    """A solver ready for all steps of one run."""

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        """Answer one scaled step.

        An answer that misses the target is no error: give the best there is, and say in its `status` why.

        Parameters
        ----------
        program : StepProgram
            Scaled, with the operators that were prepared.
        target : float
            The duality gap asked for, in the units of the scaled program.
        lam, p : (m, block) and (r,) arrays
            A guess: the multipliers that the steps before let expect, with the signs of
            :class:`vemcvx.program.step_program.StepProgram`; no forces of limits by default.
        """


class Solver(ABC):
    """A solver of steps' programs: its settings alone; the object that `prepare` returns belongs to a run.

    A subclass has an attribute `accuracy`, a class attribute or property `accepts`, and `prepare`; the rest may stay as
    it is here. A frozen dataclass of settings serves well: its accuracy is checked when it is made.

    Attributes
    ----------
    accuracy : float
        The certified relative energy error asked of a step, between 0 and 1: |d - d*|_K <= accuracy times the largest
        energy norm of the states so far. The target of a step's duality gap is half the square of that.
    semidefinite : bool
        True if it takes a K with a kernel, `operators.kernel`; scenes in which friction and contact alone hold a body
        are refused to others.
    any_units : bool
        True if it solves programs in any units alike; others are given scaled ones.
    instead : str
        A sentence that says by which setting a program with features that it does not accept could be handed to it.
    """

    accuracy: float = 1e-6
    semidefinite: bool = False
    any_units: bool = False
    instead: ClassVar[str] = ""

    def __post_init__(self) -> None:
        """Refuse settings that mean nothing."""
        self.check_accuracy()

    def __repr__(self) -> str:
        """Return name and settings, which are the public attributes."""
        settings = ", ".join(f"{name}={value!r}" for name, value in sorted(vars(self).items()) if name[0] != "_")
        return f"{type(self).__name__}({settings})"

    @property
    def name(self) -> str:
        """The name that messages and tables use."""
        return type(self).__name__

    @property
    @abstractmethod
    def accepts(self) -> frozenset[str]:
        """The features of programs that it can solve, out of those in :mod:`vemcvx.program.operators`."""

    @property
    def advice(self) -> str:
        """Advice where the solver misses, beside asking for less."""
        return "use vx.Newton()"

    @abstractmethod
    def prepare(self, operators: Operators) -> Prepared:
        """Do what all steps share.

        Parameters
        ----------
        operators : Operators
            K, B, D and the compliances, scaled: they are the same in every step. Where K is dense, n is the number of
            unknowns that norm terms and limits read; `operators.factor` solves with K.

        Raises
        ------
        NotAccepted
            The solver is not installed.
        """

    def asked(self, accuracy: float) -> Self:
        """Return the solver asked for another accuracy; to be overridden where other settings depend on that."""
        other = copy(self)
        object.__setattr__(other, "accuracy", accuracy)  # Settings may be frozen.
        return other

    def check_accuracy(self) -> None:
        """Raise SceneError for an accuracy that means nothing."""
        part(self.accuracy, self.name, "accuracy", "a relative energy error", "1e-6")


@dataclass(frozen=True, eq=False)
class InUnits:
    """A solver whose tolerances are plain numbers, prepared for scaled programs (:mod:`vemcvx.program.scaling`)."""

    prepared: Prepared
    scaling: Scaling
    name: str

    @classmethod
    def of(cls, solver: Solver, operators: Operators) -> InUnits:
        """The solver, prepared for the scaled operators."""
        scaling = Scaling.of(operators)
        return cls(solver.prepare(scaling.operators), scaling, solver.name)

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        """Answer one step, which the solver gets scaled."""
        alpha = self.scaling.length(program)
        force, scaled = self.scaling.kappa * alpha, self.scaling.scale(program, alpha)
        pressed = np.zeros_like(program.e) if p is None else p
        answer = self.prepared.solve(scaled, self.scaling.energy(target, alpha), lam / force, pressed / force)
        answer = self.scaling.restore(read_answer(answer, scaled, self.name), alpha)
        # Interior points leave forces at gaps that were cut, too.
        return replace(answer, p=np.where(alpha * scaled.e < program.e, 0.0, answer.p))


@contextmanager
def named_failures(solver: str) -> Iterator[None]:
    """Raise SolverFailed, with the name of the solver, for errors of its own; those of this package pass."""
    try:
        yield
    except (VemcvxError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        words = " ".join(str(error).split()).rstrip(".")
        raise SolverFailed(f"solver {solver}: it failed: {type(error).__name__}: {words}.") from error
