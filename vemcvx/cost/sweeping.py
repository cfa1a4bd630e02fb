"""A sweep over settings: many parallel runs, whose errors are measured against a reference.

The reference u_ref has twice the cells of the finest mesh along every side, and four times the largest number of steps.
Let u be the solution and u_h a run. In the energy norm, |u - u_h|^2 = |u_ref - u_h|^2 + |u - u_ref|^2 nearly holds, by
Galerkin orthogonality. If |u_ref - u_h| >= 4 |u - u_ref|, then |u_ref - u_h| is the error |u - u_h| to 3 %.
"""

from __future__ import annotations

import hashlib
import json
import logging
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import Any

import numpy as np

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.errors import HistoryError, ProblemError, SceneError, SceneWarning, VemcvxError, quietly
from vemcvx.base.owned_files import Owned, path_of
from vemcvx.cost.rows import Row, figures
from vemcvx.cost.workers import CRASHED, DONE, call_safely
from vemcvx.estimate.budget import error_budget
from vemcvx.estimate.measures import energy_distance
from vemcvx.estimate.quantities import quantities, value_of
from vemcvx.history import History
from vemcvx.results.files import finite_or_none, read_archive, write_archive

JOURNAL, ARCHIVE = "journal.jsonl", "reference.npz"
log = logging.getLogger("vemcvx")


@dataclass(frozen=True)
class Point:
    """Settings of one run.

    `family` is None for the mesh of the problem. An adaptive run has a `target`, and its `steps` are None. `of` names
    the quantity whose error counts, as in :func:`vemcvx.adapt`.
    """

    family: str | None
    n: int
    steps: int | None
    solver: str
    accuracy: float
    target: float | None = None
    of: str = "energy"


Recipe = Callable[[Point], Any]
"""A module-level function that returns the arguments of a run, :class:`vemcvx.cli.problem_file.Posed`."""


def common_instants(courses: Sequence[Floats]) -> Floats:
    """Return up to four evenly chosen instants that all sequences of times contain, including the last instant."""
    first, *others = courses
    span = float(first[-1] - first[0])
    for other in others:
        if max(abs(other[0] - first[0]), abs(other[-1] - first[-1])) > SAME * span:
            ends = [f"times({len(x) - 1}) runs from {x[0]:g} to {x[-1]:g}" for x in (first, other)]
            raise ProblemError(f"{' and '.join(ends)}; a sweep compares runs, so all must begin and end together.")
    shared = [t for t in first[1:] if all(np.abs(other - t).min() <= SAME * span for other in others)]
    chosen = np.arange(1, 5) * len(shared) // 4 - 1
    return np.array(shared)[np.unique(chosen[chosen >= 0])]


def run_point(recipe: Recipe, point: Point, instants: Floats) -> tuple[History, Row]:
    """Run a point in this process; return its history, with these instants stored, and its row of the table."""
    with quietly() as caught:
        # A small run of the same kind triggers late imports; if it fails, the run below fails with the same error.
        with suppress(VemcvxError):
            recipe(replace(point, n=min(point.n, 4), steps=2, target=None)).simulate(check=False)
        caught.clear()
        made, start = recipe(point), time.perf_counter()
        if point.target is None:
            steps = np.searchsorted(made.times, instants - 0.5 * np.diff(made.times).min())
            history = made.simulate(store=steps.tolist())
            seconds, estimated = time.perf_counter() - start, _estimate_error(history, point.of)
        else:
            adapted = made.adapt(instants, point.target, of=point.of)
            history, estimated = adapted.history, adapted.passes[-1].total
            seconds = time.perf_counter() - start
    notes = [str(warning.message) for warning in caught if issubclass(warning.category, SceneWarning)]
    if point.target is not None and estimated is not None and estimated > point.target:
        notes.append(f"the target was not met: {estimated:.2%} estimated")
    own = {"estimated_error": finite_or_none(estimated), "seconds": seconds, "message": "; ".join(dict.fromkeys(notes))}
    value = {} if point.of == "energy" else {"value": value_of(history, point.of)}
    return history, asdict(point) | figures(history) | own | value


def _estimate_error(history: History, of: str) -> float | None:
    with suppress(SceneError):  # A scene with viscosity, for example, has no estimate.
        return error_budget(history).largest["total"] if of == "energy" else quantities(history)[of].relative
    return None


def build_reference(recipe: Recipe, point: Point, instants: Floats, archive: Path) -> Row:
    """Run the reference, write it to the archive, and return its row."""
    history, row = run_point(recipe, point, instants)
    write_archive(history, archive)
    return row


