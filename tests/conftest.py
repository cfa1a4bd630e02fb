"""What every test gets: one thread of BLAS, signals that count, and the families of meshes."""

from __future__ import annotations

import os
import signal
import sys

# Two test processes with two threads each would only get in each other's way on two cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Who starts the tests in the background ignores interrupts and hang-ups, which processes that tests interrupt inherit.
if sys.platform != "win32":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

import pytest
from scenes import FAMILIES


@pytest.fixture(params=FAMILIES)
def family(request: pytest.FixtureRequest) -> str:
    """Every family of meshes in turn."""
    return request.param
