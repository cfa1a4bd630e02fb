"""Records said in lines, as prompts and notebooks show them, and tables as CSV, Markdown and HTML."""

from __future__ import annotations

import csv
import io
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import Field, dataclass, fields
from html import escape
from textwrap import shorten
from typing import Any, ClassVar, Literal

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import brief

Lines = Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Outline:
    """A title, and lines of names with what there is to say of them."""

    title: str
    lines: Lines

    def text(self) -> str:
        """In plain words, the names in a column."""
        width = max((len(name) for name, _ in self.lines), default=0)
        return "\n".join([self.title, *(f"    {name:<{width}}  {words}".rstrip() for name, words in self.lines)])

    def html(self) -> str:
        """The same as a table; a name that is empty goes on with the one before."""
        rows = "".join(
            f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(words)}</td></tr>'
            for name, words in self.lines
        )
        return f"<table><caption>{escape(self.title)}</caption>{rows}</table>"


class Outlined(ABC):
    """A record that shows its outline where its representation is asked for."""

    @abstractmethod
    def outline(self) -> Outline:
        """The title and lines to show."""

    def __repr__(self) -> str:
        return self.outline().text()

    def _repr_html_(self) -> str:
        return self.outline().html()


class ArrayRecord(Outlined):
    """A dataclass of arrays: of each field its shape, or its value where that is short."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def outline(self) -> Outline:
        """The fields in their order; those of arrays of arrays one by one."""
        lines: list[tuple[str, str]] = []
        for field in (field for field in fields(self) if field.repr):
            value = getattr(self, field.name)
            inner = value.outline().lines if isinstance(value, ArrayRecord) else [("", in_a_line(value))]
            lines += [(f"{field.name}.{name}".rstrip("."), words) for name, words in inner]
        return Outline(type(self).__name__, lines)


def in_a_line(value: object) -> str:
    """An array by its shape, anything else in at most a line."""
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, sp.csr_matrix):
        return f"{value.shape} sparse, {value.nnz} entries"
    if not isinstance(value, np.ndarray):
        return shorten(brief(value), 100)
    kind = {"b": "true or false", "i": "whole numbers", "f": ""}.get(value.dtype.kind, str(value.dtype))
    return f"{value.shape} {kind}".rstrip()


def coordinates(point: Iterable[float]) -> str:
    """A point in four digits, such as (0.3, 1.25)."""
    return f"({', '.join(f'{x:.4g}' for x in point)})"


Words = Sequence[str]


@dataclass(frozen=True)
class Table:
    """The one record of a table: headings, each with a unit after a line break where it has one, and rows of cells.

    Cells are words, except that CSV also takes numbers and writes them to the last digit. A table without headings is a
    list of names with what there is to say of them.
    """

    heads: Words
    rows: Sequence[Sequence[Any]]

    def text(self) -> str:
        """The table as plain text as wide as the terminal, numbers to the right; the last column is folded.

        However narrow the terminal is, no other column is cut: what digits were missing of would be other numbers.
        """
        from rich.console import Console  # Importing rich takes a tenth of a second.
        from rich.table import Table as Drawn

        drawn = Drawn(show_header=bool(self.heads), box=None, padding=(0, 1 if self.heads else 2, 0, 0), pad_edge=False)
        columns = list(zip(*self.rows, strict=True))
        for k, cells in enumerate(columns):
            number, head = bool(self.heads) and all(_kind(text) != "w" for text in cells), self.heads[k : k + 1]
            fixed = number or k < len(columns) - 1
            least = None if fixed else min(24, max(map(len, cells)))
            side: Literal["left", "right"] = "right" if number else "left"
            drawn.add_column(*head, justify=side, no_wrap=fixed, overflow="fold", min_width=least)
        for row in self.rows:
            drawn.add_row(*row)
        # Square brackets in what users write are no markup.
        console = Console(highlight=False, markup=False, color_system=None)
        needed = console.measure(drawn, options=console.options.update(max_width=sys.maxsize)).minimum
        console.width = max(console.width, needed + 1)  # It leaves out the space behind the last column.
        with console.capture() as captured:
            console.print(drawn)
        return "\n".join(line.rstrip() for line in captured.get().rstrip("\n").splitlines())

    def csv(self) -> str:
        """Comma-separated values, numbers to the last digit."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.heads)
        writer.writerows(self.rows)
        return text.getvalue()

    def markdown(self) -> str:
        """A table of Markdown, with numbers to the right."""
        lines = [[word.replace("|", r"\|").replace("\n", " ") for word in line] for line in (self.heads, *self.rows)]
        lines.insert(1, ["---:"] * len(self.heads))
        return "".join(f"| {' | '.join(line)} |\n" for line in lines)

    def html(self) -> str:
        """A table of HTML, with units in small below their headings; cells that are words have the class w."""
        kinds = map(_kind, self.rows[0]) if self.rows else [""] * len(self.heads)
        head = ""
        for kind, words in zip(kinds, self.heads, strict=True):
            text, line_break, below = words.partition("\n")
            small = f"<br/><small>{escape(below)}</small>" if line_break else ""
            head += f'<th class="{kind}">{escape(text)}{small}</th>'
        cells = ("".join(f'<td class="{_kind(text)}">{escape(text)}</td>' for text in row) for row in self.rows)
        lines = "".join(f"<tr>{row}</tr>" for row in cells)
        return f"<table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>"


def _kind(text: str) -> str:
    """The class of a cell: "" of numbers, "w" of words, "no" of a no."""
    number = text.lstrip("-")[:1].isdigit() or text in ("", "-", "yes")
    return "no" if text in ("no", "NO") else "" if number else "w"
