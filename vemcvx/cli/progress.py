"""A bar on standard error while it is a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn


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
