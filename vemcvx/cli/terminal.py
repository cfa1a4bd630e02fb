"""Output of commands: lines, a progress bar, and exit codes."""

from __future__ import annotations

import logging
import shutil
import signal
import sys
import threading
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import TextWrapper
from typing import TypeVar

import typer

from vemcvx.base.errors import NotCertified, ProblemError, VemcvxError

T = TypeVar("T")
COLUMN = 12  # Where words begin in a line that names what it is about, and go on in the next.


def say(text: str, err: bool = False) -> None:
    """Print a text to standard output or standard error, where a terminal gets lines that fit."""
    terminal = (sys.stderr if err else sys.stdout).isatty()
    typer.echo(broken(text, shutil.get_terminal_size().columns) if terminal else text, err=err)


def broken(text: str, width: int) -> str:
    """Return a text in lines of at most so many characters, but for words that are longer."""
    wrapper = TextWrapper(width, subsequent_indent=" " * COLUMN, break_long_words=False, break_on_hyphens=False)
    return "\n".join(map(wrapper.fill, text.split("\n")))


def listed(option: str, typed: str, kind: Callable[[str], T], wanted: str) -> tuple[T, ...]:
    """Return the values of an option that takes several, with commas between, in their order and each once.

    `kind` makes a value of its words and raises ValueError where they mean none; `wanted` says what they should be.
    """
    try:
        parts = tuple(dict.fromkeys(kind(part.strip()) for part in typed.split(",") if part.strip()))
    except ValueError:
        parts = ()
    if not parts:
        raise ProblemError(f"{option}: found {typed!r}; wanted {wanted}.")
    return parts


def check_writable(path: Path, option: str) -> None:
    """Fail before the work starts if the file cannot be written."""
    if path.is_dir() or not path.parent.is_dir():
        raise ProblemError(
            f"{option}: {path} cannot be written: its folder must exist, and the file must not be a folder."
        )


def write_text(path: Path, text: str, option: str) -> None:
    """Write the file that an option asks for."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ProblemError(f"{option}: {path} cannot be written: {error.strerror}.") from error


Shown = Callable[[str, int, int | None], None]
"""A function (doing, finished, total) that says how far a command is; `total` is None if unknown."""
EVERY = 10.0  # Seconds between lines where there is no terminal, so that shorter runs say nothing.


@contextmanager
def progress_bar(doing: str) -> Iterator[Shown]:
    """Show on standard error what is done, how far and for how long: a bar on a terminal, else a line at times."""
    if not sys.stderr.isatty():
        yield Lines(doing)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[counted]}"), TimeElapsedColumn()
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(doing, total=None, counted="")

        def shown(doing: str, finished: int, total: int | None) -> None:
            if doing != bar.tasks[task].description:
                bar.reset(task, description=doing)
            counted = "" if total is None else f"{finished}/{total}"
            bar.update(task, completed=finished, total=total, counted=counted)

        yield shown


class Lines:
    """Lines on standard error, `EVERY` so many seconds: what is done, how far, and how long it still takes."""

    def __init__(self, doing: str):
        self.begun = self.said = self.since = time.monotonic()
        self.doing, self.first = doing, 0

    def __call__(self, doing: str, finished: int, total: int | None) -> None:
        """Note how far a command is, and say so if the last line is old."""
        now = time.monotonic()
        if doing != self.doing:
            self.doing, self.first, self.since = doing, finished, now
        if now - self.said < EVERY:
            return
        self.said, words = now, f"vemcvx: {doing}"
        if total is not None:
            words += f" {finished} of {total}"
        words += f", {now - self.begun:.0f} s"
        if total is not None and finished > self.first:
            words += f", {(now - self.since) * (total - finished) / (finished - self.first):.0f} s left"
        say(words, err=True)


@contextmanager
def logged_at_most(times: int) -> Iterator[None]:
    """Let each kind of line of the package's log, by its words before a colon, be logged so many times within."""
    counts: Counter[str] = Counter()

    def wanted(record: logging.LogRecord) -> bool:
        kind = record.getMessage().split(":")[0]
        counts[kind] += 1
        return counts[kind] <= times

    log = logging.getLogger("vemcvx")
    log.addFilter(wanted)
    try:
        yield
    finally:
        log.removeFilter(wanted)


INVALID, NOT_CERTIFIED = 2, 3
"""Exit codes of commands that are not done. SIGTERM and SIGHUP end them as Ctrl-C does, and all is left in order."""


class Ended(BaseException):
    """The system has asked the command to end; `args` has the number of the signal."""


@contextmanager
def reported() -> Iterator[None]:
    """Turn errors into a line and an exit code, and warnings into a line."""

    def warn(message: Warning | str, *_: object, **__: object) -> None:
        say(f"vemcvx: warning: {message}", err=True)

    def end(words: str, code: int) -> typer.Exit:
        say(f"vemcvx: {words}", err=True)
        return typer.Exit(code)

    try:
        with warnings.catch_warnings(), _ended_in_order():
            warnings.showwarning = warn
            yield
    except VemcvxError as error:
        raise end(str(error), NOT_CERTIFIED if isinstance(error, NotCertified) else INVALID) from error
    except MemoryError as error:
        advice = "take a coarser mesh (--n), fewer steps (--steps), or store fewer (--store)"
        raise end(f"not enough memory: {error or 'none is left'}; {advice}.", INVALID) from error
    except SystemExit as error:
        raise end(f"the problem's own code ended the program by SystemExit({error.code!r}).", INVALID) from error
    except KeyboardInterrupt as stop:
        kept = "`run --resume DIR` continues what --out DIR has kept, and `cost` keeps the runs that it has finished"
        raise end(f"interrupted; {kept}.", 128 + signal.SIGINT) from stop
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
