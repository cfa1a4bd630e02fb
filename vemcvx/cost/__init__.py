"""What accuracy costs: many settings of one problem, their true errors, seconds, unknowns and memory."""

from vemcvx.cost.advice import advice
from vemcvx.cost.front import front
from vemcvx.cost.point import Ingredients, Point
from vemcvx.cost.row import Row
from vemcvx.cost.sweep import Sweep, sweep

__all__ = ["Ingredients", "Point", "Row", "Sweep", "advice", "front", "sweep"]
