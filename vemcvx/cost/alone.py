"""A function in a process of its own.

What a run holds at its peak is then its own and not what runs before it left behind; BLAS has one thread, so that
seconds of runs side by side compare; and what runs out of memory or crashes takes nothing else with it.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vemcvx.errors import VemcvxError

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
PROGRAM = "from vemcvx.cost.alone import main; main()"


class Refused(Exception):
    """The function raised a VemcvxError; its message."""


class Crashed(Exception):
    """The process died, or raised anything else; what is known of why."""


def alone(function: Callable[..., Any], *given: Any) -> Any:
    """Call a function of a module in a new process, with arguments and result that can be pickled.

    Raises
    ------
    Refused, Crashed
    """
    with tempfile.TemporaryDirectory(prefix="vemcvx-") as folder:
        request, reply = Path(folder) / "request", Path(folder) / "reply"
        request.write_bytes(pickle.dumps((function, given)))
        path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
        env = {**os.environ, **dict.fromkeys(THREADS, "1"), "PYTHONPATH": path}
        command = [sys.executable, "-c", PROGRAM, str(request), str(reply)]
        run = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
        if run.returncode:
            raise Crashed(_why(run))
        result, refusal = pickle.loads(reply.read_bytes())
    if refusal is not None:
        raise Refused(refusal)
    return result


def _why(run: subprocess.CompletedProcess[str]) -> str:
    if run.returncode < 0:
        hint = ", as the system does to a process that takes too much memory" if run.returncode == -9 else ""
        return f"killed by signal {-run.returncode}{hint}"
    lines = run.stderr.strip().splitlines()
    return lines[-1] if lines else f"ended with exit code {run.returncode}"


def main() -> None:
    """Do what a request says: the other side of :func:`alone`."""
    request, reply = map(Path, sys.argv[1:])
    function, given = pickle.loads(request.read_bytes())
    try:
        answer = (function(*given), None)
    except VemcvxError as error:
        answer = (None, str(error))
    reply.write_bytes(pickle.dumps(answer))
