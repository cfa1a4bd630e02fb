"""A function in a process of its own.

What a run holds at its peak is then its own and not what runs before it left behind; BLAS has one thread, so that
seconds of runs side by side compare; and what runs out of memory or crashes takes nothing else with it. The process
ends when the one that started it does, however that ends: its standard input, which stays open, is closed then.
"""

from __future__ import annotations

import faulthandler
import os
import pickle
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any, ParamSpec, TypeVar

from vemcvx.errors import VemcvxError

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
Given = ParamSpec("Given")
Result = TypeVar("Result")
LATE = b"Timeout ("
"""How the reply begins of a process that faulthandler has ended; no pickle does."""
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
