"""What every test gets: one thread of BLAS, and the families of meshes."""

from __future__ import annotations

import os

# Two test processes with two threads each would only get in each other's way on two cores.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from scenes import FAMILIES


@pytest.fixture(params=FAMILIES)
def family(request: pytest.FixtureRequest) -> str:
    """Every family of meshes in turn."""
    return request.param
