"""Linear algebra: factors of symmetric positive definite matrices, behind one interface."""

from vemcvx.linear.default import choose_linear, direct_solver
from vemcvx.linear.factor import (
    AT_ONCE,
    SAMPLES,
    Cycle,
    DenseCholesky,
    Factor,
    Halves,
    LinearSolver,
    Matrix,
    Scaled,
    corrected,
    singular,
)
from vemcvx.linear.multigrid import Multigrid
from vemcvx.linear.pardiso import Pardiso, opened
from vemcvx.linear.petsc import PETSc
from vemcvx.linear.products import Congruent, Elsewhere, residual, sizes
from vemcvx.linear.superlu import SuperLU, minimum_degree, nested_dissection

__all__ = [
    "AT_ONCE",
    "SAMPLES",
    "Congruent",
    "Cycle",
    "DenseCholesky",
    "Elsewhere",
    "Factor",
    "Halves",
    "LinearSolver",
    "Matrix",
    "Multigrid",
    "PETSc",
    "Pardiso",
    "Scaled",
    "SuperLU",
    "choose_linear",
    "corrected",
    "direct_solver",
    "minimum_degree",
    "nested_dissection",
    "opened",
    "residual",
    "singular",
    "sizes",
]
