"""The convex program of a step: the variational inequality in coordinates, condensed, scaled, certified."""

from vemcvx.program.limits import Limits
from vemcvx.program.system import Damping, Norms, System

__all__ = ["Damping", "Limits", "Norms", "System"]
