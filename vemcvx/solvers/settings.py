"""What solvers are asked for through cvxpy: their own settings for a duality gap of a scaled program, in one table.

Where nothing stands, a solver runs as its library comes. What was "certified" is the relative error, asked for 1e-6, of
problems/feng_han_huang.py and hertz_contact.py with --n 8 or 16 and --steps 4 or 8.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from vemcvx.program.tolerances import CONIC_GAP, CONIC_RESIDUAL, CONIC_TOLERANCE


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
        """In words."""
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
        """Its value for a gap."""
        return self.value.at(gap) if isinstance(self.value, OfGap) else self.value

    @property
    def words(self) -> str:
        """Its value, and when it is set."""
        return f"{self.value} {self.when.value}".rstrip()


TIGHT = OfGap(CONIC_TOLERANCE, 1e-14)
"""Of solvers whose tolerances are the same for gap and residuals; what they mean differs from solver to solver."""
SHORT = OfGap(CONIC_TOLERANCE, 1e-13)
"""The same, of solvers that reach no less."""

_ECOS = (
    Setting("abstol", TIGHT, "by default, 1e-8, certified 5e-5"),
    Setting("reltol", TIGHT, "by default, 1e-8, certified 5e-5"),
    Setting("feastol", OfGap(CONIC_RESIDUAL, 1e-10, power=0.5), "an imbalance counts by its square"),
)

TUNED: Mapping[str, tuple[Setting, ...]] = {
    "CLARABEL": (
        Setting("tol_gap_abs", OfGap(CONIC_GAP, 1e-15), "its gap is not that of the certificate"),
        Setting("tol_gap_rel", OfGap(CONIC_GAP, 1e-15), "its gap is not that of the certificate"),
        Setting("tol_feas", OfGap(CONIC_RESIDUAL, 1e-13, power=0.5), "an imbalance counts by its square"),
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
        Setting("eps_abs", OfGap(CONIC_RESIDUAL, 1e-11, 1e-7, power=0.5), "residuals, which count by their squares"),
        Setting("eps_rel", OfGap(CONIC_RESIDUAL, 1e-11, 1e-7, power=0.5), "residuals, which count by their squares"),
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


def settings_for(solver: str, gap: float, *, semidefinite: bool = False, again: bool = False) -> dict[str, Any]:
    """The settings of a solver for a gap; what is for fewer programs goes before what is for all."""
    now = {When.ALWAYS} | ({When.SEMIDEFINITE} if semidefinite else set()) | ({When.AGAIN} if again else set())
    return {setting.name: setting.at(gap) for setting in TUNED.get(solver, ()) if setting.when in now}


def worth_asking_again(solver: str) -> bool:
    """Whether there are settings for an answer that misses."""
    return any(setting.when is When.AGAIN for setting in TUNED.get(solver, ()))
