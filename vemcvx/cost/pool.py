"""Who does the work: threads here, or the workers of a dask.distributed cluster.

Each of them waits for a process of its own (:mod:`vemcvx.cost.alone`), so that threads are enough. Workers of a cluster
must see the folder of the sweep and the problem file under the same paths, and have the same packages.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.pool import ThreadPool
from typing import Any

from vemcvx.errors import ProblemError

CONNECT = 10.0
"""Seconds that a scheduler has to answer."""

Given = list[tuple[Any, ...]]


@dataclass(frozen=True)
class Pool:
    """Who calls a function for many arguments at once."""

    workers: int
    results: Callable[[Callable[..., Any], Given], Iterator[Any]]
    """in the order in which they are finished"""


@contextmanager
def pool(workers: int, scheduler: str | None) -> Iterator[Pool]:
    """Threads here, or the workers of a cluster.

    Raises
    ------
    ProblemError
        There is no such scheduler, it has no workers, or distributed is not installed.
    """
    if scheduler is None:
        # Its threads end with the program, whatever they wait for.
        with ThreadPool(workers) as threads:
            yield Pool(workers, lambda function, given: threads.imap_unordered(lambda some: function(*some), given))
        return
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise ProblemError(
            "--scheduler needs distributed, which is not installed: pip install 'vemcvx[cluster]'"
        ) from None
    try:
        client = Client(scheduler, timeout=CONNECT)
    except (OSError, ValueError) as error:
        raise ProblemError(
            f"--scheduler: no dask scheduler answers at {scheduler!r} ({error}); start one with `dask scheduler`, and "
            "workers with `dask worker ADDRESS`, on machines that see this folder."
        ) from error
    with client:
        count = sum(client.nthreads().values())
        if not count:
            raise ProblemError(f"--scheduler: {scheduler} has no workers; start some with `dask worker {scheduler}`.")

        def results(function: Callable[..., Any], given: Given) -> Iterator[Any]:
            asked = [client.submit(function, *arguments, pure=False) for arguments in given]
            return (future.result() for future in as_completed(asked))

        yield Pool(count, results)
