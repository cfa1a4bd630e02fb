"""Linear solvers: SuperLU, Pardiso, Iterative and PETSc, behind one interface."""

from vemcvx.linear.default import choose_linear, direct_solver
from vemcvx.linear.factor import AT_ONCE, SAMPLES, Factor, LinearSolver, Matrix, singular
from vemcvx.linear.iterative import Iterative
from vemcvx.linear.pardiso import Pardiso
from vemcvx.linear.petsc import PETSc, all_ranks, serve
from vemcvx.linear.superlu import SuperLU, minimum_degree, nested_dissection

__all__ = [
    "AT_ONCE",
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
    "minimum_degree",
    "nested_dissection",
    "serve",
    "singular",
]
