"""The cost of accuracy: true errors, seconds, unknowns and memory of many settings of one problem."""

from vemcvx.cost.sweeping import Ingredients, Point, Sweep, sweep
from vemcvx.cost.table import Row, advice, front

__all__ = ["Ingredients", "Point", "Row", "Sweep", "advice", "front", "sweep"]
