"""A parameter study: runs of one problem with all combinations of settings."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from vemcvx.base.errors import ProblemError
from vemcvx.base.owned_files import Owned
from vemcvx.base.table import Table
from vemcvx.cost.rows import NAMES, Row, csv
from vemcvx.cost.workers import DONE

USUAL = "dissipated_second_order", "displacement", "von_mises", "slip", "pressure", "reaction"
TABLE, WORDS = "study.csv", "study.json"
SET = "set."  # Prefix of settings in rows, because a parameter may have the name of a result.


def chosen_results(typed: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the chosen results, by default `USUAL`."""
    if unknown := [name for name in typed if name not in NAMES]:
        raise ProblemError(f"--results: there is no result {unknown[0]!r}; there are {', '.join(NAMES)}.")
    return tuple(typed) or USUAL


def folder_names(settings: Sequence[Sequence[str]]) -> list[str]:
    """Return folder names of runs, from settings or as run_1, run_2, ..."""
    names = [re.sub(r"[^\w.+=,-]+", "_", ",".join(each)) for each in settings]
    good = len(set(names)) == len(names) and max(map(len, names)) <= 100
    return names if good else [f"run_{k}" for k in range(1, len(names) + 1)]


def varying(rows: Sequence[Row]) -> list[str]:
    """Return the names of settings with several values."""
    settings = [name for name in rows[0] if name.startswith(SET)]
    return [name.removeprefix(SET) for name in settings if len({row[name] for row in rows}) > 1]


def find_results(rows: Sequence[Row], chosen: Sequence[str]) -> list[str]:
    """Return the names of results in the table of a study."""
    return [name for name in dict.fromkeys([*chosen, "estimated_error"]) if any(name in row for row in rows)]


def table(rows: Sequence[Row], chosen: Sequence[str], units: Mapping[str, str]) -> Table:
    """Return the table of a study."""
    several, found, cells = varying(rows), find_results(rows, chosen), []
    heads = ["\n".join([*name.split("_"), *([f"({units[name]})"] if name in units else [])]) for name in found]
    for row in rows:
        values = ["-" if (value := row.get(name)) is None else f"{value:.5g}" for name in found]
        end = row["status"] if row["status"] != DONE else "target not met" * (row["met"] is False)
        cells.append([*(row[SET + name] for name in several), *values, end])
    return Table([*(f"{name} =" for name in several), *heads, ""], cells)


def remarks(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a line for each failure, unbounded result or warning."""
    runs_of: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        found = [("warning", words) for words in row.get("warnings", ())]
        if row["status"] != DONE:
            found = [(row["status"], row["message"])]
        elif row["unbounded"]:
            found.append(("no limit", f"{row['unbounded']} may grow without limit as the mesh is refined"))
        for one in found:
            runs_of.setdefault(one, []).append(", ".join(f"{name}={row[SET + name]}" for name in varying(rows)))
    for (kind, words), runs in runs_of.items():
        yield f"{kind:11s} {'all runs' if len(runs) == len(rows) else '; '.join(runs)}: {words}"


def reserve_files(folder: Path) -> None:
    """Raise an error if the files of a study cannot be written."""
    with Owned(folder) as own:
        for name in (TABLE, WORDS):
            own.take(name)


def write(rows: Sequence[Row], folder: Path) -> list[str]:
    """Write settings and results as CSV and JSON, and return the file names."""
    plain = [{name: value for name, value in row.items() if name != "warnings"} for row in rows]
    with Owned(folder) as own:
        return [own.write(TABLE, csv(plain)), own.write(WORDS, f"{json.dumps(rows, indent=2)}\n")]
