"""OSQP, an operator-splitting method for quadratic programs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from vemcvx.program.tolerances import CONIC_RESIDUAL
from vemcvx.solvers.conic import LINEAR, ThroughCvxpy


@dataclass(frozen=True)
class OSQP(ThroughCvxpy):
    """The operator-splitting solver OSQP, through cvxpy, with absolute values; no second-order cones."""

    solver: str = field(default="OSQP", init=False)

    accepts: ClassVar[frozenset[str]] = LINEAR

    def tolerances(self, target: float) -> dict[str, Any]:
        # It must be told to polish on every solve; its tests for infeasibility, loose by default, take
        # a step for unbounded.
        tight = float(np.clip(np.sqrt(target) * CONIC_RESIDUAL, 1e-11, 1e-7))
        return {
            "eps_abs": tight,
            "eps_rel": tight,
            "eps_prim_inf": 1e-15,
            "eps_dual_inf": 1e-15,
            "max_iter": 100_000,
            "polishing": True,
            "polish_refine_iter": 10,
        }
