"""Which linear solver: the one asked for, else by size."""

from __future__ import annotations

import importlib.util
import logging

from vemcvx.linear.factor import LinearSolver
from vemcvx.linear.multigrid import Multigrid
from vemcvx.linear.superlu import SuperLU

# A million unknowns on squares take 22 s to factorise and 5.6 GB at the peak; three million would take 20 GB.
LARGEST_FACTOR = 2_000_000

log = logging.getLogger("vemcvx")


def choose_linear(unknowns: int, asked: LinearSolver | None = None) -> LinearSolver:
    """A direct solver while its factors fit in memory, multigrid beyond if it is installed."""
    if asked is not None:
        return asked
    if unknowns <= LARGEST_FACTOR:
        return SuperLU()
    if importlib.util.find_spec("pyamg") is None:
        log.warning("%d unknowns: a direct solver may run out of memory; vemcvx[multigrid] would not", unknowns)
        return SuperLU()
    log.info("linear solver: Multigrid, for %d unknowns", unknowns)
    return Multigrid()
