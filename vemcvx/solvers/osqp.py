"""OSQP, an operator-splitting method for quadratic programs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from vemcvx.solvers.conic import LINEAR, ThroughCvxpy


@dataclass(frozen=True)
class OSQP(ThroughCvxpy):
    """The operator-splitting solver OSQP, through cvxpy, with absolute values; no second-order cones."""

    solver: str = field(default="OSQP", init=False)

    accepts: ClassVar[frozenset[str]] = LINEAR
