"""Clarabel, OSQP, and any other solver that cvxpy can call, with the settings that a duality gap asks for.

TUNED has the settings for a duality gap of a scaled program; where nothing stands, a solver runs as its library comes.
"Certified" there is the relative error that a request for 1e-6 reached.

Solvers without cones are handed absolute values as inequalities; so are those with cones when they miss. A cone's
algebra takes t - |s| as a difference, which where a term slips is as small as the gap: below 1e-12 no digits are left.
Inequalities carry it as a slack of its own.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np

from vemcvx.base.arrays import Floats, brief, flag, is_whole
from vemcvx.base.errors import NotAccepted, SceneError
from vemcvx.program.operators import FEATURES, QUADRATIC, SECOND_ORDER_CONES, Operators
from vemcvx.program.step_program import Answer, CvxpyStep, StepProgram, to_cvxpy
from vemcvx.solvers.law import GivenWeights
from vemcvx.solvers.newton import PreparedNewton
from vemcvx.solvers.solver import SHARE, UNSEEN, Solver


@dataclass(frozen=True)
class OfGap:
    """A tolerance that follows the gap asked for: share * gap^power, within bounds."""

    share: float
    least: float
    most: float = 1e-8
    power: float = 1.0

    def at(self, gap: float) -> float:
        """The tolerance for a gap."""
        return float(np.clip(self.share * gap**self.power, self.least, self.most))

    def __str__(self) -> str:
        what = "gap" if self.power == 1 else f"gap^{self.power:g}"
        return f"{self.share:g} {what}, {self.least:g} to {self.most:g}"


class When(Enum):
    """The programs that a setting is for; the value is how a table says it."""

    ALWAYS = ""
    SEMIDEFINITE = "where K is only semidefinite"
    AGAIN = "asked again after a miss"


@dataclass(frozen=True)
class Setting:
    """One setting of one solver, by the name that cvxpy passes on, and why."""

    name: str
    value: OfGap | float | str
    why: str
    when: When = When.ALWAYS

    def at(self, gap: float) -> float | str:
        """The value for a gap."""
        return self.value.at(gap) if isinstance(self.value, OfGap) else self.value

    @property
    def words(self) -> str:
        """The value, and the case in which it is set."""
        return f"{self.value} {self.when.value}".rstrip()


TIGHT = OfGap(UNSEEN, 1e-14)
"""The tolerance of solvers with one for gap and residuals, whose meaning differs from solver to solver."""
SHORT = OfGap(UNSEEN, 1e-13)
"""The same for solvers that break down below 1e-13."""

_ECOS = (
    Setting("abstol", TIGHT, "by default, 1e-8, certified 5e-5"),
    Setting("reltol", TIGHT, "by default, 1e-8, certified 5e-5"),
    Setting("feastol", OfGap(UNSEEN, 1e-10, power=0.5), "an imbalance counts by its square"),
)

TUNED: Mapping[str, tuple[Setting, ...]] = {
    "CLARABEL": (
        Setting("tol_gap_abs", OfGap(SHARE, 1e-15), "its gap is not that of the certificate"),
        Setting("tol_gap_rel", OfGap(SHARE, 1e-15), "its gap is not that of the certificate"),
        Setting("tol_feas", OfGap(UNSEEN, 1e-13, power=0.5), "an imbalance counts by its square"),
        Setting("max_threads", 1, "two threads are three times slower on the patterns cvxpy makes"),
        Setting("direct_solve_method", "faer", "4.6 s where qdldl takes 22 on the paper's full program"),
        Setting("iterative_refinement_enable", False, "doubles the time, mostly without a digit; done where it misses"),
        Setting("presolve_enable", False, "nothing to find"),
        Setting("equilibrate_enable", False, "programs come scaled"),
        Setting("static_regularization_constant", 1e-15, "with 1e-13 a sixth of the paper's steps stops at 1e6 gaps"),
        Setting("max_step_fraction", 0.999, "saves 7 % of the iterations"),
        # hard_cases.py: a K with one motion that its terms just hold.
        Setting("static_regularization_constant", 1e-13, "with 1e-15 ends at 6e-6 there", When.SEMIDEFINITE),
        Setting("iterative_refinement_enable", True, "worth its time there", When.AGAIN),
        # Where a fixed point asks for the last digits: janssen_silo.py. The steps: solver_accuracy.py.
        Setting("static_regularization_constant", 1e-13, "fewer steps miss than with 1e-15", When.AGAIN),
        Setting("max_step_fraction", 0.99, "the paper's steps reach 1e-8, with .999 4e-8", When.AGAIN),
    ),
    "OSQP": (
        Setting("eps_abs", OfGap(UNSEEN, 1e-11, 1e-7, power=0.5), "residuals, which count by their squares"),
        Setting("eps_rel", OfGap(UNSEEN, 1e-11, 1e-7, power=0.5), "residuals, which count by their squares"),
        Setting("eps_prim_inf", 1e-15, "by default takes a step for infeasible"),
        Setting("eps_dual_inf", 1e-15, "by default takes a step for unbounded"),
        Setting("max_iter", 100_000, "the default, 4000, ends before such tolerances"),
        Setting("polishing", True, "must be told on every solve; the digits come from it"),
        Setting("polish_refine_iter", 10, "the last digits of polishing"),
    ),
    "SCS": (
        Setting("eps_abs", SHORT, "by default, 1e-4, certified 2e-3; below 1e-13 some steps do not end"),
        Setting("eps_rel", 0.0, "data are scaled; relative to what differs from step to step"),
        Setting("max_iters", 200_000, "first order: small tolerances take many"),
        Setting("normalize", False, "programs come scaled"),
    ),
    "PIQP": (
        Setting("eps_abs", TIGHT, "by default, 1e-8, certified 1e-4"),
        Setting("eps_rel", TIGHT, "by default, 1e-9, certified 1e-4"),
    ),
    "QOCO": (
        Setting("abstol", SHORT, "by default, 1e-7, certified 8e-4; at 1e-14 it breaks down: 4e-1"),
        Setting("reltol", SHORT, "by default, 1e-7, certified 8e-4; at 1e-14 it breaks down: 4e-1"),
    ),
    "ECOS": _ECOS,
    "ECOS_BB": _ECOS,
    "PROXQP": (
        Setting("eps_abs", TIGHT, "by default, 1e-8, certified 2e-4"),
        Setting("warm_start", False, "an update of its last step fails where there are limits"),
    ),
    "HIGHS": (Setting("qp_regularization_value", 0.0, "by default, 1e-7, certified 4e-6; K is regular, or nearly so"),),
}


COMPILING = threading.Lock()
"""cvxpy numbers its expressions by a counter of the process, without a lock of its own."""

LINEAR = FEATURES - {SECOND_ORDER_CONES}
"""The features that fit a quadratic program with linear constraints."""


@cache
def installed() -> tuple[str, ...]:
    """Names of the solvers that cvxpy finds here, in its own order."""
    import cvxpy as cp

    return tuple(cp.installed_solvers())


def interfaces() -> tuple[Mapping[str, object], Mapping[str, object]]:
    """Return the interfaces by which cvxpy calls solvers of conic and of quadratic programs, by name."""
    from cvxpy.reductions.solvers.defines import SOLVER_MAP_CONIC, SOLVER_MAP_QP

    return SOLVER_MAP_CONIC, SOLVER_MAP_QP


@dataclass(frozen=True)
class ThroughCvxpy(Solver):
    """Any solver that cvxpy can call.

    Parameters
    ----------
    solver : str
        Its name in cvxpy, in any case of letters: "SCS", "HIGHS", "PIQP", "MOSEK", ...
    accuracy : float
        Certified relative energy error asked of a step.
    polish : bool
        Add one active-set step to every answer. Off by default, so that solvers stay independent.
    options : mapping, optional
        Passed on to the solver, over our own choices.
    tuned : bool
        Ask with the settings above; otherwise as the solver's library comes.
    """

    solver: str
    accuracy: float = 1e-6
    polish: bool = False
    options: Mapping[str, Any] = field(default_factory=dict)
    tuned: bool = True

    semidefinite = True

    def __post_init__(self) -> None:
        if not isinstance(self.solver, str):
            raise SceneError(f"ThroughCvxpy: found solver = {brief(self.solver)}; wanted its name in cvxpy, as 'SCS'.")
        object.__setattr__(self, "solver", self.solver.upper())
        super().__post_init__()
        flag(self.polish, f"{self.name}: polish")
        flag(self.tuned, f"{self.name}: tuned")
        named = isinstance(self.options, Mapping) and all(isinstance(name, str) for name in self.options)
        if not named:
            raise SceneError(f"{self.name}: found options = {brief(self.options)}; wanted a dict of its own names.")

    @property
    def name(self) -> str:
        return self.solver

    @property
    def advice(self) -> str:
        return super().advice if self.polish else f"use polish=True, or {super().advice.removeprefix('use ')}"

    @property
    def corners(self) -> Floats | None:
        """(P, 2) unit vectors to the corners of the polygons that discs are taken for, if they are."""
        return None

    @property
    def cones(self) -> bool:
        """True if the solver takes second-order cones."""
        import cvxpy as cp

        return cp.SOC in getattr(interfaces()[0].get(self.solver), "SUPPORTED_CONSTRAINTS", ())

    @property
    def accepts(self) -> frozenset[str]:
        conic, quadratic = interfaces()
        # Solvers of linear programs (SciPy's, GLPK, CBC) are conic ones to cvxpy, without second-order cones.
        linear_only = self.solver in conic and self.solver not in quadratic and not self.cones
        return FEATURES if self.cones else LINEAR - ({QUADRATIC} if linear_only else set())

    def prepare(self, operators: Operators) -> _PreparedConic:
        if self.corners is not None and operators.block > 2:
            raise NotAccepted(f"solver {self.name}: polygons are for norms of two components, not {operators.block}.")
        if self.solver not in installed():
            raise NotAccepted(
                f"solver {self.solver!r}: cvxpy does not find it here; it finds {', '.join(sorted(installed()))}. "
                "Install it, or choose one of those."
            )
        return _PreparedConic(self)

    @property
    def settings(self) -> tuple[Setting, ...]:
        """Our settings of it; those for fewer programs come last, and win over those for all."""
        return TUNED.get(self.solver, ()) if self.tuned else ()

    def asks_with(self, gap: float, *, semidefinite: bool, again: bool) -> dict[str, Any]:
        """Return the solver's options for a duality gap of a scaled program: tuned ones, the user's last."""
        now = {When.ALWAYS} | ({When.SEMIDEFINITE} if semidefinite else set()) | ({When.AGAIN} if again else set())
        return {**{one.name: one.at(gap) for one in self.settings if one.when in now}, **self.options}


@dataclass(frozen=True)
class Clarabel(ThroughCvxpy):
    """The interior-point solver Clarabel, through cvxpy, with one second-order cone for every |v_tau|."""

    solver: str = field(default="CLARABEL", init=False)

    accepts: ClassVar[frozenset[str]] = FEATURES

    @property
    def name(self) -> str:
        return "Clarabel"


@dataclass(frozen=True)
class OSQP(ThroughCvxpy):
    """The operator-splitting solver OSQP, through cvxpy, with absolute values; no second-order cones.

    Parameters
    ----------
    polygon : int, optional
        Replace discs of multipliers, |lam_i| <= w_i, by regular polygons with this many corners on the rim, at least 4.
        Certificates are those of the discs: gaps are up to 1 - cos(pi / polygon) of sum w_i |s_i|, .019 with 16. By
        default programs with discs are refused.
    """

    solver: str = field(default="OSQP", init=False)
    polygon: int | None = None

    instead: ClassVar[str] = "With polygon=16 it takes discs for polygons, and certifies what that misses."

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.polygon is not None and not (is_whole(self.polygon) and self.polygon >= 4):
            raise SceneError(f"OSQP: found polygon = {brief(self.polygon)}; wanted a number of corners, at least 4.")

    @property
    def accepts(self) -> frozenset[str]:
        return LINEAR if self.polygon is None else FEATURES

    @property
    def advice(self) -> str:
        return super().advice if self.polygon is None else f"raise polygon, or {super().advice}"

    @property
    def corners(self) -> Floats | None:
        if self.polygon is None:
            return None
        angles = 2 * np.pi * np.arange(self.polygon) / self.polygon
        return np.column_stack([np.cos(angles), np.sin(angles)])


class _PreparedConic:
    """The program compiled once, its data as parameters; on sparse K it is posed afresh every step.

    A parameter of load length compiles for 26 s at 33k unknowns, one of the length of the terms in milliseconds.
    """

    def __init__(self, settings: ThroughCvxpy):
        self._settings = settings
        # With cones or without: the step in cvxpy, and the solvers that cvxpy keeps for the next one, by name.
        self._compiled: dict[bool, tuple[CvxpyStep, dict[str, Any]]] = {}

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        cones = self._settings.cones
        answer = self._ask(program, target, cones)
        more = any(setting.when is When.AGAIN for setting in self._settings.settings)
        if more and _gap(program, answer) > target:
            again = self._ask(program, target, cones and program.operators.block > 1, again=True)
            # Beyond what it can reach the second may be the worse one, by a factor of 190 in gap.
            better = min(answer, again, key=partial(_gap, program))
            answer = replace(better, iterations=again.iterations + answer.iterations)
        return polished(program, answer) if self._settings.polish else answer

    def _ask(self, program: StepProgram, target: float, cones: bool, again: bool = False) -> Answer:
        operators, corners = program.operators, self._settings.corners
        with COMPILING:
            if isinstance(operators.K, np.ndarray):
                if cones not in self._compiled:
                    self._compiled[cones] = to_cvxpy(operators, None, cones, corners), {}
                step, kept = self._compiled[cones]
                step.at(program.data)
            else:
                step, kept = to_cvxpy(operators, program.data, cones, corners), {}
        options = self._settings.asks_with(target, semidefinite=operators.kernel is not None, again=again)
        status, iterations = _run(step, kept, self._settings, options)
        still = np.zeros_like(program.g), np.zeros((operators.count, operators.block)), np.zeros_like(program.e)
        found = still if step.d.value is None else (step.d.value, step.lam, step.p)
        # Interior points stop a rounding error short of their bounds, or beyond them.
        d, lam, p = program.admissible_point(*found)
        return Answer(d, lam, iterations, status, p=p)


def polished(program: StepProgram, answer: Answer) -> Answer:
    """Return one active-set step from an answer, or the answer: the better certified of the two."""
    d, lam, p = program.admissible_point(answer.d, answer.lam, answer.p)
    before = replace(answer, d=d, lam=lam, p=p)
    sharper = PreparedNewton(program.operators, 1).begun_at(program, GivenWeights(program.w), before)
    d, lam, p = program.admissible_point(sharper.d, sharper.lam, sharper.p)
    after = Answer(d, lam, answer.iterations + 1, answer.status + ", polished", p=p)
    return after if _gap(program, after) < _gap(program, before) else answer


def _gap(program: StepProgram, answer: Answer) -> float:
    return program.duality_gap(answer.d, answer.lam, answer.p)


def _run(step: CvxpyStep, kept: dict[str, Any], settings: ThroughCvxpy, options: dict[str, Any]) -> tuple[str, int]:
    """Solve in cvxpy's own steps, as its `solve` would warn of what the certificate measures; status and iterations."""
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
            f"solver {settings.name}: refused the options {dict(settings.options)}: {error}. "
            "They must be its own, by the names that cvxpy passes on."
        ) from error
    if solution.status in SOLUTION_PRESENT:
        problem.unpack(solution)
    return str(solution.status), int(solution.attr.get("num_iters") or 0)
