"""What is said of a program beside its file: where it comes from, its size, how hard it is, its certified optimum."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigsh

from vemcvx.arrays import Floats
from vemcvx.program.certificate import BOUND_ROUNDING
from vemcvx.program.operators import Operators
from vemcvx.program.solved_program import SolvedProgram
from vemcvx.program.step_program import StepProgram
from vemcvx.version import __version__

FORMAT = "vemcvx program 1"
STATEMENT = (
    "minimise 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| subject to D d <= e; where a compliance c_j > 0, with "
    "(D_j d - e_j)_+^2 / (2 c_j) in place of the bound. K d = g - B'lam - D'p, |lam_i| <= w_i, p >= 0. "
    "For any such d, lam, p: 1/2 |d - d*|_K^2 <= gap, primal less dual value."
)
DENSE = 600
"""Unknowns up to which all eigenvalues of K are computed."""


def description(program: StepProgram) -> dict[str, Any]:
    """The words and numbers, as JSON takes them."""
    operators = program.operators
    matrices = {"K": sp.csr_matrix(operators.K), "B": operators.B, "D": operators.D}
    found: dict[str, Any] = {
        "format": FORMAT,
        "version": __version__,
        "program": STATEMENT,
        "unknowns": len(program.g),
        "norm_terms": operators.count,
        "block": operators.block,
        "limits": len(program.e),
        "soft_limits": int((operators.compliance > 0).sum()),
        "kernel": 0 if operators.kernel is None else operators.kernel.shape[1],
        "nonzeros": {name: int(np.count_nonzero(matrix.data)) for name, matrix in matrices.items()},
        "features": sorted(operators.features),
        "condition": condition(operators),
    }
    if isinstance(program, SolvedProgram):
        found |= {"origin": dict(program.origin), "step": program.step, "t": program.t}
        found |= {"optimum": _optimum(program), "degenerate": degenerate(program)}
    return found


def _optimum(program: SolvedProgram) -> dict[str, float]:
    certificate, (low, high) = program.certificate, program.bounds
    return {
        "value": program.objective(program.answer.d),
        "low": low,
        "high": high,
        "gap": certificate.gap,
        "rounding_floor": certificate.floor,
        "energy_error": certificate.error,
        "energy_norm": program.norm,
    }


def degenerate(program: SolvedProgram) -> dict[str, int]:
    """How many norm terms neither slip nor stick with force to spare, and how many limits touch without force.

    That is, |s_i| and w_i - |lam_i|, or |z_j| and p_j, are zero but for what the certificate leaves open:
    |s_i - s_i*| <= (B_i K^{-1} B_i')^{1/2} |d - d*|_K, and forces likewise, with B_i K B_i' / |B_i|^4.
    """
    operators, d = program.operators, program.answer.d
    error = program.certificate.error + program.certificate.error_floor
    slip, excess = np.linalg.norm(program.slip(d), axis=1), np.abs(program.excess(d))
    still = slip <= error * np.sqrt(operators.norm_flexibility)
    meets = excess <= error * np.sqrt(operators.limit_flexibility) + program.excess_blur(d)
    blocks = operators.blocks(_push(operators, operators.B)).max(axis=1, initial=0.0)
    full = program.w - np.linalg.norm(program.answer.lam, axis=1) <= error * blocks + BOUND_ROUNDING * program.w
    idle = program.answer.p <= error * _push(operators, operators.D)
    return {"norm_terms": int((still & full).sum()), "limits": int((meets & idle).sum())}


def _push(operators: Operators, rows: sp.csr_matrix) -> Floats:
    """(k,) by how much a force along each row may change with d, per unit of |d|_K."""
    square = np.asarray(rows.multiply(rows).sum(axis=1)).ravel()
    work = np.asarray(rows.multiply((operators.K @ rows.T).T).sum(axis=1)).ravel()
    push: Floats = np.sqrt(np.maximum(work, 0.0)) / np.where(square > 0, square, 1.0)
    return push


def condition(operators: Operators) -> float | None:
    """The largest over the least eigenvalue of K, the kernel's left out; None where there is no unknown."""
    K, n = operators.K, len(operators.K.diagonal())
    if n == 0:
        return None
    if n <= DENSE:
        values = np.linalg.eigvalsh(K if isinstance(K, np.ndarray) else K.toarray())
        k = 0 if operators.kernel is None else operators.kernel.shape[1]
        return float(values[-1] / values[k])
    if operators.kernel is not None:
        return None
    start, inverse = np.ones(n), LinearOperator((n, n), matvec=operators.factor.solve, dtype=float)
    largest, least = (eigsh(A, k=1, v0=start, return_eigenvectors=False, tol=1e-3)[0] for A in (K, inverse))
    return float(largest * least)
