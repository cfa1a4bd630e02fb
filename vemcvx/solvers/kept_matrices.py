"""Clarabel as cvxpy keeps it from step to step, told what has changed alone.

cvxpy hands it P, q, A and b anew each time. P and A are those of all steps; taking them over again is a quarter of a
step of 256 terms, and changes no bit of an answer.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

CLARABEL = "CLARABEL"


class KeptMatrices:
    """A solver of Clarabel's, whose `update` passes on matrices that differ from those it was last given."""

    def __init__(self, solver: Any):
        self._solver = solver
        self._given: dict[str, Any] = {}

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self._solver, name)

    def update(self, **data: Any) -> None:
        """Hand on what is new of P, q, A, b and settings."""
        new = {name: item for name, item in data.items() if not _same(item, self._given.get(name))}
        self._solver.update(**new)
        self._given |= {name: item for name, item in new.items() if sp.issparse(item)}


def keep_matrices(solvers: dict[str, Any]) -> None:
    """See to it that Clarabel, among the solvers that cvxpy keeps by name, is told what has changed alone."""
    solver = solvers.get(CLARABEL)
    if hasattr(solver, "update") and not isinstance(solver, KeptMatrices):
        solvers[CLARABEL] = KeptMatrices(solver)


def _same(one: Any, other: Any) -> bool:
    """Whether both are sparse matrices with the same entries at the same places."""
    both = sp.issparse(one) and sp.issparse(other)
    return (
        both
        and one.shape == other.shape
        and all(np.array_equal(getattr(one, part), getattr(other, part)) for part in ("data", "indices", "indptr"))
    )
