"""Errors against closed forms, distances between runs on different meshes, observed orders."""

from vemcvx.estimate.measures.convergence_orders import Orders, orders
from vemcvx.estimate.measures.distance import energy_distance
from vemcvx.estimate.measures.error_table import ConvergenceTable, convergence_table
from vemcvx.estimate.measures.exact_errors import energy_error, l2_error
from vemcvx.estimate.measures.field import Field, Measured

__all__ = [
    "ConvergenceTable",
    "Field",
    "Measured",
    "Orders",
    "convergence_table",
    "energy_distance",
    "energy_error",
    "l2_error",
    "orders",
]
