"""A function in a process of its own: whatever becomes of it, the caller goes on.

The peak memory of such a process is that of one run alone. BLAS has one thread in it, so that seconds of runs side by
side compare. A run that crashes or is out of memory ends no other run, which is why each run has a process, and no
pool of processes shares the runs. The process ends when the one that started it does, however that ends.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from vemcvx.base.errors import NotCertified, VemcvxError

DONE, NOT_CERTIFIED, REFUSED, CRASHED = "done", "not certified", "refused", "crashed"
"""What becomes of a run: an answer; a less accurate one than asked; no well-posed problem; broken down."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
STARTING = threading.Lock()  # A new process takes its environment from this one: one is started at a time.
Result = TypeVar("Result")


class Crashed(Exception):
    """The process died, or raised an error that is none of this package."""


class TookTooLong(Exception):
    """The process was ended when its time was up."""


def alone(function: Callable[..., Result], *given: Any, seconds: float | None = None) -> Result:
    """Call a function of a module in a new process, with arguments and result that can be pickled.

    With `seconds` the process is ended so long after its start. Raises the VemcvxError of the function, or Crashed or
    TookTooLong.
    """
    context = get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(sender, function, given), daemon=True)
    with STARTING, _one_thread():
        process.start()
    sender.close()
    try:
        if not receiver.poll(seconds):
            raise TookTooLong
        result, error = receiver.recv()
    except EOFError:
        process.join()
        raise Crashed(_ending(process.exitcode or 0)) from None
    finally:
        process.kill()
        process.join()
        receiver.close()
    if error is not None:
        raise error
    return result


def outcome(function: Callable[..., Any], *given: Any) -> tuple[str, Any]:
    """Call a function in a process of its own, and return DONE and its result, or another end and its reason."""
    try:
        return DONE, alone(function, *given)
    except VemcvxError as error:
        return NOT_CERTIFIED if isinstance(error, NotCertified) else REFUSED, str(error)
    except (Crashed, OSError) as crash:
        return CRASHED, str(crash)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Give processes that start inside the block one thread of BLAS each."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _answer(sender: Connection, function: Callable[..., Any], given: tuple[Any, ...]) -> None:
    """Call the function in the new process, and send its result, or the error that it raises."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that started this one.
    threading.Thread(target=_end_with_parent, daemon=True).start()
    answer: tuple[Any, Exception | None]
    try:
        # Words and bars of runs side by side would stand one over the other.
        with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
            answer = function(*given), None
    except VemcvxError as error:
        # The other process does not know the classes of a user's file.
        answer = None, error if type(error).__module__ == VemcvxError.__module__ else VemcvxError(str(error))
    except Exception as error:
        answer = None, Crashed(f"{type(error).__name__}: {error}")
    sender.send(answer)


def _end_with_parent() -> None:
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)


def _ending(code: int) -> str:
    """Say how a process died."""
    if code >= 0:
        return f"ended with exit code {code}"
    hint = ", as the system does to a process that takes too much memory" if -code == signal.SIGKILL else ""
    return f"killed by signal {-code}{hint}"
