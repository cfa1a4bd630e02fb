"""A parameter study: one problem run with all combinations of values, as a table, in files, and as a picture."""

from __future__ import annotations

import json
import logging
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from logging.handlers import BufferingHandler
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vemcvx.base.canvas import as_png, light_grid, new_figure
from vemcvx.base.errors import ProblemError, quietly
from vemcvx.base.owned_files import Owned
from vemcvx.cost.workers import DONE
from vemcvx.plots.style import MARKERS, SERIES, Units, in_units
from vemcvx.results.files import ENERGIES, finite_or_none, writable_folder
from vemcvx.results.results import Results
from vemcvx.results.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXTREMES = "displacement", "von_mises", "largest_principal_stress", "smallest_principal_stress", "slip", "friction"
COUNTS = "sticking", "slipping", "open"
ESTIMATED = "estimated_error"
SIZES = "cells", "unknowns", "seconds"
NAMES = (*ENERGIES, *EXTREMES, "pressure", "pressure_recovered", *COUNTS, "certified", ESTIMATED, *SIZES)
"""Results of a run that a table or a picture can show."""
USUAL = "dissipated_second_order", "displacement", "von_mises", "slip", "pressure"
NUMBER = re.compile(r"[-+]?\b\d+(?:\.\d+)?(?:e[-+]?\d+)?")
TABLE, WORDS, PICTURE = "study.csv", "study.json", "study.png"


@dataclass(frozen=True)
class Row:
    """One run of a study: its settings as they were typed, by name, and what came of it."""

    settings: dict[str, str]
    folder: str | None = None
    status: str = DONE
    message: str = ""
    warnings: tuple[str, ...] = ()
    results: dict[str, float | None] = field(default_factory=dict)
    labels: dict[str, str] = field(default_factory=dict)
    unbounded: dict[str, str] = field(default_factory=dict)  # results that grow without limit with refinement, and why
    met: bool | None = None  # whether the target of an adaptive run is met


def results_of(history: Results, units: Units | None = None) -> dict[str, Any]:
    """The results and labels of a row: what a history has under `NAMES`, at the end or the largest of all steps."""
    run, touch = history.trajectory, history.contact
    found, energy = dict[str, tuple[str, float]](), in_units("energy", units)
    for name in ENERGIES:
        words = name.replace("_second_order", ", of second order")
        found[name] = f"{words}\n({energy})", float(getattr(run, name)[-1])
    found |= {one.key: (f"{one.name}\n({in_units(one.unit, units)})", one.value) for one in history.extremes}
    if len(touch.nodes):
        counts = zip(COUNTS, (touch.stick_count, touch.slip_count, touch.open_count), strict=True)
        found |= {name: (f"nodes that are {name} at the end", int(count[-1])) for name, count in counts}
    found["certified"] = "certified relative energy error of a step", float(run.certified.max())
    if history.errors:
        found[ESTIMATED] = "estimated relative energy error", history.errors["total"]
    found["cells"] = "cells", history.mesh.n_cells
    found["unknowns"] = "unknowns", run.state.shape[1]
    found["seconds"] = "seconds", sum(history.seconds.values())
    results = {name: value if isinstance(value, int) else finite_or_none(value) for name, (_, value) in found.items()}
    return {
        "results": results,
        "labels": {name: label for name, (label, _) in found.items()},
        "unbounded": {one.key: one.unbounded for one in history.extremes if one.unbounded},
    }


def chosen_results(typed: Sequence[str]) -> tuple[str, ...]:
    """The names of results that were chosen, or the usual ones; ProblemError where there is none of a name."""
    if unknown := [name for name in typed if name not in NAMES]:
        raise ProblemError(f"--results: there is no result {unknown[0]!r}; there are {', '.join(NAMES)}.")
    return tuple(typed) or USUAL


def folder_names(settings: Sequence[Sequence[str]]) -> list[str]:
    """Names of folders that say the settings of runs, or number them where that is too long or not unique."""
    names = [re.sub(r"[^\w.+=,-]+", "_", ",".join(each)) for each in settings]
    good = len(set(names)) == len(names) and max(map(len, names)) <= 100
    return names if good else [f"run_{k}" for k in range(1, len(names) + 1)]


def varied(rows: Sequence[Row]) -> list[str]:
    """The names of settings that have several values, in the order in which they were given."""
    return [name for name in rows[0].settings if len({row.settings[name] for row in rows}) > 1]


def shown(rows: Sequence[Row], chosen: Sequence[str]) -> list[str]:
    """The chosen results that some run has: without contact there is no slip, and where all have failed nothing.

    Errors are shown where adaptive runs have estimated them.
    """
    return [name for name in dict.fromkeys([*chosen, ESTIMATED]) if any(name in row.results for row in rows)]


def table(rows: Sequence[Row], chosen: Sequence[str]) -> Table:
    """The table of a study in words: what varies, chosen results that some run has, and where a run has failed."""
    several, found, cells = varied(rows), shown(rows, chosen), []
    for row in rows:
        values = ["-" if (value := row.results.get(name)) is None else f"{value:.5g}" for name in found]
        end = row.status if row.status != DONE else "target not met" * (row.met is False)
        cells.append([*(row.settings[name] for name in several), *values, end])
    # A parameter may have the name of a result.
    return Table([*(f"{name} =" for name in several), *(name.replace("_", "\n") for name in found), ""], cells)


