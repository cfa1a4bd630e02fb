"""Solvers that cvxpy can call, such as Clarabel and OSQP, with settings for a requested duality gap.

The settings are for scaled programs.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, ClassVar

import numpy as np

from vemcvx.base.arrays import Floats, brief, flag
from vemcvx.base.errors import NotAccepted, SceneError
from vemcvx.program.cvxpy_step import CvxpyStep, to_cvxpy
from vemcvx.program.operators import FEATURES, QUADRATIC, SECOND_ORDER_CONES, Operators
from vemcvx.program.step_program import Answer, StepProgram
from vemcvx.solvers.law import Weights
from vemcvx.solvers.newton import PreparedNewton
from vemcvx.solvers.solver import INNER_FRACTION, TARGET_FRACTION, Solver

Setting = float | str | Callable[[float], float]


def follow_gap(share: float, least: float, most: float = 1e-8, power: float = 1.0) -> Callable[[float], float]:
    """Return the function gap -> share * gap^power, clipped to [least, most]."""
    return lambda gap: float(np.clip(share * gap**power, least, most))


SHORT = follow_gap(TARGET_FRACTION, 1e-13)
"""The tolerance of solvers that break down at smaller tolerances."""
RESIDUAL = follow_gap(TARGET_FRACTION, 1e-11, 1e-7, power=0.5)
"""The tolerance of OSQP's residuals, whose squares enter the gap."""

TUNED: Mapping[str, Mapping[str, Setting]] = {
    "CLARABEL": {
        "tol_gap_abs": follow_gap(INNER_FRACTION, 1e-15),  # Clarabel's gap differs from the gap of the certificate
        "tol_gap_rel": follow_gap(INNER_FRACTION, 1e-15),
        "tol_feas": follow_gap(TARGET_FRACTION, 1e-13, power=0.5),  # squares of residuals enter the gap
        "max_threads": 1,  # two threads take three times as long as one thread
        "direct_solve_method": "faer",  # "qdldl" takes five times as long for problems/feng_han_huang.py
        "iterative_refinement_enable": False,  # refinement doubles the time, and rarely gains digits
        "presolve_enable": False,
        "equilibrate_enable": False,  # programs are scaled already
        "static_regularization_constant": 1e-15,  # with 1e-13, steps of feng_han_huang.py miss the accuracy
        "max_step_fraction": 0.999,  # saves 7 % of the iterations
    },
    "OSQP": {
        "eps_abs": RESIDUAL,
        "eps_rel": RESIDUAL,
        "eps_prim_inf": 1e-15,  # with the default, OSQP reports infeasible steps
        "eps_dual_inf": 1e-15,  # with the default, OSQP reports unbounded steps
        "max_iter": 100_000,  # the default, 4000, is too small
        "polishing": True,  # gains the last digits
        "polish_refine_iter": 10,
    },
    "SCS": {
        "eps_abs": SHORT,  # the default leads to certified errors of 2e-3
        "eps_rel": 0.0,  # data are scaled already
        "max_iters": 200_000,  # small tolerances take many iterations
        "normalize": False,  # programs are scaled already
    },
    "HIGHS": {"qp_regularization_value": 0.0},  # the default leads to certified errors of 4e-6
}
"""The settings by solver, under the names of cvxpy."""

SEMIDEFINITE = {"CLARABEL": {"static_regularization_constant": 1e-13}}  # for problems/hard_cases.py
"""Settings that replace settings in `TUNED` if the stiffness matrix K is semidefinite."""

RETRY = {
    "CLARABEL": {
        "iterative_refinement_enable": True,  # gains the missing digits
        "static_regularization_constant": 1e-13,  # more steps reach the accuracy than with 1e-15
        "max_step_fraction": 0.99,  # with .999, certified errors are four times as large
    }
}
"""Settings that replace settings in `TUNED` if a step is solved again."""

COMPILING = threading.Lock()
"""The lock of cvxpy's compiler, whose counter of expressions is not thread-safe."""
LINEAR = FEATURES - {SECOND_ORDER_CONES}
"""The features of quadratic programs with linear constraints."""


@cache
def list_installed() -> tuple[str, ...]:
    """Return the names of the solvers that cvxpy finds."""
    import cvxpy as cp

    return tuple(cp.installed_solvers())


