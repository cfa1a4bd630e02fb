"""Run a function in a new process with one BLAS thread, so that a crash does not stop the caller."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from typing import Any

from threadpoolctl import threadpool_limits

from vemcvx.base.errors import NotCertified, VemcvxError

DONE, NOT_CERTIFIED, REFUSED, CRASHED = "done", "not certified", "refused", "crashed"
"""The statuses of a run. NOT_CERTIFIED: the answer misses the accuracy; REFUSED: the problem is invalid."""


def call_safely(function: Callable[..., Any], *given: Any) -> tuple[str, Any]:
    """Call a function in a new process, and return the status and the result or reason."""
    context = get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(sender, function, given), daemon=True)
    try:
        process.start()
        sender.close()
        answer: tuple[str, Any] = receiver.recv()
    except EOFError:
        process.join()
        return CRASHED, _describe_end(process.exitcode or 0)
    except OSError as error:
        return CRASHED, str(error)
    finally:
        if process.pid is not None:
            process.kill()
            process.join()
        receiver.close()
    return answer


def use_one_thread() -> None:
    """Use one BLAS thread in this process from now on."""
    threadpool_limits(limits=1)
    # Libraries that are loaded later read these variables.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
        os.environ[name] = "1"


def _answer(sender: Connection, function: Callable[..., Any], given: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The parent process handles Ctrl-C.
    threading.Thread(target=_end_with_parent, daemon=True).start()
    use_one_thread()
    try:
        # Messages of parallel runs would overwrite each other.
        with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
            answer = DONE, function(*given)
    except VemcvxError as error:
        answer = NOT_CERTIFIED if isinstance(error, NotCertified) else REFUSED, str(error)
    except Exception as error:
        answer = CRASHED, f"{type(error).__name__}: {error}"
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
