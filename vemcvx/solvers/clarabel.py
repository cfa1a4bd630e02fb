"""Clarabel, an interior-point method for cones."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from vemcvx.program.operators import SECOND_ORDER_CONES
from vemcvx.program.tolerances import CONIC_GAP, CONIC_RESIDUAL
from vemcvx.solvers.conic import LINEAR, ThroughCvxpy


@dataclass(frozen=True)
class Clarabel(ThroughCvxpy):
    """The interior-point solver Clarabel, through cvxpy, with one second-order cone for every |v_tau|."""

    solver: str = field(default="CLARABEL", init=False)

    accepts: ClassVar[frozenset[str]] = LINEAR | {SECOND_ORDER_CONES}

    @property
    def name(self) -> str:
        return "Clarabel"

    def tolerances(self, target: float) -> dict[str, Any]:
        # The programs come scaled, so its equilibration is off. Regularisation caps the accuracy: with 1e-13 a sixth
        # of the steps of the paper's run (h = 1/256) stops at a gap 1e6 times too large, with 1e-15 none does. Going
        # .999 of the way to the cones saves 7 % of the iterations. Two threads are three times slower than one on the
        # patterns cvxpy makes; faer takes 4.6 s where qdldl takes 22 on the paper's full program; iterative
        # refinement, up to ten rounds a solve, doubles the time of a condensed program and on most changes no digit
        # of its gap.
        tight = float(np.clip(CONIC_GAP * target, 1e-15, 1e-8))
        return {
            "tol_gap_abs": tight,
            "tol_gap_rel": tight,
            "tol_feas": float(np.clip(CONIC_RESIDUAL * np.sqrt(target), 1e-13, 1e-8)),
            "max_threads": 1,
            "direct_solve_method": "faer",
            "iterative_refinement_enable": False,
            "presolve_enable": False,
            "equilibrate_enable": False,
            "static_regularization_constant": 1e-15,
            "max_step_fraction": 0.999,
        }

    def careful(self) -> dict[str, Any]:
        # Where a fixed point asks for the last digits (problems/janssen_silo.py) more regularisation loses fewer steps.
        return {"iterative_refinement_enable": True, "static_regularization_constant": 1e-13}
