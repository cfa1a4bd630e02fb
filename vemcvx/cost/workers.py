"""Workers: a function in a process of its own, and many at once in threads here or on a cluster.

A process of its own holds at its peak what the run needs, not what runs before it left behind; BLAS has one thread in
it, so that seconds of runs side by side compare; and a run that is out of memory or crashes takes nothing else with it.
The process ends when the one that started it does, however that ends: its standard input, which stays open, is closed
then.
"""

from __future__ import annotations

import faulthandler
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.pool import ThreadPool
from typing import Any, TypeVar

from vemcvx.base.errors import NotCertified, ProblemError, VemcvxError

DONE, NOT_CERTIFIED, REFUSED, CRASHED = "done", "not certified", "refused", "crashed"
"""What becomes of a run: an answer; a less accurate one than asked; no well-posed problem; broken down."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
LATE = b"Timeout ("  # The beginning of the reply of a process that faulthandler has ended; no pickle begins so.
PROGRAM = "from vemcvx.cost.workers import main; main()"
Result = TypeVar("Result")


class Crashed(Exception):
    """The process died, or raised another error; its last words."""


class TookTooLong(Exception):
    """The process was ended when its time was up."""


def alone(
    function: Callable[..., Result], *given: Any, seconds: float | None = None, ready: Callable[[], object] = list
) -> Result:
    """Call a function of a module in a new process, with arguments and result that can be pickled.

    With `seconds` the process is ended so long after it has called `ready`. Raises the function's own VemcvxError, or
    Crashed or TookTooLong.
    """
    path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
    env = {**os.environ, **dict.fromkeys(THREADS, "1"), "PYTHONPATH": path}
    reply, pipe = b"", subprocess.PIPE
    # The file has no name, so that nothing is left of it, whatever happens.
    with tempfile.TemporaryFile() as said:
        with subprocess.Popen(
            [sys.executable, "-c", PROGRAM], env=env, stdin=pipe, stdout=pipe, stderr=said
        ) as process:
            if process.stdin and process.stdout:
                # It may have died already.
                with suppress(OSError):
                    process.stdin.write(pickle.dumps((seconds, ready, function, given)))
                    process.stdin.flush()
                reply = process.stdout.read()
            code = process.wait()
        if reply.startswith(LATE):
            raise TookTooLong
        if code < 0:
            hint = ", as the system does to a process that takes too much memory" if code == -9 else ""
            raise Crashed(f"killed by signal {-code}{hint}")
        if code or not reply:
            said.seek(0)
            lines = said.read().decode(errors="replace").strip().splitlines()
            raise Crashed(lines[-1] if lines else f"ended with exit code {code}")
    result, refusal = pickle.loads(reply)
    if refusal is not None:
        raise refusal
    return result


def outcome(function: Callable[..., Any], *given: Any) -> tuple[str, Any]:
    """Call a function in a process of its own: DONE and its result, or what came of it instead, and why."""
    try:
        return DONE, alone(function, *given)
    except VemcvxError as error:
        return NOT_CERTIFIED if isinstance(error, NotCertified) else REFUSED, str(error)
    except (Crashed, MemoryError, OSError) as crash:
        return CRASHED, str(crash) or type(crash).__name__


def main() -> None:
    """Answer one request on standard input: the other side of :func:`alone`."""
    reply = os.dup(1)  # Words that the function prints must not come between the bytes of the reply.
    os.dup2(2, 1)
    seconds, ready, function, given = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    answer: tuple[Any, VemcvxError | None]
    with os.fdopen(reply, "wb") as stream:
        if seconds is not None:
            ready()
            # faulthandler ends the process whatever the function is doing: it waits for no lock of Python's.
            faulthandler.dump_traceback_later(min(seconds, threading.TIMEOUT_MAX), exit=True, file=stream)
        try:
            answer = (function(*given), None)
        except VemcvxError as error:
            # Classes of users' files are not known on the other side.
            answer = (None, error if type(error).__module__ == VemcvxError.__module__ else VemcvxError(str(error)))
        faulthandler.cancel_dump_traceback_later()
        pickle.dump(answer, stream)


def _end_with_parent() -> None:
    # Python's own buffer would hold a lock while this thread waits, at the end of the program, too.
    os.read(0, 1)
    os._exit(1)


Results = Callable[[Callable[..., Any], list[tuple[Any, ...]]], Iterator[Any]]
"""A function that calls another for many arguments at once, and yields results as they are finished."""


@contextmanager
def pool(workers: int, scheduler: str | None) -> Iterator[Results]:
    """The results of threads here, or of the workers of a dask.distributed scheduler.

    Each waits for a process of its own, so that threads are enough. Workers of a cluster must see the folder of the
    sweep and the problem file under the same paths, and have the same packages.
    """
    if scheduler is None:
        # The threads of a ThreadPool end with the program, whatever they wait for.
        with ThreadPool(workers) as threads:
            yield lambda function, given: threads.imap_unordered(lambda some: function(*some), given)
        return
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise ProblemError(
            "--scheduler needs distributed, which is not installed: pip install 'vemcvx[cluster]'"
        ) from None
    try:
        client = Client(scheduler)
    except (OSError, ValueError) as error:
        raise ProblemError(
            f"--scheduler: no dask scheduler answers at {scheduler!r} ({error}); start one with `dask scheduler`, and "
            "workers with `dask worker ADDRESS`, on machines that see this folder."
        ) from error
    with client:
        if not client.nthreads():
            raise ProblemError(f"--scheduler: {scheduler} has no workers; start some with `dask worker {scheduler}`.")

        def results(function: Callable[..., Any], given: list[tuple[Any, ...]]) -> Iterator[Any]:
            asked = [client.submit(function, *arguments, pure=False) for arguments in given]
            return (future.result() for future in as_completed(asked))

        yield results