def interfaces() -> tuple[Mapping[str, object], Mapping[str, object]]:
    """Return cvxpy's interfaces to conic solvers and to quadratic solvers, by name."""
    from cvxpy.reductions.solvers.defines import SOLVER_MAP_CONIC, SOLVER_MAP_QP

    return SOLVER_MAP_CONIC, SOLVER_MAP_QP


@dataclass(frozen=True)
class ThroughCvxpy(Solver):
    """Any solver that cvxpy can call.

    Parameters
    ----------
    solver : str
        The solver's name in cvxpy, in upper or lower case: "SCS", "HIGHS", "PIQP", "MOSEK", ...
    accuracy : float
        Requested relative energy error of a step, for the certificate.
    polish : bool
        True to improve every answer by one active-set step of our Newton method.
    options : mapping, optional
        Options of the solver, which replace the tuned settings of the same name.
    tuned : bool
        True for the settings in `TUNED`, False for the defaults of the solver's library.

    Examples
    --------
    >>> system = vx.System(K=np.eye(1), load=lambda t: [3.0 * t], norms=vx.Norms(B=np.eye(1), w=1.0))
    >>> run = vx.march(system, [0.0, 1.0], solver=vx.ThroughCvxpy("clarabel", options={"max_iter": 100}))
    >>> bool(run.certificate[-1] <= 1e-6)
    True
    """

    solver: str
    accuracy: float = 1e-6
    polish: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)
    tuned: bool = True

    semidefinite = True

    def __post_init__(self) -> None:
        if not isinstance(self.solver, str):
            raise SceneError(f"ThroughCvxpy: found solver = {brief(self.solver)}; wanted a name in cvxpy, like 'SCS'.")
        object.__setattr__(self, "solver", self.solver.upper())
        super().__post_init__()
        flag(self.polish, f"{self.name}: polish")
        flag(self.tuned, f"{self.name}: tuned")
        named = isinstance(self.options, Mapping) and all(isinstance(name, str) for name in self.options)
        if not named:
            raise SceneError(f"{self.name}: found options = {brief(self.options)}; wanted a dict of names to values.")

    @property
    def name(self) -> str:
        return self.solver

    @property
    def cones(self) -> bool:
        """True if the solver accepts second-order cones."""
        import cvxpy as cp

        return cp.SOC in getattr(interfaces()[0].get(self.solver), "SUPPORTED_CONSTRAINTS", ())

    @property
    def accepts(self) -> frozenset[str]:
        conic, quadratic = interfaces()
        # cvxpy lists solvers of linear programs, such as GLPK, as conic solvers.
        linear_only = self.solver in conic and self.solver not in quadratic and not self.cones
        return FEATURES if self.cones else LINEAR - ({QUADRATIC} if linear_only else set())

    def prepare(self, operators: Operators) -> _PreparedConic:
        if self.solver not in list_installed():
            raise NotAccepted(
                f"solver {self.solver!r}: cvxpy does not find it here; it finds {', '.join(sorted(list_installed()))}. "
                "Install it, or choose one of those."
            )
        return _PreparedConic(self, PreparedNewton(operators, 1))

    def choose_options(self, gap: float, *, semidefinite: bool) -> dict[str, Any]:
        """Return the solver's options for the gap of a scaled program."""
        tuned: dict[str, Any] = dict(TUNED.get(self.solver, {})) if self.tuned else {}
        if self.tuned and semidefinite:
            tuned |= SEMIDEFINITE.get(self.solver, {})
        at_gap = {name: value(gap) if callable(value) else value for name, value in tuned.items()}
        return at_gap | dict(self.options)

    def for_second_attempt(self) -> ThroughCvxpy:
        """Return the solver with the settings of `RETRY`."""
        sharper = RETRY.get(self.solver, {}) if self.tuned else {}
        return replace(self, options={**sharper, **self.options})


@dataclass(frozen=True)
class Clarabel(ThroughCvxpy):
    """The interior-point solver Clarabel, through cvxpy.

    Parameters
    ----------
    accuracy, polish, options, tuned
        See :class:`ThroughCvxpy`.

    Examples
    --------
    >>> system = vx.System(K=np.eye(1), load=lambda t: [3.0 * t], norms=vx.Norms(B=np.eye(1), w=1.0))
    >>> vx.march(system, [0.0, 1.0], solver=vx.Clarabel(accuracy=1e-8)).state[-1].round(6)
    array([2.])
    """

    solver: str = field(default="CLARABEL", init=False)

    accepts: ClassVar[frozenset[str]] = FEATURES

    @property
    def name(self) -> str:
        return "Clarabel"


