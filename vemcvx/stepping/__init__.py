"""Backward Euler: steps are solved, certified, entered into the ledger, and stored."""

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
from vemcvx.stepping.refusals import softening_ratio
from vemcvx.stepping.state import Ledger, PreparedRun, StepData, certify_in_full, make_given_state
from vemcvx.stepping.trajectory import CHECKPOINT, Folder, Memory, Storage, Trajectory, choose_stored_steps, relative

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
    "choose_stored_steps",
    "initial_state",
    "make_given_state",
    "march",
    "prepare",
    "programs_of_march",
    "programs_of_trajectory",
    "relative",
    "settle_from",
    "softening_ratio",
    "step",
]
