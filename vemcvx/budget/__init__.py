"""The error of a run, part by part: algebra, mesh, steps."""

from vemcvx.budget.error_budget import ErrorBudget, budget_of, check_estimable, error_budget
from vemcvx.budget.residual import CONSTANT

__all__ = ["CONSTANT", "ErrorBudget", "budget_of", "check_estimable", "error_budget"]
