"""Clarabel, an interior-point method for cones."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

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
