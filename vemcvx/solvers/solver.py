"""The base class of solvers, and a wrapper that scales programs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from typing import Protocol, Self

import numpy as np

from vemcvx.base.arrays import Floats, lengths, part, power_of_two
from vemcvx.base.errors import SolverFailed, VemcvxError
from vemcvx.linear import Factor
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import Answer, StepProgram, read_answer

INNER_FRACTION = 0.1
"""Fraction of the requested accuracy or gap for inner computations."""
TARGET_FRACTION = 0.01
"""Negligible fraction of the requested gap."""


class Prepared(Protocol):
    """A solver ready for all steps of one run."""

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        """Solve one scaled step. The `status` of the answer gives the reason for a missed target.

        Parameters
        ----------
        program : StepProgram
            The scaled program, with the operators given to `prepare`.
        target : float
            Requested duality gap, in the units of the scaled program.
        lam, p : (m, block) and (r,) arrays
            Predicted multipliers; p is zero by default.
        """


class Solver(ABC):
    """The settings of a solver. `prepare` returns an object that solves the programs of one run.

    A subclass defines the method `prepare`, and `accepts` as a class attribute or a property.

    Attributes
    ----------
    accuracy : float
        Requested relative energy error of a step, in (0, 1): |d - d*|_K <= accuracy E. Here d* is the exact answer, and
        E the largest energy norm of states so far. The target of the duality gap is (accuracy E)^2 / 2.
    semidefinite : bool
        True if the solver accepts matrices K with a kernel, for bodies that only friction and contact hold.
    any_units : bool
        True if the solver needs no scaled programs.

    Examples
    --------
    >>> class Mine(vx.Solver):
    ...     accepts = frozenset({vx.program.QUADRATIC})
    ...     def prepare(self, operators):
    ...         return self
    ...     def solve(self, program, target, lam, p=None):
    ...         return vx.Answer(program.operators.factor.solve(program.g), lam, 1)
    >>> vx.march(vx.System(np.eye(1), lambda t: [t]), [0.0, 1.0], solver=Mine()).state[-1]
    array([1.])
    """

    accuracy: float = 1e-6
    semidefinite: bool = False
    any_units: bool = False

    def __post_init__(self) -> None:
        self.check_accuracy()

    def __repr__(self) -> str:
        settings = ", ".join(f"{name}={value!r}" for name, value in sorted(vars(self).items()) if name[0] != "_")
        return f"{type(self).__name__}({settings})"

    @property
    def name(self) -> str:
        """The name that messages and tables use."""
        return type(self).__name__

    @property
    @abstractmethod
    def accepts(self) -> frozenset[str]:
        """The accepted features of programs: a subset of `FEATURES` (:mod:`vemcvx.program.operators`)."""

    @abstractmethod
    def prepare(self, operators: Operators) -> Prepared:
        """Prepare the solver for all steps of a run.

        Parameters
        ----------
        operators : Operators
            The scaled matrices K, B, D and compliances of all steps; `operators.factor` is the factor of K. K is
            dense if it contains only the unknowns of norm terms and limits.

        Returns
        -------
        Prepared
            An object with `solve`.

        Raises
        ------
        NotAccepted
            The solver is not installed.
        """

    def with_accuracy(self, accuracy: float) -> Self:
        """Return the solver with another accuracy. Override this method if settings depend on the accuracy."""
        other = copy(self)
        object.__setattr__(other, "accuracy", accuracy)  # Settings may be frozen.
        return other

    def check_accuracy(self) -> None:
        part(self.accuracy, self.name, "accuracy", "a relative energy error", "1e-6")


class ScaledFactor(Factor):
    """A factor of K / kappa, made from a factor of K."""

    def __init__(self, factor: Factor, kappa: float):
        self._factor, self._kappa, self.exact = factor, kappa, factor.exact

    def solve(self, b: Floats) -> Floats:
        return self._kappa * self._factor.solve(b)


class ScaledSolver:
    """A prepared solver that receives scaled programs.

    Let kappa be the largest entry of diag(K). Let alpha be an energy norm that a step could reach, times kappa^{-1/2}.
    Both numbers are rounded up to powers of two, so that scaling is exact. The scaled data of the `StepProgram`

        K^ = K / kappa,  c^ = c kappa,  (g^, w^) = (g, w) / (kappa alpha),  (b^, e^) = (b, e) / alpha

    have the answer d^ = d / alpha, (lam^, p^) = (lam, p) / (kappa alpha).
    """

    def __init__(self, solver: Solver, operators: Operators):
        self.name, self.kappa = solver.name, float(power_of_two(operators.K.diagonal().max(initial=0.0)))
        self.operators = replace(
            operators,
            K=operators.K / self.kappa,
            compliance=operators.compliance * self.kappa,
            given_factor=None if isinstance(operators.K, np.ndarray) else ScaledFactor(operators.factor, self.kappa),
        )
        self.prepared = solver.prepare(self.operators)

    def length(self, program: StepProgram) -> float:
        """Return alpha for a step, or 1.0 if all data are zero."""
        # The force of a norm term is at most the weight, even for large b.
        operators = program.operators
        forced, flexible = lengths(operators.blocks(program.b)), operators.norm_flexibility
        drawn = np.minimum(forced, program.finite_weights * flexible) / np.sqrt(
            np.where(flexible > 0, flexible, np.inf)
        )
        size = max(program.size, float(drawn.max(initial=0.0))) / np.sqrt(self.kappa)
        if operators.kernel is not None:  # A floating body may follow the ground.
            size = max(size, np.abs(program.b).max(initial=0.0))
        return float(power_of_two(size)) if size > 0 else 1.0

    def scale(self, program: StepProgram, alpha: float) -> StepProgram:
        force = self.kappa * alpha
        return StepProgram(self.operators, program.g / force, program.w / force, program.b / alpha, program.e / alpha)

    def restore(self, answer: Answer, alpha: float) -> Answer:
        force = self.kappa * alpha
        return replace(answer, d=alpha * answer.d, lam=force * answer.lam, p=force * answer.p)

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        alpha = self.length(program)
        force, scaled = self.kappa * alpha, self.scale(program, alpha)
        pressed = np.zeros_like(program.e) if p is None else p
        found = self.prepared.solve(scaled, target / (force * alpha), lam / force, pressed / force)
        return self.restore(read_answer(found, scaled, self.name), alpha)


@contextmanager
def name_failures(solver: str) -> Iterator[None]:
    """Convert errors of a solver's library into SolverFailed."""
    try:
        yield
    except (VemcvxError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        words = " ".join(str(error).split()).rstrip(".")
        raise SolverFailed(f"solver {solver}: it failed: {type(error).__name__}: {words}.") from error
