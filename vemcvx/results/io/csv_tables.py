"""The tables of a history as CSV files, for spreadsheets and scripts; flags are 1 and 0."""

from __future__ import annotations

from pathlib import Path

from numpy.typing import ArrayLike

from vemcvx.results.results import Results
from vemcvx.results.tables import CONTACT, PROBES, STEPS, table
from vemcvx.tables import csv_text

FILES = {name: f"{name}.csv" for name in (STEPS, CONTACT, PROBES)}


def write_tables(history: Results, folder: Path, points: ArrayLike | None) -> list[str]:
    """Write those that have rows; the names of the files."""
    wanted = {STEPS: True, CONTACT: len(history.contact.nodes) > 0, PROBES: points is not None}
    names = [name for name, has_rows in wanted.items() if has_rows]
    for name in names:
        columns = table(history, name, points if name == PROBES else None)
        plain = [(values.astype(int) if values.dtype == bool else values).tolist() for values in columns.values()]
        text = csv_text(list(columns), zip(*plain, strict=True))
        (folder / FILES[name]).write_text(text, encoding="utf-8")
    return [FILES[name] for name in names]
