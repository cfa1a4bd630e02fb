"""Linear solvers: SuperLU, Pardiso, Iterative and PETSc, behind one interface."""

from vemcvx.linear.default import choose_linear, direct_solver
from vemcvx.linear.factor import CHUNK_SIZE, SAMPLES, Factor, LinearSolver, Matrix, singular_matrix_error
from vemcvx.linear.iterative import Iterative
from vemcvx.linear.pardiso import Pardiso
from vemcvx.linear.petsc import PETSc, all_ranks, serve
from vemcvx.linear.superlu import SuperLU, order_by_minimum_degree, order_by_nested_dissection

__all__ = [
    "CHUNK_SIZE",
    "SAMPLES",
    "Factor",
    "Iterative",
    "LinearSolver",
    "Matrix",
    "PETSc",
    "Pardiso",
    "SuperLU",
    "all_ranks",
    "choose_linear",
    "direct_solver",
    "order_by_minimum_degree",
    "order_by_nested_dissection",
    "serve",
    "singular_matrix_error",
]
