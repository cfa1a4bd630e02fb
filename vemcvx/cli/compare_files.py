"""Files of a comparison: JSON with everything, CSV with the table, an HTML page that needs nothing else."""

from __future__ import annotations

import csv
import html
import io
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from vemcvx.cli.compare import Compared
from vemcvx.cli.compare_tables import COLUMNS, remarks, settings_used
from vemcvx.cli.judgement import Row
from vemcvx.errors import ProblemError
from vemcvx.solvers.settings import TUNED
from vemcvx.version import __version__

NAMES = tuple(field.name for field in fields(Row))
STYLE = (
    "body{font:15px sans-serif;margin:2em;max-width:75em}table{border-collapse:collapse;margin:1em 0}"
    "th,td{padding:.2em .7em;text-align:right;border-bottom:1px solid #ccc}th{vertical-align:bottom}"
    ".w{text-align:left}small{font-weight:normal;color:#666}.no{color:#b00}"
)


def as_json(found: Compared) -> str:
    """All rows, the settings used with their reasons, and how to read them; what is not finite is a string."""
    rows = [{key: _finite(value) for key, value in asdict(row).items()} for row in found.judged.rows]
    used = [
        {"solver": solver, "settings": settings, "passed_on": words, "reasons": _reasons(solver, settings)}
        for solver, settings, words in settings_used(found)
    ]
    told = {
        "format": "vemcvx comparison",
        "version": __version__,
        "problem": found.title,
        "size": found.size,
        "units": "errors: relative to the largest energy norm of the states so far; times: seconds",
        "most_certain": found.judged.most_certain,
        "certificates_bound_distances": found.judged.rigorous,
        "trustworthy": found.judged.trustworthy,
        "rows": rows,
        "settings": used,
    }
    return json.dumps(told, indent=1) + "\n"


def as_csv(found: Compared) -> str:
    """One line a row, by the same names."""
    text = io.StringIO()
    writer = csv.DictWriter(text, NAMES, lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in found.judged.rows)
    return text.getvalue()


def as_html(found: Compared) -> str:
    """A page with the tables of the terminal, all columns, and the reasons of settings."""
    heads = ["solver", "settings", *(f"{c.head}<br><small>{c.unit}</small>" for c in COLUMNS), "outcome"]
    body = [
        [row.solver, row.settings, *(column.cell(row) for column in COLUMNS), f"{row.outcome}: {row.says}".rstrip(": ")]
        for row in found.judged.rows
    ]
    why = [[solver, *reason] for solver, settings, _ in settings_used(found) for reason in _reasons(solver, settings)]
    title = html.escape(found.title)
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
        f"<h1>{title}</h1><p>{html.escape(found.size)}</p>{_html_table(heads, body)}"
        + "".join(f"<p>{html.escape(line)}</p>" for line in remarks(found))
        + "<h2>Settings tuned for solvers</h2>"
        + _html_table(["solver", "setting", "value", "why"], why)
        + f"<p><small>vemcvx {__version__}</small></p></html>\n"
    )


WRITERS: dict[str, Callable[[Compared], str]] = {"json": as_json, "csv": as_csv, "html": as_html}


def check_writable(path: Path, option: str) -> None:
    """Raise ProblemError for a file that could not be written: early, before the work is done."""
    if path.is_dir() or not path.parent.is_dir():
        raise ProblemError(f"{option}: {path} cannot be written: its folder must exist, and it must be none itself.")


def _reasons(solver: str, settings: str) -> list[tuple[str, str, str]]:
    """(setting, value, reason) of those tuned for a solver."""
    found = TUNED.get(solver.upper(), ()) if settings == "tuned" else ()
    return [(setting.name, setting.words, setting.why) for setting in found]


def _html_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f"<th>{text}</th>" for text in heads)
    lines = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table>"


def _cell(text: str) -> str:
    kind = "no" if text in ("no", "NO") else "" if text[:1].isdigit() or text in ("-", "yes") else "w"
    return f'<td class="{kind}">{html.escape(text)}</td>'


def _finite(value: Any) -> Any:
    return str(value) if isinstance(value, float) and not np.isfinite(value) else value
