"""The error of a run, part by part: algebra, mesh, steps."""

from vemcvx.budget.error_budget import ErrorBudget, budget_of, check_estimable, error_budget, in_time
from vemcvx.budget.finer import Finer, beside_finer
from vemcvx.budget.residual import CONSTANT

__all__ = [
    "CONSTANT",
    "ErrorBudget",
    "Finer",
    "beside_finer",
    "budget_of",
    "check_estimable",
    "error_budget",
    "in_time",
]
