"""One thread for the dense matrices of steps: of a few hundred unknowns, for which threads wait longer than they work.

The number of threads belongs to the process, so that only a run in its main thread sets it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import current_thread, main_thread

from threadpoolctl import ThreadpoolController

MANY = 2_000
"""Unknowns from which on threads pay. On two cores 256 steps with 256 unknowns take .76 s with one thread, and .88 s of
wall and 1.3 s of CPU time with two."""


@cache
def _libraries() -> ThreadpoolController:
    """The BLAS libraries that are there at the first run, NumPy's and SciPy's; to look for them takes milliseconds."""
    return ThreadpoolController()


@contextmanager
def one_thread(unknowns: int) -> Iterator[None]:
    """Within, BLAS has one thread, unless matrices have many unknowns."""
    if unknowns >= MANY or current_thread() is not main_thread():
        yield
        return
    with _libraries().limit(limits=1, user_api="blas"):
        yield
