"""The default linear solver, and the number of BLAS threads."""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import current_thread, main_thread

from threadpoolctl import ThreadpoolController

from vemcvx.linear.factor import LinearSolver
from vemcvx.linear.iterative import Iterative
from vemcvx.linear.pardiso import Pardiso
from vemcvx.linear.superlu import SuperLU

LARGEST_FACTOR = 2_000_000  # Largest number of unknowns for direct solvers in the plane.
log = logging.getLogger("vemcvx")


def choose_linear(unknowns: int, given: LinearSolver | None = None, *, modes: int = 3) -> LinearSolver:
    """Return `given`, or the default linear solver."""
    if given is not None:
        return given
    direct = direct_solver(unknowns)
    fits = unknowns <= (direct.largest_in_space if modes == 6 else LARGEST_FACTOR)
    if fits or importlib.util.find_spec("pyamg") is None:
        return direct
    log.info("linear solver: Iterative, for %d unknowns", unknowns)
    return Iterative()


def direct_solver(unknowns: int) -> Pardiso | SuperLU:
    """Return Pardiso for 1,000 unknowns or more if it is installed, else SuperLU."""
    return Pardiso() if unknowns >= 1_000 and Pardiso.is_installed() else SuperLU()


_find_libraries = cache(ThreadpoolController)  # The search for BLAS libraries takes milliseconds.


@contextmanager
def one_thread(unknowns: int) -> Iterator[None]:
    """Limit BLAS to one thread inside the block, for fewer than 2,000 unknowns."""
    if unknowns >= 2_000 or current_thread() is not main_thread():  # The limit holds for the whole process.
        yield
        return
    with _find_libraries().limit(limits=1, user_api="blas"):
        yield
