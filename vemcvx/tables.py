"""Tables of words and numbers as CSV, Markdown, LaTeX and HTML."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from html import escape

Words = Sequence[str]
SPECIAL = str.maketrans(
    {mark: f"\\{mark}" for mark in "&%#_{}$"}
    | {mark: f"${mark}$" for mark in "|<>"}
    | {"\\": r"\textbackslash{}", "^": r"\^{}", "~": r"\~{}"}
)
"""Characters that mean something else to LaTeX."""


def csv_text(heads: Words, rows: Iterable[Iterable[object]]) -> str:
    """Comma-separated values, numbers to the last digit."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(rows)
    return text.getvalue()


def markdown(heads: Words, rows: Iterable[Words]) -> str:
    """A table of Markdown, with numbers to the right."""
    lines = [[word.replace("|", r"\|") for word in line] for line in (heads, *rows)]
    lines.insert(1, ["---:"] * len(heads))
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def latex(heads: Words, rows: Iterable[Words]) -> str:
    """A tabular of LaTeX that needs no package; what stands between dollar signs is a formula."""
    lines = [" & ".join(map(_escaped, line)) + r" \\" for line in (heads, *rows)]
    begin, end = rf"\begin{{tabular}}{{{'r' * len(heads)}}}", r"\end{tabular}"
    return "\n".join([begin, r"\hline", lines[0], r"\hline", *lines[1:], r"\hline", end, ""])


def _escaped(word: str) -> str:
    parts = word.split("$")
    if len(parts) % 2 == 0:
        return word.translate(SPECIAL)
    return "$".join(part if k % 2 else part.translate(SPECIAL) for k, part in enumerate(parts))


def html(heads: Words, rows: Iterable[Words]) -> str:
    """A table of HTML; what follows a line break in a head stands below it in small, words have the class w."""
    rows = list(rows)
    kinds = map(_kind, rows[0]) if rows else [""] * len(heads)
    head = "".join(_head(kind, *text.partition("\n")) for kind, text in zip(kinds, heads, strict=True))
    lines = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>"


def _head(kind: str, text: str, line_break: str, unit: str) -> str:
    below = f"<br/><small>{escape(unit)}</small>" if line_break else ""
    return f'<th class="{kind}">{escape(text)}{below}</th>'


def _cell(text: str) -> str:
    return f'<td class="{_kind(text)}">{escape(text)}</td>'


def _kind(text: str) -> str:
    number = text.lstrip("-")[:1].isdigit() or text in ("", "-", "yes")
    return "no" if text in ("no", "NO") else "" if number else "w"
