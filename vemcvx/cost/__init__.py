"""What accuracy costs: many settings of one problem, their true errors, seconds, unknowns and memory."""

from vemcvx.cost.settings import Ingredients, Point
from vemcvx.cost.sweeping import Sweep, sweep
from vemcvx.cost.table import Row, advice, front

__all__ = ["Ingredients", "Point", "Row", "Sweep", "advice", "front", "sweep"]
