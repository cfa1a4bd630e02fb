"""Output of commands: lines, a progress bar, and exit codes."""

from __future__ import annotations

import re
import shutil
import signal
import sys
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from textwrap import TextWrapper
from typing import Protocol

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn

from vemcvx.errors import NotCertified, VemcvxError

# What commands say: whole lines into pipes and files; on a terminal broken between words, in their columns.


COLUMN = re.compile(r"\s*(?:\S+ {2,})?")
"""What a line begins with, where names stand in a column."""


def say(text: str, err: bool = False) -> None:
    """Print a text to standard output or standard error."""
    terminal = (sys.stderr if err else sys.stdout).isatty()
    typer.echo(broken(text, shutil.get_terminal_size().columns) if terminal else text, err=err)


def say_words(rows: Iterable[tuple[str, str]]) -> None:
    """Print rows of a name and words; on a terminal the words are broken in their column."""
    # It takes a tenth of a second to load, and only some commands need it.
    from rich.console import Console
    from rich.table import Table

    made = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    made.add_column(style="bold", no_wrap=True)
    made.add_column(overflow="fold")
    for name, text in rows:
        made.add_row(name, text)
    # Square brackets in what users write are no markup.
    Console(highlight=False, markup=False).print(made)


def broken(text: str, width: int) -> str:
    """A text in lines of at most so many characters, but for words that are longer."""
    return "\n".join(_broken(line, width) for line in text.split("\n"))


def _broken(line: str, width: int) -> str:
    column = COLUMN.match(line)
    indent = column.end() if column else 0
    if len(line) <= width or indent > width // 2:
        return line
    wrap = TextWrapper(width - indent, break_long_words=False, break_on_hyphens=False)
    return line[:indent] + f"\n{' ' * indent}".join(wrap.wrap(line[indent:]))


# A bar on standard error while it is a terminal.


class Shown(Protocol):
    """Moves a bar on."""

    def __call__(self, doing: str, finished: int, total: int, left: str = "") -> None:
        """Show what is done, how far, and in words how long it will take."""


LEFT = TextColumn("{task.fields[left]}")
"""The column for these words."""


@contextmanager
def progress_bar(doing: str, time_left: ProgressColumn) -> Iterator[Shown | None]:
    """A bar that says what it is doing; None, and nothing shown, where standard error is no terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), time_left
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(doing, total=None, left="")

        def show(doing: str, finished: int, total: int, left: str = "") -> None:
            bar.update(task, description=doing, completed=finished, total=total, left=left)

        yield show


# How a command ends: errors as a line and an exit code, 0 done, 2 invalid input, 3 not certified.
#
# SIGTERM and SIGHUP end a command as Ctrl-C does: terminal and folders are left in order.


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
