"""Parallel runs with many settings, and errors measured against a reference run.

Let n be the largest number of cells along a side, and k the largest number of steps. The reference has 2 n cells along
a side and 4 k steps. If Galerkin orthogonality holds, (measured error)^2 = error^2 - (error of the reference)^2. If an
error is at least four times the error of the reference, the measured error is at most 4 % too small.
"""

from __future__ import annotations

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
from vemcvx.base.errors import ProblemError, SceneError, SceneWarning, VemcvxError, quietly
from vemcvx.cost.rows import Row, figures
from vemcvx.cost.workers import DONE, call_safely
from vemcvx.estimate.budget import error_budget
from vemcvx.estimate.measures import energy_distance
from vemcvx.history import History
from vemcvx.results.files import finite_or_none, read_archive, write_archive


@dataclass(frozen=True)
class Point:
    """Settings of one run."""

    family: str | None  # None for the mesh of the problem
    n: int
    steps: int | None  # None for an adaptive run
    solver: str
    accuracy: float
    target: float | None = None


Recipe = Callable[[Point], Any]  # picklable function that returns a cli.problem_file.Posed


def common_instants(courses: Sequence[Floats]) -> Floats:
    """Return at most four instants that all runs share, including the last instant."""
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
    """Return the history and the row of a run."""
    with quietly() as caught:
        # A small run triggers late imports before the timer starts.
        with suppress(VemcvxError):
            recipe(replace(point, n=min(point.n, 4), steps=2, target=None)).simulate(check=False)
        caught.clear()
        made, start = recipe(point), time.perf_counter()
        if point.target is None:
            steps = np.searchsorted(made.times, instants - 0.5 * np.diff(made.times).min())
            history = made.simulate(store=steps.tolist())
            seconds, estimated = time.perf_counter() - start, _estimate_error(history)
        else:
            adapted = made.adapt(instants, point.target)
            history, estimated = adapted.history, adapted.passes[-1].total
            seconds = time.perf_counter() - start
    notes = [str(warning.message) for warning in caught if issubclass(warning.category, SceneWarning)]
    if point.target is not None and estimated is not None and estimated > point.target:
        notes.append(f"the target was not met: {estimated:.2%} estimated")
    own = {"estimated_error": finite_or_none(estimated), "seconds": seconds, "message": "; ".join(dict.fromkeys(notes))}
    return history, asdict(point) | figures(history) | own


def _estimate_error(history: History) -> float | None:
    with suppress(SceneError):  # A scene with viscosity, for example, has no estimate.
        return error_budget(history).largest["total"]
    return None


def build_reference(recipe: Recipe, point: Point, instants: Floats, archive: Path) -> Row:
    """Write the reference to the archive, and return the row of the reference."""
    history, row = run_point(recipe, point, instants)
    write_archive(history, archive)
    return row


def measure_point(recipe: Recipe, point: Point, instants: Floats, archive: Path) -> Row:
    """Return the row of a run, including the error in the energy norm."""
    history, row = run_point(recipe, point, instants)
    fine = read_archive(archive)
    common = bool(abs(history.mesh.measures.sum() / fine.mesh.measures.sum() - 1.0) > SAME)
    found = [energy_distance(history, fine, time=float(t), common=common) for t in instants]
    if (largest_norm := max(one.reference for one in found)) == 0.0:
        raise ProblemError("the reference does not deform at any compared instant: no relative error exists.")
    messages = [row["message"]] if row["message"] else []
    if common:
        messages.append("its mesh does not cover the reference's domain: errors are over the common part of both")
    error, end = max(one.absolute for one in found) / largest_norm, found[-1].absolute / largest_norm
    return row | {"error": error, "error_end": end, "message": "; ".join(messages)}


def run_to_row(point: Point, run: Callable[[], Row]) -> Row:
    """Return the row of a run in a separate process, even if the run fails."""
    status, found = call_safely(run)
    return {"status": status, **(found if status == DONE else asdict(point) | {"message": found})}


@dataclass(frozen=True)
class Sweep:
    """Rows of the runs, the row of the reference, and the compared instants."""

    rows: list[Row]
    reference: Row
    instants: Floats


def sweep(
    recipe: Recipe,
    points: Sequence[Point],
    archive: Path,
    *,
    workers: int = 2,
    report: Callable[[str, int, int], None] = lambda *_: None,
) -> Sweep:
    """Run the reference and all points. At least one point must have a fixed number of steps."""
    n, counts = max(point.n for point in points), sorted({point.steps for point in points if point.steps})
    coarsest = replace(points[0], n=min(point.n for point in points), solver="newton", accuracy=1e-8, target=None)
    finer = replace(coarsest, n=2 * n, steps=4 * counts[-1])
    instants = common_instants([recipe(replace(coarsest, steps=k)).times for k in (*counts, finer.steps)])
    report("reference", 0, 1)
    reference = run_to_row(finer, partial(build_reference, recipe, finer, instants, archive))
    if reference["status"] != DONE:
        raise ProblemError(f"the reference of all errors was not computed: {reference['message']}")
    rows, work = list[Row](), [(point, partial(measure_point, recipe, point, instants, archive)) for point in points]
    with ThreadPool(workers) as threads:
        for row in threads.imap(lambda one: run_to_row(*one), work):
            rows.append(row)
            report("points", len(rows), len(points))
    return Sweep(rows, reference, instants)