def measure_point(recipe: Recipe, point: Point, instants: Floats, archive: Path, exact: float | None) -> Row:
    """Run a point and measure its error: |value - exact| / |exact|, or in the energy norm if `exact` is None.

    Raise OSError if the reference cannot be read or is zero; a later sweep then repeats the point.
    """
    history, row = run_point(recipe, point, instants)
    if exact == 0.0:
        raise OSError(f"the reference value of {point.of} is zero: no relative error exists.")
    if exact is not None:
        return row | {"error": abs(row["value"] - exact) / abs(exact)}
    try:
        fine = read_archive(archive)
    except HistoryError as lost:
        raise OSError(str(lost)) from lost
    common = bool(abs(history.mesh.measures.sum() / fine.mesh.measures.sum() - 1.0) > SAME)
    found = [energy_distance(history, fine, time=float(t), common=common) for t in instants]
    if (largest_norm := max(one.reference for one in found)) == 0.0:
        raise OSError("the reference does not deform at any compared instant: no relative error exists.")
    messages = [row["message"]] if row["message"] else []
    if common:
        messages.append("its mesh does not cover the reference's domain: errors are over the common part of both")
    if max(one.moduli_apart for one in found) > 0:
        messages.append("cells at a border have another material than the reference: errors use the run's material")
    error, end = max(one.absolute for one in found) / largest_norm, found[-1].absolute / largest_norm
    return row | {"error": error, "error_end": end, "message": "; ".join(messages)}


def run_to_row(key: str, point: Point, run: Callable[[], Row]) -> Row:
    """Run a point in a separate process and return its row, even if the run fails."""
    status, found = call_safely(run)
    return {"key": key, "status": status, **(found if status == DONE else asdict(point) | {"message": found})}


def read_journal(path: Path) -> dict[str, Row]:
    """Return key -> row of a journal. Incomplete lines and crashed points are left out, so that they run again."""
    rows = {}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else ():
        with suppress(ValueError, KeyError, TypeError):
            row = json.loads(line)
            if row["status"] != CRASHED:
                rows[row["key"]] = row
    return rows


def append(path: Path, row: Row) -> None:
    """Append a newline and a row to the journal; the newline ends an incomplete line that a killed process left."""
    try:
        with path.open("a", encoding="utf-8") as stream:
            stream.write(f"\n{json.dumps(row)}\n")
    except OSError as error:
        raise HistoryError(f"cannot write the journal of the sweep: {error}") from error


@dataclass(frozen=True)
class Sweep:
    """Rows of the points and of the reference, and the instants of comparison; `kept` counts rows of earlier sweeps."""

    rows: list[Row]
    reference: Row
    instants: Floats
    kept: int


def sweep(
    recipe: Recipe,
    points: Sequence[Point],
    folder: str | Path,
    *,
    mark: str = "",
    workers: int = 2,
    report: Callable[[str, int, int], None] = lambda *_: None,
) -> Sweep:
    """Run all points that the folder's journal does not contain; at least one point must not be adaptive.

    The `mark` identifies all inputs except the points. Raise ProblemError if the reference cannot be computed.
    """
    n, counts = max(point.n for point in points), sorted({point.steps for point in points if point.steps})
    coarsest = replace(points[0], n=min(point.n for point in points), solver="newton", accuracy=1e-8, target=None)
    finer = replace(coarsest, n=2 * n, steps=4 * counts[-1])
    courses = (recipe(replace(coarsest, steps=steps)).times for steps in (*counts, finer.steps))
    with Owned(path_of(folder, "cost").resolve()) as files, ThreadPool(workers) as threads:
        journal, archive = files.take(JOURNAL), files.take(ARCHIVE)
        report("reference", 0, 1)
        instants = common_instants(list(courses))

        def key(point: Point) -> str:
            words = json.dumps([asdict(point), asdict(finer), instants.tolist(), mark])
            return hashlib.sha256(words.encode()).hexdigest()[:16]

        rows = read_journal(journal)
        if key(finer) not in rows or not archive.exists():
            made = run_to_row(key(finer), finer, partial(build_reference, recipe, finer, instants, archive))
            append(journal, made)
            if made["status"] != DONE:
                raise ProblemError(f"the reference of all errors was not computed: {made['message']}")
            rows[made["key"]] = made
        reference = rows[key(finer)]
        run = partial(measure_point, recipe, instants=instants, archive=archive, exact=reference.get("value"))
        waiting = [(key(point), point, partial(run, point)) for point in points if key(point) not in rows]
        for finished, row in enumerate(threads.imap_unordered(lambda one: run_to_row(*one), waiting), 1):
            append(journal, row)
            rows[row["key"]] = row
            report("points", len(points) - len(waiting) + finished, len(points))
            log.info("%d of %d: %s", finished, len(waiting), row)
    return Sweep([rows[key(point)] for point in points], reference, instants, len(points) - len(waiting))
