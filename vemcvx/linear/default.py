"""Which linear solver: the one asked for, else by size and what is installed."""

from __future__ import annotations

import importlib.util
import logging

from vemcvx.linear.factor import LinearSolver
from vemcvx.linear.multigrid import Multigrid
from vemcvx.linear.pardiso import Pardiso
from vemcvx.linear.superlu import SuperLU

# It takes less time from 300 unknowns on (.5 of it at 10,000); of a thousand both take five milliseconds.
SMALLEST_PARDISO = 1_000
# A million unknowns on squares take 22 s to factorise and 5.6 GB at the peak; three million would take 20 GB.
LARGEST_FACTOR = 2_000_000

log = logging.getLogger("vemcvx")


def choose_linear(unknowns: int, asked: LinearSolver | None = None) -> LinearSolver:
    """A direct solver while its factors fit in memory, multigrid beyond if it is installed."""
    if asked is not None:
        return asked
    direct = Pardiso() if unknowns >= SMALLEST_PARDISO and Pardiso.installed() else SuperLU()
    if unknowns <= LARGEST_FACTOR:
        return direct
    if importlib.util.find_spec("pyamg") is None:
        log.warning("%d unknowns: a direct solver may run out of memory; vemcvx[multigrid] would not", unknowns)
        return direct
    log.info("linear solver: Multigrid, for %d unknowns", unknowns)
    return Multigrid()
