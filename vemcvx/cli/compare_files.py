"""Files of a comparison: JSON with everything, CSV with the table, an HTML page that needs nothing else."""

from __future__ import annotations

import html
import json
from collections.abc import Callable
from dataclasses import asdict, astuple, fields
from pathlib import Path
from typing import Any

import numpy as np

from vemcvx.cli.compare import Compared
from vemcvx.cli.compare_tables import COLUMNS, remarks, settings_used
from vemcvx.cli.judgement import Row
from vemcvx.cli.pages import page
from vemcvx.errors import ProblemError
from vemcvx.solvers.settings import TUNED
from vemcvx.tables import csv_text
from vemcvx.tables import html as html_table
from vemcvx.version import __version__

NAMES = tuple(field.name for field in fields(Row))


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
    return csv_text(NAMES, map(astuple, found.judged.rows))


def as_html(found: Compared) -> str:
    """A page with the tables of the terminal, all columns, and the reasons of settings."""
    heads = ["solver", "settings", *(f"{column.head}\n{column.unit}" for column in COLUMNS), "outcome"]
    body = [
        [row.solver, row.settings, *(column.cell(row) for column in COLUMNS), f"{row.outcome}: {row.says}".rstrip(": ")]
        for row in found.judged.rows
    ]
    why = [[solver, *reason] for solver, settings, _ in settings_used(found) for reason in _reasons(solver, settings)]
    return page(
        found.title,
        f"<p>{html.escape(found.size)}</p>{html_table(heads, body)}"
        + "".join(f"<p>{html.escape(line)}</p>" for line in remarks(found))
        + "<h2>Settings tuned for solvers</h2>"
        + html_table(["solver", "setting", "value", "why"], why),
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


def _finite(value: Any) -> Any:
    return str(value) if isinstance(value, float) and not np.isfinite(value) else value
