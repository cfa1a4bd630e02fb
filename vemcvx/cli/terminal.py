"""Output of commands: lines, a progress bar, and exit codes."""

from __future__ import annotations

import logging
import shutil
import signal
import sys
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
COLUMN = 12  # Width of the name at the start of a line, and indentation of continuation lines.


def say(text: str, err: bool = False) -> None:
    """Print a text to standard output or standard error; on a terminal, break lines between words."""
    if (sys.stderr if err else sys.stdout).isatty():
        wrapper = TextWrapper(shutil.get_terminal_size().columns, subsequent_indent=" " * COLUMN)
        wrapper.break_long_words = wrapper.break_on_hyphens = False
        text = "\n".join(map(wrapper.fill, text.split("\n")))
    typer.echo(text, err=err)


def parse_list(option: str, typed: str, kind: Callable[[str], T], wanted: str) -> tuple[T, ...]:
    """Return the distinct values in the comma-separated text of an option."""
    try:
        parts = tuple(dict.fromkeys(kind(part.strip()) for part in typed.split(",") if part.strip()))
    except ValueError:
        parts = ()
    if not parts:
        raise ProblemError(f"{option}: found {typed!r}; wanted {wanted}.")
    return parts


FRACTIONS = "relative errors between 0 and 1, such as 0.05,0.01"


def fraction(word: str) -> float:
    """Return a word as a number between 0 and 1, or raise ValueError."""
    if not 0 < float(word) < 1:
        raise ValueError
    return float(word)


def write_text(path: Path, text: str, option: str) -> None:
    """Write the file that an option names, or raise ProblemError."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ProblemError(f"{option}: {path} cannot be written: {error.strerror}.") from error


ShowProgress = Callable[[str, int, int | None], None]
"""A function (doing, finished, total) that shows the progress of a command; `total` is None if unknown."""
LINE_INTERVAL = 10.0  # Seconds between progress lines if there is no terminal.


@contextmanager
def progress_bar(doing: str) -> Iterator[ShowProgress]:
    """Show progress on standard error, by a bar on terminals and by lines elsewhere."""
    if not sys.stderr.isatty():
        yield ProgressLines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[counted]}"), TimeElapsedColumn()
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(doing, total=None, counted="")

        def show(doing: str, finished: int, total: int | None) -> None:
            if doing != bar.tasks[task].description:
                bar.reset(task, description=doing)
            counted = "" if total is None else f"{finished}/{total}"
            bar.update(task, completed=finished, total=total, counted=counted)

        yield show


class ProgressLines:
    """Lines on standard error, one every `LINE_INTERVAL` seconds: task, progress and elapsed time."""

    def __init__(self) -> None:
        self.start = self.last_line = time.monotonic()

    def __call__(self, doing: str, finished: int, total: int | None) -> None:
        """Print a line if the last line is older than `LINE_INTERVAL`."""
        now = time.monotonic()
        if now - self.last_line >= LINE_INTERVAL:
            counted = "" if total is None else f" {finished} of {total}"
            say(f"vemcvx: {doing}{counted}, {now - self.start:.0f} s", err=True)
            self.last_line = now


@contextmanager
def limit_log(times: int) -> Iterator[None]:
    """Limit the number of log lines with the same text before the colon."""
    counts: Counter[str] = Counter()

    def is_within_limit(record: logging.LogRecord) -> bool:
        kind = record.getMessage().split(":")[0]
        counts[kind] += 1
        return counts[kind] <= times

    log = logging.getLogger("vemcvx")
    log.addFilter(is_within_limit)
    try:
        yield
    finally:
        log.removeFilter(is_within_limit)


INVALID, NOT_CERTIFIED = 2, 3
"""Exit codes of commands that fail."""


@contextmanager
def report_errors() -> Iterator[None]:
    """Print errors and warnings of the block; exit after an error."""
    shown = set[str]()

    def warn(message: Warning | str, *_: object, **__: object) -> None:
        if str(message) not in shown:
            say(f"vemcvx: warning: {message}", err=True)
        shown.add(str(message))

    def end(words: str, code: int) -> typer.Exit:
        say(f"vemcvx: {words}", err=True)
        return typer.Exit(code)

    try:
        with warnings.catch_warnings():
            warnings.showwarning = warn
            yield
    except VemcvxError as error:
        raise end(str(error), NOT_CERTIFIED if isinstance(error, NotCertified) else INVALID) from error
    except MemoryError as error:
        advice = "take a coarser mesh (--n), fewer steps (--steps), or store fewer of them (--store)"
        raise end(f"not enough memory: {error or 'none is left'}; {advice}.", INVALID) from error
    except KeyboardInterrupt as stop:
        raise end("interrupted; `run --resume DIR` continues a run that has --out DIR.", 128 + signal.SIGINT) from stop
