"""Errors against closed forms, distances between runs on different meshes, observed orders."""

from vemcvx.measures.closed_form import energy_error, l2_error
from vemcvx.measures.distance import energy_distance
from vemcvx.measures.field import Field
from vemcvx.measures.measured import Measured
from vemcvx.measures.orders import Orders, orders

__all__ = ["Field", "Measured", "Orders", "energy_distance", "energy_error", "l2_error", "orders"]
