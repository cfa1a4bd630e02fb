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
from collections.abc import Callable
from typing import IO, Any, ParamSpec, TypeVar

from vemcvx.errors import VemcvxError

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
Given = ParamSpec("Given")
Result = TypeVar("Result")
PROGRAM = "from vemcvx.cost.alone import main; main()"


class Refused(Exception):
    """The function raised a VemcvxError; its message."""


class Crashed(Exception):
    """The process died, or raised anything else; what is known of why."""


def alone(function: Callable[Given, Result], *given: Given.args, **named: Given.kwargs) -> Result:
    """Call a function of a module in a new process, with arguments and result that can be pickled.

    Raises
    ------
    Refused, Crashed
    """
    request = pickle.dumps((function, given, named))
    path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
    env = {**os.environ, **dict.fromkeys(THREADS, "1"), "PYTHONPATH": path}
    # A file without a name: nothing is left of it, whatever happens.
    with tempfile.TemporaryFile() as said:
        pipe, command = subprocess.PIPE, [sys.executable, "-c", PROGRAM]
        with subprocess.Popen(command, env=env, stdin=pipe, stdout=pipe, stderr=said) as process:
            reply = _asked(process.stdin, process.stdout, request) if process.stdin and process.stdout else b""
            code = process.wait()
        if code or not reply:
            raise Crashed(_why(code, said))
    answer: tuple[Result, str | None] = pickle.loads(reply)
    result, refusal = answer
    if refusal is not None:
        raise Refused(refusal)
    return result


def _asked(stdin: IO[bytes], stdout: IO[bytes], request: bytes) -> bytes:
    """What a process answers; nothing if it dies before."""
    try:
        stdin.write(request)
        stdin.flush()
    except OSError:
        return b""
    return stdout.read()


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
    function, given, named = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    answer: tuple[Any, str | None]
    try:
        answer = (function(*given, **named), None)
    except VemcvxError as error:
        answer = (None, str(error))
    with os.fdopen(reply, "wb") as stream:
        pickle.dump(answer, stream)


def _end_with_parent() -> None:
    # Below Python's own buffer, which a thread that waits would hold at the end of the program.
    os.read(0, 1)
    os._exit(1)
