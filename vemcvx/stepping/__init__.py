"""Backward Euler: step after step, solved, certified, entered into the ledger, kept."""

from vemcvx.stepping.backward_euler import (
    Balanced,
    Beginning,
    Continued,
    checked_times,
    initial_state,
    march,
    prepare,
    settled_from,
    step,
)
from vemcvx.stepping.programs import programs_of_march, programs_of_trajectory
from vemcvx.stepping.refusals import softening_ratio
from vemcvx.stepping.state import Ledger, PreparedRun, StepData, certified_in_full, state_given
from vemcvx.stepping.trajectory import CHECKPOINT, Folder, Memory, Storage, Trajectory, relative, stored_steps

__all__ = [
    "CHECKPOINT",
    "Balanced",
    "Beginning",
    "Continued",
    "Folder",
    "Ledger",
    "Memory",
    "PreparedRun",
    "StepData",
    "Storage",
    "Trajectory",
    "certified_in_full",
    "checked_times",
    "initial_state",
    "march",
    "prepare",
    "programs_of_march",
    "programs_of_trajectory",
    "relative",
    "settled_from",
    "softening_ratio",
    "state_given",
    "step",
    "stored_steps",
]
