"""Clarabel, an interior-point method for cones."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from vemcvx.program.operators import SECOND_ORDER_CONES
from vemcvx.solvers.conic import LINEAR, ThroughCvxpy


@dataclass(frozen=True)
class Clarabel(ThroughCvxpy):
    """The interior-point solver Clarabel, through cvxpy, with one second-order cone for every |v_tau|."""

    solver: str = field(default="CLARABEL", init=False)

    accepts: ClassVar[frozenset[str]] = LINEAR | {SECOND_ORDER_CONES}

    @property
    def name(self) -> str:
        return "Clarabel"

    def on_kernels(self) -> dict[str, Any]:
        # With less, a K with one motion that its terms just hold (problems/hard_cases.py) ends at 6e-6.
        return {"static_regularization_constant": 1e-13}

    def careful(self) -> dict[str, Any]:
        # Where a fixed point asks for the last digits (problems/janssen_silo.py) more regularisation loses fewer steps;
        # with shorter steps the paper's reach 1e-8 (problems/solver_accuracy.py), with those of the first attempt 4e-8.
        return {
            "iterative_refinement_enable": True,
            "static_regularization_constant": 1e-13,
            "max_step_fraction": 0.99,
        }
