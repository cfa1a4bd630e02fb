"""A sweep: many points at once, each written down when it is finished, those written down before left out."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from vemcvx.arrays import Floats
from vemcvx.cost import reference as of_reference
from vemcvx.cost.reference import ABOUT, ARCHIVE, PART, Reference
from vemcvx.cost.settings import Grid, Point, Recipe, common_instants
from vemcvx.cost.table import CRASHED, DONE, REFUSED, Row, append, read_journal
from vemcvx.cost.workers import Crashed, Refused, Results, alone, pool
from vemcvx.errors import ProblemError, VemcvxError
from vemcvx.owned_files import Owned, path_of

JOURNAL = "journal.jsonl"

log = logging.getLogger("vemcvx")

Told = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Sweep:
    """The rows in the order of the points, the reference, and how many rows the journal had before."""

    rows: tuple[Row, ...]
    reference: Reference
    kept: int


def sweep(
    recipe: Recipe,
    grid: Grid,
    folder: str | Path,
    *,
    workers: int = 2,
    scheduler: str | None = None,
    fresh: bool = False,
    told: Told | None = None,
) -> Sweep:
    """Run all points of a grid that the folder's journal does not hold.

    The `recipe` makes the ingredients of points; it can be pickled, and `workers` processes here, or those of the
    dask.distributed `scheduler` at an address, can import its module. The `folder` has the journal and the reference;
    `fresh` begins anew, whatever it holds. `told` (what, finished, all) is called when something is finished.

    ProblemError where the scheduler does not answer, or the reference cannot be computed; HistoryError where the folder
    cannot be written to, another sweep is on there, or it holds files of others by the names of ours.
    """
    told = told or (lambda *_: None)
    with Owned(path_of(folder, "cost").resolve()) as files, pool(workers, scheduler) as run:
        folder, journal = files.path, files.take(JOURNAL)
        for name in (ARCHIVE, ABOUT):
            files.take(name)
        if fresh:
            journal.unlink(missing_ok=True)
        instants = common_instants([recipe(replace(grid.coarsest, steps=k)).times for k in grid.steps])
        reference = _reference(recipe, grid, instants=instants, folder=folder, fresh=fresh, run=run, told=told)
        mark = f"{recipe.mark} {reference.mark}"
        keys = {point.key(mark): point for point in grid.points}
        rows = {key: row for key, row in read_journal(journal).items() if key in keys}
        kept = len(rows)
        waiting = [(recipe, point, key, folder, reference) for key, point in keys.items() if key not in rows]
        for row in run(finished_row, waiting):
            append(journal, row)
            rows[row.key] = row
            told("points", len(rows), len(keys))
            log.info("%d of %d: %s: %s", len(rows), len(keys), row.settings, row.status)
    return Sweep(tuple(rows[key] for key in keys), reference, kept)


def _reference(
    recipe: Recipe, grid: Grid, instants: Floats, folder: Path, fresh: bool, run: Results, told: Told
) -> Reference:
    """The reference that the folder holds, if it serves, else a new one; its goal is a part of the smallest error."""
    told("reference", 0, 1)

    def computed(function: Callable[..., Any], *given: Any) -> Any:
        (found, why), *_ = run(answered, [(function, *given)])
        if found is None:
            raise ProblemError(f"the reference that errors are to be measured against was not computed: {why}")
        return found

    targets = grid.targets or [computed(of_reference.estimated_error, recipe, grid.finest)]
    goal, there = PART * min(targets), None if fresh else of_reference.read_reference(folder)
    if there is not None and there.serves(recipe.mark, instants.tolist(), goal, grid.finest):
        return there
    given = recipe, grid.coarsest, grid.finest, instants, goal, folder
    return computed(of_reference.build_reference, *given)


def answered(function: Callable[..., Any], *given: Any) -> tuple[Any, str]:
    """Call a function in a process of its own; return its result, or None and the reason why there is none."""
    try:
        return alone(function, *given), ""
    except (Refused, Crashed) as error:
        return None, str(error)


def finished_row(recipe: Recipe, point: Point, key: str, folder: Path, reference: Reference) -> Row:
    """Run a point, and measure its error, in a process of its own."""
    start = time.perf_counter()
    try:
        status, found = DONE, alone(of_reference.measured_point, recipe, point, folder, reference)
    except (Crashed, MemoryError, OSError) as crash:
        status, found = CRASHED, {"message": str(crash) or type(crash).__name__}
    except (Refused, VemcvxError) as refusal:
        status, found = REFUSED, {"message": str(refusal)}
    told = {"key": key, "status": status, "wall": time.perf_counter() - start, "at": time.time()}
    return Row(**{**asdict(point), **told, **found})
