"""Calls of functions, each in a new process with one BLAS thread: a crash does not stop the caller."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from vemcvx.base.errors import NotCertified, VemcvxError

DONE, NOT_CERTIFIED, REFUSED, CRASHED = "done", "not certified", "refused", "crashed"
"""Status of a run: answered; answered, but outside the accuracy; refused, because the problem is invalid; crashed."""
Result = TypeVar("Result")


class Crashed(Exception):
    """The process died, exceeded its time limit, or raised an error of another package."""


def call_in_process(function: Callable[..., Result], *given: Any, seconds: float | None = None) -> Result:
    """Return the result of a module-level function, called in a new process; raise its VemcvxError, or Crashed."""
    context = get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(sender, function, given), daemon=True)
    process.start()
    sender.close()
    try:
        if not receiver.poll(seconds):
            raise Crashed(f"its process was stopped after {seconds:g} s")
        result, error = receiver.recv()
    except EOFError:
        process.join()
        raise Crashed(_describe_end(process.exitcode or 0)) from None
    finally:
        process.kill()
        process.join()
        receiver.close()
    if error is not None:
        raise error
    return result


def call_safely(function: Callable[..., Any], *given: Any) -> tuple[str, Any]:
    """Call a function in a new process; return DONE and its result, or another status and its reason."""
    try:
        return DONE, call_in_process(function, *given)
    except VemcvxError as error:
        return NOT_CERTIFIED if isinstance(error, NotCertified) else REFUSED, str(error)
    except (Crashed, OSError) as crash:
        return CRASHED, str(crash)


def use_one_thread() -> None:
    """Use one BLAS thread in this process from now on."""
    threadpool_limits(limits=1)
    # Libraries that are loaded later read these variables.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
        os.environ[name] = "1"


def _answer(sender: Connection, function: Callable[..., Any], given: tuple[Any, ...]) -> None:
    """Call the function in the new process, and send its result, or the error that it raises."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The parent process handles Ctrl-C.
    threading.Thread(target=_end_with_parent, daemon=True).start()
    use_one_thread()
    answer: tuple[Any, Exception | None]
    try:
        # The messages and progress bars of parallel runs would overwrite each other.
        with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
            answer = function(*given), None
    except VemcvxError as error:
        # The parent process cannot unpickle error classes that a user's file defines.
        answer = None, error if type(error).__module__ == VemcvxError.__module__ else VemcvxError(str(error))
    except Exception as error:
        answer = None, Crashed(f"{type(error).__name__}: {error}")
    sender.send(answer)


def _end_with_parent() -> None:
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)


def _describe_end(code: int) -> str:
    if code >= 0:
        return f"its process ended with exit code {code}"
    hint = ", as the system does to a process that takes too much memory" if code == -9 else ""  # SIGKILL
    return f"its process was killed by signal {-code}{hint}"
