"""The error of a run, part by part: algebra, mesh, steps."""

from vemcvx.estimate.budget.error_parts import ErrorBudget, budget_of, check_estimable, error_budget, in_time
from vemcvx.estimate.budget.finer_steps import Finer, beside_finer
from vemcvx.estimate.budget.residual import CONSTANT

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
