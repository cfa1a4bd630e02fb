"""Backward Euler: step after step, solved, certified, entered into the ledger, kept."""

from vemcvx.stepping.backward_euler import march
from vemcvx.stepping.trajectory import Trajectory

__all__ = ["Trajectory", "march"]
