"""Linear algebra: factors of symmetric positive definite matrices, behind one seam."""

from vemcvx.linear.default import choose_linear, direct_solver
from vemcvx.linear.factor import (
    SAMPLES,
    Cycle,
    DenseCholesky,
    Factor,
    Halves,
    LinearSolver,
    Matrix,
    Scaled,
    SuperLU,
    corrected,
)
from vemcvx.linear.multigrid import Multigrid
from vemcvx.linear.pardiso import Pardiso

__all__ = [
    "SAMPLES",
    "Cycle",
    "DenseCholesky",
    "Factor",
    "Halves",
    "LinearSolver",
    "Matrix",
    "Multigrid",
    "Pardiso",
    "Scaled",
    "SuperLU",
    "choose_linear",
    "corrected",
    "direct_solver",
]
