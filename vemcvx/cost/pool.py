"""Who does the work: threads here, or the workers of a dask.distributed cluster.

Each of them waits for a process of its own (:mod:`vemcvx.cost.alone`), so that threads are enough. Workers of a cluster
must see the folder of the sweep and the problem file under the same paths, and have the same packages.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing.pool import ThreadPool
from typing import Any, Protocol, TypeVar

from vemcvx.errors import ProblemError

CONNECT = 10.0
"""Seconds that a scheduler has to answer."""

Given = list[tuple[Any, ...]]
Result = TypeVar("Result")


class Future(Protocol):
    """A result to come."""

    def result(self) -> Any:
        """The result, waited for."""


class Cluster(Protocol):
    """What is asked of a client of dask.distributed, which has no annotations."""

    def nthreads(self) -> dict[str, int]:
        """Threads of each worker."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any, pure: bool) -> Future:
        """Call a function on some worker."""

    def __enter__(self) -> Cluster: ...

    def __exit__(self, kind: object, error: object, trace: object, /) -> None: ...


@dataclass(frozen=True)
class Pool:
    """Calls a function for many arguments at once, and yields results in the order in which they are finished."""

    workers: int
    results: Callable[[Callable[..., Any], Given], Iterator[Any]]

    def __call__(self, function: Callable[..., Result], given: Given) -> Iterator[Result]:
        """The results."""
        return self.results(function, given)


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
            yield Pool(workers, lambda function, given: threads.imap_unordered(partial(_call, function), given))
        return
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise ProblemError(
            "--scheduler needs distributed, which is not installed: pip install 'vemcvx[cluster]'"
        ) from None
    connect: Callable[..., Cluster] = Client
    completed: Callable[[list[Future]], Iterator[Future]] = as_completed
    try:
        client = connect(scheduler, timeout=CONNECT)
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
            return (future.result() for future in completed(asked))

        yield Pool(count, results)


def _call(function: Callable[..., Any], given: tuple[Any, ...]) -> Any:
    return function(*given)
