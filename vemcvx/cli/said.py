"""What commands say: whole lines into pipes and files; on a terminal broken between words, in their columns."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterable
from textwrap import TextWrapper

import typer

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
