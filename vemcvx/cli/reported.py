"""How a command ends: errors as a line and an exit code, 0 done, 2 invalid input, 3 not certified.

SIGTERM and SIGHUP end a command as Ctrl-C does: terminal and folders are left in order.
"""

from __future__ import annotations

import signal
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from vemcvx.cli.said import say
from vemcvx.errors import NotCertified, VemcvxError

INVALID, NOT_CERTIFIED = 2, 3


class Ended(BaseException):
    """The system has asked the command to end; `args` has the number of the signal."""


@contextmanager
def reported() -> Iterator[None]:
    """Turn errors into a line and an exit code, and warnings into a line."""

    def warn(message: Warning | str, *_: object, **__: object) -> None:
        say(f"vemcvx: warning: {message}", err=True)

    try:
        with warnings.catch_warnings(), _ended_in_order():
            warnings.showwarning = warn
            yield
    except VemcvxError as error:
        say(f"vemcvx: {error}", err=True)
        raise typer.Exit(NOT_CERTIFIED if isinstance(error, NotCertified) else INVALID) from error
    except MemoryError as error:
        words = "take a coarser mesh (--n), fewer steps (--steps), or store fewer (--store)"
        say(f"vemcvx: not enough memory: {error or 'none is left'}; {words}.", err=True)
        raise typer.Exit(INVALID) from error
    except SystemExit as error:
        say(f"vemcvx: the problem's own code ended the program by SystemExit({error.code!r}).", err=True)
        raise typer.Exit(INVALID) from error
    except KeyboardInterrupt as stop:
        kept = "`run --resume DIR` goes on with what --out DIR has kept, `cost` with the runs it has finished"
        say(f"vemcvx: interrupted; {kept}.", err=True)
        raise typer.Exit(128 + signal.SIGINT) from stop
    except Ended as error:
        raise typer.Exit(128 + error.args[0]) from error


@contextmanager
def _ended_in_order() -> Iterator[None]:
    """Let the signals that end a process raise Ended, unless somebody handles or ignores them."""

    def end(number: int, _: object) -> None:
        raise Ended(number)

    asked = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    main = threading.current_thread() is threading.main_thread()
    ours = [number for number in asked if main and signal.getsignal(number) is signal.SIG_DFL]
    try:
        for number in ours:
            signal.signal(number, end)
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)
