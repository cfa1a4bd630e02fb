"""Choice of the linear solver by size, dimension and installed packages; threads of small matrices."""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import current_thread, main_thread

from threadpoolctl import ThreadpoolController

from vemcvx.linear.factor import LinearSolver
from vemcvx.linear.multigrid import Multigrid
from vemcvx.linear.pardiso import Pardiso
from vemcvx.linear.superlu import SuperLU

LARGEST_FACTOR = 2_000_000
"""Unknowns in the plane. A million on squares take 22 s to factorise and 5.6 GB at the peak, three would take 20 GB."""
MOST_MEMORY = 8e9
"""Bytes of factors in space."""
log = logging.getLogger("vemcvx")


def choose_linear(
    unknowns: int, asked: LinearSolver | None = None, *, modes: int = 3, retained: int = 0
) -> LinearSolver:
    """The linear solver `asked` for; else a direct one while its factors fit in memory, multigrid beyond if installed.

    Bodies in space have six rigid motions (`modes`), and much fuller factors. `retained` unknowns are not eliminated.
    """
    if asked is not None:
        return asked
    direct = direct_solver(unknowns)
    if modes < 6:
        fits, takes = unknowns <= LARGEST_FACTOR, ""
    else:
        memory = direct.memory_in_space(unknowns) + 4 * 8 * float(retained) ** 2
        # A dense system of 3,267 unknowns takes .7 s to factorise, one of 9,000 then some 15, once or twice a step.
        fits, takes = memory <= MOST_MEMORY and retained <= 9_000, f" in space take {memory / 1e9:.2g} GB"
    if fits:
        if takes and unknowns >= 1_000:
            log.info("linear solver: %s; factors for %d unknowns%s", type(direct).__name__, unknowns, takes)
        return direct
    if importlib.util.find_spec("pyamg") is None:
        said = "%d unknowns%s: a direct solver may run out of memory; vemcvx[multigrid] would not"
        log.warning(said, unknowns, takes)
        return direct
    log.info("linear solver: Multigrid, for %d unknowns", unknowns)
    return Multigrid()


def direct_solver(unknowns: int) -> Pardiso | SuperLU:
    """The fastest one that is installed; of a thousand unknowns both take five milliseconds."""
    return Pardiso() if unknowns >= 1_000 and Pardiso.installed() else SuperLU()


@cache
def _libraries() -> ThreadpoolController:
    """The BLAS libraries of NumPy and SciPy, found at the first run, because the search takes milliseconds."""
    return ThreadpoolController()


@contextmanager
def one_thread(unknowns: int, cores: int = 1) -> Iterator[None]:
    """Limit BLAS to one thread while steps solve dense systems of fewer than 2,000 unknowns.

    Of larger ones to as many `cores` as the linear solver takes, if these are several; else BLAS keeps its own number.

    On two cores 256 steps with 256 unknowns take .76 s with one thread, and .88 s of wall and 1.3 s of CPU time with
    two. The number of threads belongs to the process, so that only a run in its main thread sets it.
    """
    small = unknowns < 2_000
    if not (small or cores > 1) or current_thread() is not main_thread():
        yield
        return
    with _libraries().limit(limits=1 if small else cores, user_api="blas"):
        yield
