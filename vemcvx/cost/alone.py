"""A function in a process of its own.

What a run holds at its peak is then its own and not what runs before it left behind; BLAS has one thread, so that
seconds of runs side by side compare; and what runs out of memory or crashes takes nothing else with it. The process
ends when the one that started it does, however that ends: its standard input, which stays open, is closed then.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import IO, Any, ParamSpec, TypeVar

from vemcvx.errors import VemcvxError

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
Given = ParamSpec("Given")
Result = TypeVar("Result")
READY = b"."
PROGRAM = "from vemcvx.cost.alone import main; main()"


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
    answer: Result = _called(None, (None, function, given, named))
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
    answer: Result = _called(seconds, (ready, function, given, named))
    return answer


def _called(seconds: float | None, request: tuple[Any, ...]) -> Any:
    path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
    env = {**os.environ, **dict.fromkeys(THREADS, "1"), "PYTHONPATH": path}
    reply, late = b"", threading.Event()
    # A file without a name: nothing is left of it, whatever happens.
    with tempfile.TemporaryFile() as said:
        pipe, command = subprocess.PIPE, [sys.executable, "-c", PROGRAM]
        with subprocess.Popen(command, env=env, stdin=pipe, stdout=pipe, stderr=said) as process:
            if process.stdin and process.stdout and _asked(process.stdin, process.stdout, pickle.dumps(request)):
                with _ended_after(process, seconds, late):
                    reply = process.stdout.read()
            code = process.wait()
        if late.is_set():
            raise TookTooLong
        if code or not reply:
            raise Crashed(_why(code, said))
    result, refusal = pickle.loads(reply)
    if refusal is not None:
        raise Refused(refusal)
    return result


@contextmanager
def _ended_after(process: subprocess.Popen[bytes], seconds: float | None, late: threading.Event) -> Iterator[None]:
    """Kill the process when so many seconds have passed, and set the event."""

    def end() -> None:
        late.set()
        process.kill()

    timer = threading.Timer(threading.TIMEOUT_MAX if seconds is None else seconds, end)
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _asked(stdin: IO[bytes], stdout: IO[bytes], request: bytes) -> bytes:
    """READY, once a process is; nothing if it dies before."""
    try:
        stdin.write(request)
        stdin.flush()
    except OSError:
        return b""
    return stdout.read(len(READY))


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
    ready, function, given, named = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    answer: tuple[Any, str | None]
    if ready is not None:
        ready()
    with os.fdopen(reply, "wb") as stream:
        stream.write(READY)
        stream.flush()
        try:
            answer = (function(*given, **named), None)
        except VemcvxError as error:
            answer = (None, str(error))
        pickle.dump(answer, stream)


def _end_with_parent() -> None:
    # Below Python's own buffer, which a thread that waits would hold at the end of the program.
    os.read(0, 1)
    os._exit(1)
