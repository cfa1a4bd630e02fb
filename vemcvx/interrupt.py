"""Ctrl-C while the command line is imported: a line and exit code 130, as later, instead of a traceback.

Importing takes half a second and more. Nothing is begun then that would have to be left in order.
"""

from __future__ import annotations

import os
import signal
import sys
import threading


def as_usual() -> None:
    """Let Ctrl-C raise KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is _end:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _end(*_: object) -> None:
    os.write(2, b"vemcvx: interrupted.\n")
    os._exit(128 + signal.SIGINT)


def _starts() -> bool:
    """Return True if this process is the command line, `vemcvx` or `python -m vemcvx`."""
    words = sys.orig_argv[1:]
    module = "-m" in words and words[words.index("-m") + 1 :][:1] == ["vemcvx"]
    script = os.path.splitext(os.path.basename(sys.argv[0] if sys.argv else ""))[0] == "vemcvx"
    main = threading.current_thread() is threading.main_thread()
    return main and (module or script) and signal.getsignal(signal.SIGINT) is signal.default_int_handler


# The package imports this module before all others.
if _starts():
    signal.signal(signal.SIGINT, _end)
