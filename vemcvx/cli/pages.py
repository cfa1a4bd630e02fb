"""Pages of HTML that need nothing else: their style stands in them, their pictures, too."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

from vemcvx.outline import Lines, Outline
from vemcvx.tables import html as table
from vemcvx.version import __version__

MARK = '<meta name="generator" content="vemcvx">'
"""By which pages of ours are known."""
STYLE = (
    "body{font:15px/1.4 sans-serif;margin:2em auto;padding:0 1em;max-width:75em}"
    "table{border-collapse:collapse;margin:1em 0}"
    "th,td{padding:.2em .7em;text-align:right;border-bottom:1px solid #ccc}th{vertical-align:bottom}"
    ".w{text-align:left}small{font-weight:normal;color:#666}.no{color:#b00}"
)


def page(title: str, body: str, style: str = "") -> str:
    """A page of a title in words and a body of HTML, with style of its own beside what all pages share."""
    head = f'<meta charset="utf-8">{MARK}<meta name="viewport" content="width=device-width">'
    head += f"<title>{escape(title)}</title><style>{STYLE}{style}</style>"
    foot = f"<p><small>vemcvx {__version__}</small></p>"
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}</head>\n'
        f"<body><h1>{escape(title)}</h1>{body}{foot}</body></html>\n"
    )


def words(title: str, lines: Lines) -> str:
    """Lines of a name and words, as a table with a title."""
    return f'<div class="wide">{Outline(title, lines).html()}</div>'


def numbers(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table with heads, which is moved sideways where the page is narrow."""
    return f'<div class="wide">{table(heads, rows)}</div>'


def figure(value: float) -> str:
    """A number in six digits."""
    return f"{value:.6g}"


def short(value: float) -> str:
    """An error in two digits."""
    return f"{value:.1e}"
