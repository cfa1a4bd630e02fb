"""Errors against closed forms, distances between runs on different meshes, and observed orders."""

from vemcvx.estimate.measures.distance import Field, Measured, energy_distance
from vemcvx.estimate.measures.errors import ConvergenceTable, convergence_table, energy_error, l2_error, orders

__all__ = [
    "ConvergenceTable",
    "Field",
    "Measured",
    "convergence_table",
    "energy_distance",
    "energy_error",
    "l2_error",
    "orders",
]
