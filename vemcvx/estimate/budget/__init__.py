"""The error of a run, part by part: algebra, mesh, steps."""

from vemcvx.estimate.budget.error_parts import CONSTANT, ErrorBudget, budget_of, check_estimable, error_budget, in_time
from vemcvx.estimate.budget.finer_steps import Finer, beside_finer

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