@dataclass(frozen=True)
class OSQP(ThroughCvxpy):
    """The operator-splitting solver OSQP, through cvxpy, without second-order cones.

    Parameters
    ----------
    accuracy, polish, options, tuned
        See :class:`ThroughCvxpy`.

    Examples
    --------
    >>> system = vx.System(K=np.eye(1), load=lambda t: [3.0 * t], norms=vx.Norms(B=np.eye(1), w=1.0))
    >>> vx.march(system, [0.0, 1.0], solver=vx.OSQP(accuracy=1e-8)).state[-1].round(6)
    array([2.])
    """

    solver: str = field(default="OSQP", init=False)

    accepts: ClassVar[frozenset[str]] = LINEAR


class _PreparedConic:
    """A step as a problem in cvxpy, compiled once if K is dense."""

    def __init__(self, settings: ThroughCvxpy, newton: PreparedNewton):
        self._settings, self._newton = settings, newton
        # Compiled steps, and data for warm starts, by the set of terms that always stick.
        self._compiled: dict[bytes, tuple[CvxpyStep, dict[str, Any]]] = {}

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        operators, stuck = program.operators, program.stuck
        data = program.g, program.finite_weights, program.b, program.e
        with COMPILING:
            if isinstance(operators.K, np.ndarray):
                if (key := stuck.tobytes()) not in self._compiled:
                    self._compiled[key] = to_cvxpy(operators, None, stuck), {}
                step, kept = self._compiled[key]
                step.at(data)
            else:
                step, kept = to_cvxpy(operators, data, stuck), {}
        options = self._settings.choose_options(target, semidefinite=operators.kernel is not None)
        status, iterations = _run(step, kept, self._settings, options)
        still = np.zeros_like(program.g), np.zeros((operators.count, operators.block)), np.zeros_like(program.e)
        found = still if step.d.value is None else (step.d.value, step.lam, step.p)
        # Interior-point methods may violate bounds by rounding.
        d, lam, p = program.admissible_point(*found)
        answer = Answer(d, lam, iterations, status, p=p)
        return polish_answer(self._newton, program, answer) if self._settings.polish else answer


def polish_answer(newton: PreparedNewton, program: StepProgram, answer: Answer) -> Answer:
    """Return the answer after one Newton step, if the step reduces the gap."""
    sharper = newton.solve_from(program, Weights(program.w), answer)
    d, lam, p = program.admissible_point(sharper.d, sharper.lam, sharper.p)
    if not program.duality_gap(d, lam, p) < program.duality_gap(answer.d, answer.lam, answer.p):
        return answer
    return Answer(d, lam, answer.iterations + 1, answer.status + ", polished", p=p)


def _run(step: CvxpyStep, kept: dict[str, Any], settings: ThroughCvxpy, options: dict[str, Any]) -> tuple[str, int]:
    """Return the status and the number of iterations."""
    from cvxpy.error import SolverError
    from cvxpy.settings import SOLUTION_PRESENT

    problem = step.problem
    verbose, warm_start = bool(options.pop("verbose", False)), bool(options.pop("warm_start", True))
    step.d.save_value(None)
    try:
        with COMPILING:
            data, chain, inverse = problem.get_problem_data(settings.solver, solver_opts=options)
        raw = chain.solver.solve_via_data(data, warm_start, verbose, options, kept)
        solution = chain.invert(raw, inverse)
    except SolverError as error:
        return f"failed: {error}", 0
    except (TypeError, ValueError, AttributeError) as error:
        if not settings.options:
            raise
        raise NotAccepted(
            f"solver {settings.name}: refused the options {dict(settings.options)}: {str(error).rstrip('.')}. "
            "They must be options of this solver, under the names that cvxpy passes on."
        ) from error
    if solution.status in SOLUTION_PRESENT:
        problem.unpack(solution)
    return str(solution.status), int(solution.attr.get("num_iters") or 0)
