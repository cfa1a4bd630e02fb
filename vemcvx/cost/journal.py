"""The journal of a sweep: one line of JSON a finished point, on the disk before the next one is looked at.

A process that dies while it writes leaves a torn last line. Reading leaves out what is no whole line of this format,
and writing begins on a line of its own.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path

from vemcvx.cost.table import CRASHED, Row
from vemcvx.errors import HistoryError


def read_journal(path: Path) -> dict[str, Row]:
    """The finished points by key, each as it was last written; crashed ones are to be tried again and left out."""
    try:
        lines = path.read_bytes().splitlines() if path.exists() else []
    except OSError as error:
        raise HistoryError(f"{path}: cannot read the journal: {error}.") from error
    rows = [row for line in lines if (row := _row(line)) is not None]
    latest = {row.key: row for row in rows}
    return {key: row for key, row in latest.items() if row.status != CRASHED}


def _row(line: bytes) -> Row | None:
    try:
        row = Row(**json.loads(line))
    except (ValueError, TypeError, RecursionError):
        return None
    return row if row.whole else None


def append(path: Path, row: Row) -> None:
    """Write a row, down to the disk."""
    line = (json.dumps(asdict(row), allow_nan=False) + "\n").encode()
    try:
        with path.open("ab+") as stream:
            if stream.tell():
                stream.seek(-1, os.SEEK_END)
                line = line if stream.read(1) == b"\n" else b"\n" + line
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise HistoryError(f"{path}: cannot write the journal: {error}. What it holds is kept.") from error
