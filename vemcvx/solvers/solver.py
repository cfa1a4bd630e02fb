"""The base class of solvers: settings, and `prepare`, which returns the object that solves the steps of a run."""

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
"""Fraction of the requested accuracy or gap that one of several errors may take."""
TARGET_FRACTION = 0.01
"""Negligible fraction of the requested gap."""


class Prepared(Protocol):
    """A solver ready for all steps of one run."""

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        """Solve one scaled step; if the target cannot be reached, return the best answer, and explain in `status` why.

        Parameters
        ----------
        program : StepProgram
            The scaled program, with the operators given to `prepare`.
        target : float
            Requested duality gap, in the units of the scaled program.
        lam, p : (m, block) and (r,) arrays
            A guess of the multipliers, predicted from earlier steps; p is zero by default.
        """


class Solver(ABC):
    """The settings of a solver; `prepare` returns an object that solves the programs of one run.

    A subclass defines the method `prepare`, and `accepts` as a class attribute or a property.

    Attributes
    ----------
    accuracy : float
        Requested relative energy error of a step, in (0, 1): |d - d*|_K <= accuracy times the largest energy norm of
        the states so far. The target of a step's duality gap is half the square of this bound.
    semidefinite : bool
        True if the solver accepts a K with a kernel, `operators.kernel`: only friction and contact then hold a body.
    any_units : bool
        True if the solver works in any units; other solvers receive scaled programs.

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
        """Check the settings."""
        self.check_accuracy()

    def __repr__(self) -> str:
        """Return the name and the settings, which are the public attributes."""
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
            The matrices K, B, D and the compliances, scaled; they are the same in every step. If K is dense,
            the programs are condensed: norm terms or limits act on every unknown. `operators.factor` solves with K.

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
        """Return the solver with another accuracy. Override it if other settings depend on the accuracy."""
        other = copy(self)
        object.__setattr__(other, "accuracy", accuracy)  # Settings may be frozen.
        return other

    def check_accuracy(self) -> None:
        """Raise SceneError if the accuracy is not a number in (0, 1)."""
        part(self.accuracy, self.name, "accuracy", "a relative energy error", "1e-6")


class ScaledFactor(Factor):
    """A factor of K / kappa, made from a factor of K."""

    def __init__(self, factor: Factor, kappa: float):
        self._factor, self._kappa, self.exact = factor, kappa, factor.exact

    def solve(self, b: Floats) -> Floats:
        """Return x with K x = kappa b."""
        return self._kappa * self._factor.solve(b)


class ScaledSolver:
    """A wrapper that scales programs for a prepared solver, because the tolerances of solvers have no units.

    The stiffness `kappa` of a run is the size of diag(K). The length alpha of a step is the size of its data in the
    energy norm, divided by the root of kappa. With d = alpha d^, where ^ marks scaled data, the program is

        K^ = K / kappa,  c^ = c kappa,  (g^, w^) = (g, w) / (kappa alpha),  (b^, e^) = (b, e) / alpha,

    and (lam, p) = kappa alpha (lam^, p^). kappa and alpha are powers of two, so that scaling does not round.
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
        """Return the length alpha of a step; 1.0 if its data vanish."""
        # However far supports or ground move at a term, friction loads the body there by at most the weight.
        operators = program.operators
        forced, flexible = lengths(operators.blocks(program.b)), operators.norm_flexibility
        drawn = np.minimum(forced, program.finite_weights * flexible) / np.sqrt(
            np.where(flexible > 0, flexible, np.inf)
        )
        size = max(program.size, float(drawn.max(initial=0.0))) / np.sqrt(self.kappa)
        if operators.kernel is not None:  # A floating body moves as far as the ground that carries it.
            size = max(size, np.abs(program.b).max(initial=0.0))
        return float(power_of_two(size)) if size > 0 else 1.0

    def scale(self, program: StepProgram, alpha: float) -> StepProgram:
        """Return the scaled program of a step."""
        force = self.kappa * alpha
        return StepProgram(self.operators, program.g / force, program.w / force, program.b / alpha, program.e / alpha)

    def restore(self, answer: Answer, alpha: float) -> Answer:
        """Return an answer to a scaled program in the units of the original program."""
        force = self.kappa * alpha
        return replace(answer, d=alpha * answer.d, lam=force * answer.lam, p=force * answer.p)

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        """Solve the scaled program of a step, and return the answer in the step's units."""
        alpha = self.length(program)
        force, scaled = self.kappa * alpha, self.scale(program, alpha)
        pressed = np.zeros_like(program.e) if p is None else p
        found = self.prepared.solve(scaled, target / (force * alpha), lam / force, pressed / force)
        return self.restore(read_answer(found, scaled, self.name), alpha)


@contextmanager
def name_failures(solver: str) -> Iterator[None]:
    """Convert a solver's own errors into SolverFailed with its name; errors of this package pass unchanged."""
    try:
        yield
    except (VemcvxError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        words = " ".join(str(error).split()).rstrip(".")
        raise SolverFailed(f"solver {solver}: it failed: {type(error).__name__}: {words}.") from error
