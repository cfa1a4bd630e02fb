"""Tables as text, CSV, Markdown and HTML."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import zip_longest
from shutil import get_terminal_size
from textwrap import wrap
from typing import Any


@dataclass(frozen=True)
class Table:
    """A table of strings, or of numbers for CSV. In a heading, a line break precedes the unit."""

    heads: Sequence[str]
    rows: Sequence[Sequence[Any]]

    def text(self) -> str:
        """Return plain text, with the last column wrapped at the width of the terminal."""
        columns, gap = list(zip(*self.rows, strict=True)), " " if self.heads else "  "
        numbers = [bool(self.heads) and all(_kind(text) != "w" for text in cells) for cells in columns]
        tall = max((head.count("\n") for head in self.heads), default=0)
        heads = ["\n" * (tall - head.count("\n")) + head for head in self.heads]
        rows = [[cell.split("\n") for cell in row] for row in (*([heads] if heads else []), *self.rows)]
        widths = [max(len(line) for cell in column for line in cell) for column in zip(*rows, strict=True)]
        if widths and not numbers[-1]:
            left = get_terminal_size().columns - sum(widths[:-1]) - len(gap) * len(widths[1:])
            widths[-1] = min(widths[-1], max(left, 24))
        lines = []
        for *cells, last in rows:
            folded = [part for line in last for part in wrap(line, max(widths[-1], 1)) or [""]]
            for parts in zip_longest(*cells, folded, fillvalue=""):
                cells_in_line = zip(parts, numbers, widths, strict=True)
                line = gap.join(word.rjust(w) if number else word.ljust(w) for word, number, w in cells_in_line)
                lines.append(line.rstrip())
        return "\n".join(lines)

    def csv(self) -> str:
        """Return comma-separated values with all digits."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.heads)
        writer.writerows(self.rows)
        return text.getvalue()

    def markdown(self) -> str:
        """Return a Markdown table with right-aligned columns."""
        lines = [[word.replace("|", r"\|").replace("\n", " ") for word in line] for line in (self.heads, *self.rows)]
        lines.insert(1, ["---:"] * len(self.heads))
        return "".join(f"| {' | '.join(line)} |\n" for line in lines)

    def html(self) -> str:
        """Return an HTML table."""
        kinds = map(_kind, self.rows[0]) if self.rows else [""] * len(self.heads)
        head = ""
        for kind, words in zip(kinds, self.heads, strict=True):
            text, line_break, below = words.partition("\n")
            small = f"<br/><small>{escape(below)}</small>" if line_break else ""
            head += f'<th class="{kind}">{escape(text)}{small}</th>'
        rows = ("".join(f'<td class="{_kind(text)}">{escape(text)}</td>' for text in row) for row in self.rows)
        return f"<table><thead><tr>{head}</tr></thead><tbody><tr>{'</tr><tr>'.join(rows)}</tr></tbody></table>"


def _kind(text: str) -> str:
    """Return the HTML class of a cell."""
    number = text.lstrip("-")[:1].isdigit() or text in ("", "-", "yes")
    return "no" if text in ("no", "NO") else "" if number else "w"
