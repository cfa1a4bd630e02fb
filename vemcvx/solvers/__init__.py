"""Solvers of a step's convex program."""

from vemcvx.solvers.conic import OSQP, TUNED, Clarabel, ThroughCvxpy, interfaces, list_installed
from vemcvx.solvers.default import Direct, Solves, as_solver, choose_solver
from vemcvx.solvers.newton import Newton
from vemcvx.solvers.solver import Prepared, Solver

__all__ = [
    "OSQP",
    "TUNED",
    "Clarabel",
    "Direct",
    "Newton",
    "Prepared",
    "Solver",
    "Solves",
    "ThroughCvxpy",
    "as_solver",
    "choose_solver",
    "interfaces",
    "list_installed",
]
