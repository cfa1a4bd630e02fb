"""Backward Euler: solving, certifying and storing the steps of a run."""

from vemcvx.stepping.backward_euler import (
    Balanced,
    Beginning,
    Continued,
    check_times,
    initial_state,
    march,
    prepare,
    settle_from,
    step,
)
from vemcvx.stepping.programs import programs_of_march, programs_of_trajectory
from vemcvx.stepping.state import Ledger, PreparedRun, StepData, certify_in_full, make_given_state
from vemcvx.stepping.trajectory import CHECKPOINT, Folder, Memory, Storage, Trajectory

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
    "certify_in_full",
    "check_times",
    "initial_state",
    "make_given_state",
    "march",
    "prepare",
    "programs_of_march",
    "programs_of_trajectory",
    "settle_from",
    "step",
]