def said_of(rows: Sequence[Row]) -> Iterator[str]:
    """Lines that say why runs have failed, what has no limit, and each kind of warning once, with the runs it is of."""
    # Warnings that differ by their numbers alone are one, told as of the first run.
    warned: dict[str, dict[str, str]] = {}
    limitless: dict[str, list[str]] = {}
    for row in rows:
        settings = ", ".join(f"{name}={row.settings[name]}" for name in varied(rows))
        if row.status != DONE:
            yield f"{row.status:11s} {settings}: {row.message}"
        if row.unbounded:
            limitless.setdefault(", ".join(row.unbounded), []).append(settings)
        for words in row.warnings:
            warned.setdefault(NUMBER.sub("#", words), {}).setdefault(settings, words)

    def of(runs: Sequence[str]) -> str:
        return "all runs" if len(runs) == len(rows) else "; ".join(runs)

    for names, runs in limitless.items():
        yield f"no limit    {of(runs)}: {names} may grow without limit as the mesh is refined: numbers of the mesh"
    for said in warned.values():
        first, *_ = said
        numbers = f" (numbers of {first})" if len(set(said.values())) > 1 else ""
        yield f"warning     {of(list(said))}: {said[first]}{numbers}"


@contextmanager
def heard() -> Iterator[list[str]]:
    """A list of all that was warned of within, by warnings and in the log, once it has ended."""
    said, log, kept = list[str](), logging.getLogger("vemcvx"), BufferingHandler(sys.maxsize)
    kept.setLevel(logging.WARNING)
    log.addHandler(kept)
    try:
        with quietly() as caught:
            yield said
    finally:
        log.removeHandler(kept)
        said += [*(str(warning.message) for warning in caught), *(record.getMessage() for record in kept.buffer)]


def claim(folder: Path) -> None:
    """Refuse a folder that could not be written to before the work for it is done."""
    with Owned(writable_folder(folder)) as own:
        for name in (TABLE, WORDS, PICTURE):
            own.take(name)


def write(rows: Sequence[Row], folder: Path, figure: Figure | None, *, tables: bool = True) -> list[str]:
    """Write the study as CSV and JSON, all settings and results of all runs, and its picture; return their names."""
    results = list(dict.fromkeys(name for row in rows for name in row.results))
    plain = []
    for row in rows:
        ends = row.met, " ".join(row.unbounded), row.message
        plain.append([*row.settings.values(), row.status, *map(row.results.get, results), *ends])
    heads = [*(f"set.{name}" for name in rows[0].settings), "status", *results, "met", "unbounded", "message"]
    words = f"{json.dumps([asdict(row) for row in rows], indent=2)}\n"
    files: dict[str, str | bytes] = {TABLE: Table(heads, plain).csv(), WORDS: words} if tables else {}
    files |= {} if figure is None else {PICTURE: as_png(figure, 160)}
    with Owned(folder) as own:
        return [own.write(name, content) for name, content in files.items()]


def picture(rows: Sequence[Row], chosen: Sequence[str], title: str = "") -> Figure:
    """Draw chosen results against the first setting that varies, a line for each combination of the others."""
    name, *others = varied(rows)
    keys, labels = shown(rows, chosen), {key: label for row in rows for key, label in row.labels.items()}
    words = list(dict.fromkeys(row.settings[name] for row in rows))
    ticks = [] if all(map(_is_number, words)) else words
    places = {word: float(k) if ticks else float(word) for k, word in enumerate(words)}
    lines: dict[tuple[str, ...], list[Row]] = {}
    for row in sorted(rows, key=lambda row: places[row.settings[name]]):
        lines.setdefault(tuple(f"{other} = {row.settings[other]}" for other in others), []).append(row)
    columns = min(3, len(keys))
    height = -(-len(keys) // columns)
    figure = new_figure(1.0 + 3.6 * columns, 0.8 + 2.9 * height)
    panels = figure.subplots(height, columns, squeeze=False).ravel()
    for ax, key in zip(panels, keys, strict=False):
        for k, (kind, own) in enumerate(lines.items()):
            x, y = [places[row.settings[name]] for row in own], np.array([row.results.get(key) for row in own], float)
            ax.plot(x, y, MARKERS[k % len(MARKERS)] + "-", color=SERIES[k % len(SERIES)], label=", ".join(kind))
        limitless = any(key in row.unbounded for row in rows)
        ax.set(xlabel=name, title=labels[key] + "\nmay grow without limit as the mesh is refined" * limitless)
        ax.title.set_fontsize("small")
        if ticks:
            ax.set_xticks(range(len(ticks)), ticks)
        light_grid(ax)
    for ax in panels[len(keys) :]:
        ax.set_axis_off()
    if others:
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle(title, fontsize="medium")
    return figure


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False
