"""Workers of a sweep: processes, threads here, or a cluster; and the journal of finished points."""

from __future__ import annotations

import faulthandler
import json
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import IO, Any, ParamSpec, TypeVar

from vemcvx.cost.table import CRASHED, Row
from vemcvx.errors import HistoryError, ProblemError, VemcvxError

# A function in a process of its own.
#
# What a run holds at its peak is then its own and not what runs before it left behind; BLAS has one thread, so that
# seconds of runs side by side compare; and what runs out of memory or crashes takes nothing else with it. The process
# ends when the one that started it does, however that ends: its standard input, which stays open, is closed then.


THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
Given = ParamSpec("Given")
Result = TypeVar("Result")
LATE = b"Timeout ("
"""How the reply begins of a process that faulthandler has ended; no pickle does."""
PROGRAM = "from vemcvx.cost.workers import main; main()"


class Refused(Exception):
    """The function raised a VemcvxError; its message."""


class Crashed(Exception):
    """The process died, or raised anything else; what is known of why."""


class TookTooLong(Exception):
    """The process was ended when its time was up."""


def alone(function: Callable[Given, Result], *given: Given.args, **named: Given.kwargs) -> Result:
    """Call a function of a module in a new process, with arguments and result that can be pickled.

    Raises
    ------
    Refused, Crashed
    """
    answer: Result = _called((None, None, function, given, named))
    return answer


def alone_within(
    seconds: float,
    ready: Callable[[], object],
    function: Callable[Given, Result],
    *given: Given.args,
    **named: Given.kwargs,
) -> Result:
    """The same in a process that is ended so many seconds after it has called `ready`.

    Raises
    ------
    Refused, Crashed, TookTooLong
    """
    answer: Result = _called((seconds, ready, function, given, named))
    return answer


def _called(request: tuple[Any, ...]) -> Any:
    path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
    env = {**os.environ, **dict.fromkeys(THREADS, "1"), "PYTHONPATH": path}
    reply = b""
    # A file without a name: nothing is left of it, whatever happens.
    with tempfile.TemporaryFile() as said:
        pipe, command = subprocess.PIPE, [sys.executable, "-c", PROGRAM]
        with subprocess.Popen(command, env=env, stdin=pipe, stdout=pipe, stderr=said) as process:
            if process.stdin and process.stdout:
                # It may have died already.
                with suppress(OSError):
                    process.stdin.write(pickle.dumps(request))
                    process.stdin.flush()
                reply = process.stdout.read()
            code = process.wait()
        if reply.startswith(LATE):
            raise TookTooLong
        if code or not reply:
            raise Crashed(_why(code, said))
    result, refusal = pickle.loads(reply)
    if refusal is not None:
        raise Refused(refusal)
    return result


def _why(code: int, said: IO[bytes]) -> str:
    if code < 0:
        hint = ", as the system does to a process that takes too much memory" if code == -9 else ""
        return f"killed by signal {-code}{hint}"
    said.seek(0)
    lines = said.read().decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else f"ended with exit code {code}"


def main() -> None:
    """Do what a request says: the other side of :func:`alone`."""
    # What the function prints must not come between.
    reply = os.dup(1)
    os.dup2(2, 1)
    seconds, ready, function, given, named = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    answer: tuple[Any, str | None]
    with os.fdopen(reply, "wb") as stream:
        if seconds is not None:
            ready()
            # Whatever the function is doing: this waits for no lock of Python's.
            faulthandler.dump_traceback_later(min(seconds, threading.TIMEOUT_MAX), exit=True, file=stream)
        try:
            answer = (function(*given, **named), None)
        except VemcvxError as error:
            answer = (None, str(error))
        faulthandler.cancel_dump_traceback_later()
        pickle.dump(answer, stream)


def _end_with_parent() -> None:
    # Below Python's own buffer, which a thread that waits would hold at the end of the program.
    os.read(0, 1)
    os._exit(1)


# Who does the work: threads here, or the workers of a dask.distributed cluster.
#
# Each of them waits for a process of its own, so that threads are enough. Workers of a
# cluster must see the folder of the sweep and the problem file under the same paths, and have the same packages.


CONNECT = 10.0
"""Seconds that a scheduler has to answer."""

Tasks = list[tuple[Any, ...]]


@dataclass(frozen=True)
class Pool:
    """Workers that call a function for many arguments at once."""

    workers: int
    results: Callable[[Callable[..., Any], Tasks], Iterator[Any]]
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

        def results(function: Callable[..., Any], given: Tasks) -> Iterator[Any]:
            asked = [client.submit(function, *arguments, pure=False) for arguments in given]
            return (future.result() for future in as_completed(asked))

        yield Pool(count, results)


# The journal of a sweep: one line of JSON a finished point, on the disk before the next one is looked at.
#
# A process that dies while it writes leaves a torn last line. Reading leaves out what is no whole line of this
# format, and writing begins on a line of its own.


def read_journal(path: Path) -> dict[str, Row]:
    """The finished points by key, each as it was last written; crashed ones are to be tried again and left out."""
    try:
        lines = path.read_bytes().splitlines() if path.exists() else []
    except OSError as error:
        raise HistoryError(f"{path}: cannot read the journal: {error}.") from error
    rows = [row for line in lines if (row := _row(line)) is not None]
    latest = {row.key: row for row in rows}
    return {key: row for key, row in latest.items() if row.status != CRASHED}


def _row(line: bytes) -> Row | None:
    try:
        row = Row(**json.loads(line))
    except (ValueError, TypeError, RecursionError):
        return None
    return row if row.whole else None


def append(path: Path, row: Row) -> None:
    """Write a row, down to the disk."""
    line = (json.dumps(asdict(row), allow_nan=False) + "\n").encode()
    try:
        with path.open("ab+") as stream:
            if stream.tell():
                stream.seek(-1, os.SEEK_END)
                line = line if stream.read(1) == b"\n" else b"\n" + line
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise HistoryError(f"{path}: cannot write the journal: {error}. What it holds is kept.") from error
