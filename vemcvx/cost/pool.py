"""Who does the work: threads here, or the workers of a dask.distributed cluster, through joblib.

Each of them waits for a process of its own (:mod:`vemcvx.cost.alone`), so that threads are enough.

Workers of a cluster must see the folder of the sweep and the problem file under the same paths, and have the same
packages.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from vemcvx.errors import ProblemError

CONNECT = 10.0
"""Seconds that a scheduler has to answer."""


@dataclass(frozen=True)
class Pool:
    """Calls a function for many arguments at once, and yields results as they come."""

    workers: int

    def __call__(self, function: Callable[..., Any], given: list[tuple[Any, ...]]) -> Iterator[Any]:
        """Results in the order in which they are finished."""
        from joblib import Parallel, delayed

        parallel = Parallel(n_jobs=self.workers, return_as="generator_unordered", batch_size=1)
        return parallel(delayed(function)(*arguments) for arguments in given)


@contextmanager
def pool(workers: int, scheduler: str | None) -> Iterator[Pool]:
    """Threads here, or the workers of a cluster.

    Raises
    ------
    ProblemError
        There is no such scheduler, it has no workers, or distributed is not installed.
    """
    from joblib import parallel_config

    if scheduler is None:
        with parallel_config(backend="threading"):
            yield Pool(workers)
        return
    try:
        from distributed import Client
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
        threads = sum(client.nthreads().values())
        if not threads:
            raise ProblemError(f"--scheduler: {scheduler} has no workers; start some with `dask worker {scheduler}`.")
        with parallel_config(backend="dask", wait_for_workers_timeout=CONNECT):
            yield Pool(threads)
