"""Records in lines of words, for prompts and notebooks, and tables as text, CSV, Markdown and HTML."""

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
    """A title, and lines of a name and words."""

    title: str
    lines: Lines

    def text(self) -> str:
        """Return plain text, the names in a column."""
        width = max((len(name) for name, _ in self.lines), default=0)
        return "\n".join([self.title, *(f"    {name:<{width}}  {words}".rstrip() for name, words in self.lines)])

    def html(self) -> str:
        """Return a table of HTML."""
        rows = "".join(
            f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(words)}</td></tr>'
            for name, words in self.lines
        )
        return f"<table><caption>{escape(self.title)}</caption>{rows}</table>"


class Outlined(ABC):
    """A record whose representation is its outline."""

    @abstractmethod
    def outline(self) -> Outline:
        """Return the title and lines to show."""

    def __repr__(self) -> str:
        return self.outline().text()

    def _repr_html_(self) -> str:
        return self.outline().html()


class ArrayRecord(Outlined):
    """A dataclass of arrays, whose outline has the shape of each field, or a short value."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def outline(self) -> Outline:
        """Return the fields in their order, those of inner records one by one."""
        lines: list[tuple[str, str]] = []
        for field in (field for field in fields(self) if field.repr):
            value = getattr(self, field.name)
            inner = value.outline().lines if isinstance(value, ArrayRecord) else [("", in_a_line(value))]
            lines += [(f"{field.name}.{name}".rstrip("."), words) for name, words in inner]
        return Outline(type(self).__name__, lines)


def in_a_line(value: object) -> str:
    """Return the shape of an array, or anything else in at most a line."""
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
    """Return a point in four digits, such as (0.3, 1.25)."""
    return f"({', '.join(f'{x:.4g}' for x in point)})"


@dataclass(frozen=True)
class Table:
    """A table: headings, each with its unit after a line break, and rows of cells.

    Cells are words; CSV also takes numbers. A table without headings is a list of names and words.
    """

    heads: Sequence[str]
    rows: Sequence[Sequence[Any]]

    def text(self) -> str:
        """Return plain text, numbers to the right; only the last column is folded to the width of the terminal."""
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
        console = Console(highlight=False, markup=False, color_system=None)
        needed = console.measure(drawn, options=console.options.update(max_width=sys.maxsize)).minimum
        console.width = max(console.width, needed + 1)  # It leaves out the space behind the last column.
        with console.capture() as captured:
            console.print(drawn)
        return "\n".join(line.rstrip() for line in captured.get().rstrip("\n").splitlines())

    def csv(self) -> str:
        """Return comma-separated values, numbers to the last digit."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.heads)
        writer.writerows(self.rows)
        return text.getvalue()

    def markdown(self) -> str:
        """Return a table of Markdown, all columns but words to the right."""
        lines = [[word.replace("|", r"\|").replace("\n", " ") for word in line] for line in (self.heads, *self.rows)]
        lines.insert(1, ["---:"] * len(self.heads))
        return "".join(f"| {' | '.join(line)} |\n" for line in lines)

    def html(self) -> str:
        """Return a table of HTML, with units in small below their headings; cells of words have the class w."""
        kinds = map(_kind, self.rows[0]) if self.rows else [""] * len(self.heads)
        head = ""
        for kind, words in zip(kinds, self.heads, strict=True):
            text, line_break, below = words.partition("\n")
            small = f"<br/><small>{escape(below)}</small>" if line_break else ""
            head += f'<th class="{kind}">{escape(text)}{small}</th>'
        rows = ("".join(f'<td class="{_kind(text)}">{escape(text)}</td>' for text in row) for row in self.rows)
        return f"<table><thead><tr>{head}</tr></thead><tbody><tr>{'</tr><tr>'.join(rows)}</tr></tbody></table>"


def _kind(text: str) -> str:
    """Return the class of a cell: "" for numbers, "w" for words, "no" for a no."""
    number = text.lstrip("-")[:1].isdigit() or text in ("", "-", "yes")
    return "no" if text in ("no", "NO") else "" if number else "w"
