"""A sweep over a grid of settings: many points at once, each measured against a reference and then written down.

The mesh of the reference is adapted until its estimated error is no more than a quarter of the smallest error that is
asked for, or, where none is, that is estimated of the finest uniform run. By (nearly) Galerkin's orthogonality
|u - u_h|^2 = |u_ref - u_h|^2 + |u - u_ref|^2, and a quarter leaves what is measured true to 3 %; where that does not
hold, to a quarter. Scenes that cannot be adapted (viscosity has no estimate, and below a point load no mesh is fine
enough) get twice the cells along every side and four times the steps of the finest run.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.errors import HistoryError, MeshError, ProblemError, SceneError, SceneWarning, VemcvxError, quietly
from vemcvx.base.owned_files import Owned, path_of
from vemcvx.bound.error_bound import error_bound
from vemcvx.cost.table import EXTREMES, Row, append, read_journal, sealed, unsealed
from vemcvx.cost.workers import DONE, NOT_CERTIFIED, REFUSED, Results, outcome, pool
from vemcvx.estimate.adapt import Adapted, adapt
from vemcvx.estimate.budget import error_budget
from vemcvx.estimate.measures import Field, energy_distance
from vemcvx.estimate.measures.distance import step_at
from vemcvx.estimate.quantities import quantities, value_of
from vemcvx.history import History
from vemcvx.meshes import Mesh
from vemcvx.results.files import finite_or_none, peak_memory_mb, read_archive, write_archive
from vemcvx.results.results import largest_values
from vemcvx.scene import Scene
from vemcvx.simulation import Projected, simulate
from vemcvx.solvers import Solver


@dataclass(frozen=True)
class Point:
    """Settings of one run: those of :class:`vemcvx.cost.Row`.

    `family` is None for the problem's own, and `steps` where an adaptive run, which has a `target`, chooses them.
    Errors and targets are `of` the energy norm or of another quantity that :func:`vemcvx.adapt` aims at. Where it is
    `bounded` the guaranteed bound stands beside the estimate.
    """

    family: str | None
    n: int
    steps: int | None
    solver: str
    accuracy: float
    target: float | None = None
    of: str = "energy"
    bounded: bool = False

    def key(self, mark: str) -> str:
        """A key that identifies the point among all runs; `mark` names all else that the answer depends on."""
        words = json.dumps([asdict(self), mark], sort_keys=True)
        return hashlib.sha256(words.encode()).hexdigest()[:16]

    @property
    def work(self) -> tuple[float, float]:
        """Unknowns, roughly, and steps, hundreds of which take less than assembling: runs are in the order of it."""
        if self.target is not None:
            # An adaptive run has 3 / target^2 unknowns and 1 / target steps on the paper's scene, and some passes.
            return 2.0 * 3.0 / self.target**2, 1.0 / self.target
        return (4.0 if self.family == "voronoi" else 2.0) * self.n**2, float(self.steps or 0)


@dataclass(frozen=True, eq=False)
class Ingredients:
    """The arguments of `simulate` and `adapt` for one point, or for one run."""

    scene: Scene
    mesh: Mesh
    times: Floats
    solver: Solver | None = None
    initial: ArrayLike | str | Projected | None = None

    def simulated(self, **options: Any) -> History:
        """The history on this mesh and at these instants."""
        return simulate(self.scene, self.mesh, self.times, solver=self.solver, initial=self.initial, **options)

    def adapted(self, instants: Floats, target: float, **options: Any) -> Adapted:
        """The history on a mesh adapted from this one, which has these instants and the first."""
        wanted = np.append(self.times[0], instants)
        return adapt(self.scene, self.mesh, wanted, target, solver=self.solver, initial=self.initial, **options)


class Recipe(Protocol):
    """A recipe makes the ingredients of a point; it is sent to other processes by pickle."""

    @property
    def mark(self) -> str:
        """A mark that identifies the problem: two recipes with one mark make the same ingredients."""

    def __call__(self, point: Point) -> Ingredients:
        """The ingredients of a point, of two steps if it has none."""


OTHERS = ("clarabel", "osqp")


@dataclass(frozen=True)
class Grid:
    """The grid of a sweep: all combinations of its fields.

    Without `solvers` and `accuracies` Newton runs everywhere at 1e-8, and others at a few points. `targets` are those
    of adaptive runs, and the levels that advice is given for; they, and all errors, are `of` one quantity. `bounded`
    asks for guaranteed bounds beside estimates.
    """

    families: tuple[str | None, ...]
    ns: tuple[int, ...]
    steps: tuple[int, ...]
    solvers: tuple[str, ...] | None
    accuracies: tuple[float, ...] | None
    targets: tuple[float, ...]
    adaptive: bool = True
    of: str = "energy"
    bounded: bool = False

    @property
    def points(self) -> tuple[Point, ...]:
        """The points, those with most work first, so that at the end no worker waits long for another."""
        main = tuple(product(self.solvers or ("newton",), self.accuracies or (1e-8,)))
        found = [Point(f, n, k, *how) for f, n, k, how in product(self.families, self.ns, self.steps, main)]
        if self.adaptive:
            start, (solver, accuracy) = min(self.ns), (main[0][0], min(accuracy for _, accuracy in main))
            found += [
                Point(family=f, n=start, steps=None, solver=solver, accuracy=accuracy, target=t)
                for f, t in product(self.families, self.targets)
            ]
        if self.solvers is None and self.accuracies is None:
            where = sorted(self.ns)[1:-1:2] or self.ns[:1]
            # Without a choice of solvers Newton runs everywhere, and these on two meshes of the first family.
            chosen = product(where, self.steps[-1:], OTHERS, (1e-3, 1e-6))
            found += [Point(self.families[0], *settings) for settings in chosen]
        found = [replace(point, of=self.of, bounded=self.bounded) for point in found]
        return tuple(sorted(dict.fromkeys(found), key=lambda point: point.work, reverse=True))

    @property
    def coarsest(self) -> Point:
        """The point whose mesh the reference is refined from."""
        return Point(self.families[0], min(self.ns), max(self.steps), "newton", 1e-8, of=self.of)

    @property
    def finest(self) -> Point:
        """The point that the reference has to beat where it cannot be adapted."""
        return Point(self.families[0], max(self.ns), max(self.steps), "newton", 1e-8, of=self.of)


def common_instants(courses: Sequence[Floats]) -> Floats:
    """Up to four instants that all courses of time have, evenly chosen, the last one among them."""
    first, *others = courses
    span = float(first[-1] - first[0])
    for other in others:
        if max(abs(other[0] - first[0]), abs(other[-1] - first[-1])) > SAME * span:
            raise ProblemError(
                f"times({len(first) - 1}) runs from {first[0]:g} to {first[-1]:g}, times({len(other) - 1}) from "
                f"{other[0]:g} to {other[-1]:g}; a sweep compares answers at the end, so both must be the same."
            )
    shared = [t for t in first[1:] if all(np.abs(other - t).min() <= SAME * span for other in others)]
    chosen = np.arange(1, 5) * len(shared) // 4 - 1
    return np.array(shared)[np.unique(chosen[chosen >= 0])]


REFERENCE_PART = 0.25  # The part of the smallest error that the reference's own error may be.
ARCHIVE, ABOUT = "reference.npz", "reference.json"


def run_point(recipe: Recipe, point: Point, instants: Floats) -> tuple[History, dict[str, Any]]:
    """Run a point in this process: its history, and its columns of the table. Of three short runs it is the median one.

    A small run of the same kind comes before, which imports what is imported late. Memory is the high-water mark of the
    resident set when the last run ends.
    """
    with quietly() as caught:
        # An error of the point shows again when it is run.
        with contextlib.suppress(VemcvxError):
            recipe(replace(point, n=min(point.n, 4), steps=2, target=None)).simulated(check=False)
        caught.clear()
        start = time.perf_counter()
        made = recipe(point)
        meshing = time.perf_counter() - start
        runs = [_timed(made, point, instants)]
        runs += [_timed(made, point, instants) for _ in range(2 if sum(runs[0][1].values()) < 0.3 else 0)]
        history, seconds, estimated = sorted(runs, key=lambda run: sum(run[1].values()))[len(runs) // 2]
        peak = peak_memory_mb()
        if point.target is None:
            estimated = _estimated(history, point.of)
    bound = _bound(made, history) if point.bounded else {}
    said = [str(warning.message) for warning in caught if issubclass(warning.category, SceneWarning)]
    if point.target is not None and estimated is not None and estimated > point.target:
        said.append(f"the target was not met: {estimated:.2%} estimated")
    run = history.trajectory
    return history, {
        "steps": history.steps,
        "cells": history.mesh.n_cells,
        "unknowns": run.state.shape[1],
        "estimated": finite_or_none(estimated),
        "certificate": finite_or_none(run.certified_total.max()),
        "value": None if point.of == "energy" else value_of(history, point.of),
        "seconds": sum(seconds.values()),
        **seconds,
        **bound,
        "mesh": meshing,
        "repeats": len(runs),
        **{one.key: finite_or_none(one.value) for one, *_ in largest_values(history) if one.key in EXTREMES},
        "peak_mb": peak,
        "message": "; ".join(dict.fromkeys(said)),
    }


def _estimated(history: History, of: str) -> float | None:
    """The relative error that a run estimates; None where scenes have no estimate, as with viscosity."""
    with contextlib.suppress(SceneError):
        return error_budget(history).largest["total"] if of == "energy" else quantities(history)[of].relative
    return None


def _bound(made: Ingredients, history: History) -> dict[str, Any]:
    """The guaranteed bound of a run, which is made once more with all of its steps stored."""
    again = replace(made, mesh=history.mesh, times=history.trajectory.times).simulated(check=False)
    # Scenes without a bound of whole histories may have those of steps, and some have none.
    for of, steps in (("history", [None]), ("step", history.stored[history.stored > 0].tolist())):
        with contextlib.suppress(SceneError):
            return {"bound": max(float(error_bound(again, n).relative.max()) for n in steps), "bound_of": of}
    return {}


def _timed(made: Ingredients, point: Point, instants: Floats) -> tuple[History, dict[str, float], float | None]:
    if point.target is None:
        steps = np.searchsorted(made.times, instants - 0.5 * np.diff(made.times).min())
        history = made.simulated(store=steps.tolist())
        return history, {**history.seconds, "adapt": 0.0}, None
    start = time.perf_counter()
    adapted = made.adapted(instants, point.target, of=point.of)
    wall, last = time.perf_counter() - start, adapted.history.seconds
    return adapted.history, {**last, "adapt": wall - sum(last.values())}, adapted.passes[-1].total


@dataclass(frozen=True)
class Reference:
    """A reference without its fields: how it was made, and how fine it is."""

    problem: str  # the mark of the recipe
    instants: tuple[float, ...]  # at which errors are measured
    goal: float  # the relative error that was aimed at
    estimated: float | None  # and reached; None where there is no estimate
    n: int  # of the finest uniform run it was made for
    steps: int
    adapted: bool  # whether its mesh is adapted, so that the goal and not `n` and `steps` says how fine it is
    common: bool  # whether meshes of the problem cover different domains, so that only what they share is measured
    cells: int
    unknowns: int
    made: int  # steps
    seconds: float
    of: str = "energy"  # the quantity that errors are of
    value: float | None = None  # of that quantity; None of the energy norm
    digest: str = ""  # of the file with the fields, which tells whether that is whole

    def serves(self, problem: str, instants: Sequence[float], goal: float, finest: Point) -> bool:
        """Return True if the reference is fine enough for this sweep of this problem."""
        same = self.problem == problem and self.instants == tuple(instants) and self.of == finest.of
        if not self.adapted or self.common:
            return same and self.n >= finest.n and self.steps >= (finest.steps or 0) and self.goal <= goal
        return same and self.estimated is not None and min(self.estimated, self.goal) <= goal

    @property
    def mark(self) -> str:
        """The settings that errors measured against the reference depend on, as a word."""
        return str(asdict(replace(self, seconds=0.0, digest="")))


def read_reference(folder: Path) -> Reference | None:
    """The reference that a folder holds, if it is whole."""
    about, archive = folder / ABOUT, folder / ARCHIVE
    told = unsealed(about.read_text(encoding="utf-8", errors="replace")) if about.exists() else None
    if told is None or not archive.exists() or told["digest"] != _digest(archive):
        return None
    return Reference(**{**told, "instants": tuple(told["instants"])})


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "blake2b").hexdigest()[:32]


def estimated_error(recipe: Recipe, finest: Point) -> float:
    """The estimated error of the finest uniform run, in two digits; 1 where scenes have no estimate."""
    estimated = _estimated(recipe(finest).simulated(), finest.of)
    return 1.0 if estimated is None else float(f"{estimated:.2g}")


def build_reference(
    recipe: Recipe, coarsest: Point, finest: Point, instants: Floats, goal: float, folder: Path
) -> Reference:
    """Compute the reference, write it to the folder, and say what it is."""
    start = time.perf_counter()
    made, fine = recipe(coarsest), recipe(replace(finest, n=2 * finest.n, steps=4 * (finest.steps or 1)))
    common = bool(abs(made.mesh.measures.sum() / fine.mesh.measures.sum() - 1.0) > SAME)
    estimated, adapted = None, True
    try:
        # 700,000 unknowns take some 4 GB. Refining more than `adapt` does by default makes fewer passes.
        start_from = replace(made, mesh=fine.mesh if common else made.mesh)
        found = start_from.adapted(instants, goal, of=finest.of, most_unknowns=700_000, theta=0.7)
        history, estimated = found.history, found.passes[-1].total
    except (SceneError, MeshError):
        adapted = False
        history = fine.simulated(store=[int(np.argmin(np.abs(fine.times - t))) for t in instants])
        estimated = _estimated(history, finest.of)
    # A process that dies from here on leaves fields that are not those of the digest, and so no reference.
    write_archive(history, folder / ARCHIVE)
    reference = Reference(
        problem=recipe.mark,
        instants=tuple(instants.tolist()),
        goal=goal,
        estimated=estimated,
        n=finest.n,
        steps=finest.steps or 0,
        adapted=adapted,
        common=common,
        cells=history.mesh.n_cells,
        unknowns=history.trajectory.state.shape[1],
        made=history.steps,
        seconds=time.perf_counter() - start,
        of=finest.of,
        value=None if finest.of == "energy" else value_of(history, finest.of),
        digest=_digest(folder / ARCHIVE),
    )
    (folder / ABOUT).write_text(sealed(reference), encoding="utf-8")
    return reference


def errors(history: History, folder: Path, reference: Reference) -> tuple[float, float, float]:
    """The largest error over the instants and the one at the last, relative to the largest norm of the reference.

    Of another quantity than the energy norm both are the relative error at the end. The third number is the relative
    difference of the moduli of the two meshes: those of the run weigh the error.
    """
    if reference.value is not None:
        if reference.value == 0.0:
            raise HistoryError(f"the reference has no {reference.of} at all: no relative error exists.")
        error = abs(value_of(history, reference.of) - reference.value) / abs(reference.value)
        return error, error, 0.0
    fine = read_archive(folder / ARCHIVE)
    found = []
    for t in reference.instants:
        row, fine_row = history.row(step_at(history, t)), int(np.argmin(np.abs(fine.times - t)))
        here = Field(history.mesh, history.displacement[row], history.moduli, t)
        there = Field(fine.mesh, fine.displacement[fine_row], fine.moduli, float(fine.times[fine_row]))
        found.append(energy_distance(here, there, common=reference.common))
    scale, apart = max(one.reference for one in found), max(one.moduli_apart for one in found)
    if scale == 0.0:
        raise HistoryError("the reference does not deform at any instant looked at: no relative error exists.")
    return max(one.absolute for one in found) / scale, found[-1].absolute / scale, apart


def measured_point(recipe: Recipe, point: Point, folder: Path, reference: Reference) -> dict[str, Any]:
    """Run a point and measure its error: the columns of the table.

    A reference that cannot be read raises OSError, which is no fault of the point.
    """
    history, columns = run_point(recipe, point, np.array(reference.instants))
    try:
        error, error_end, apart = errors(history, folder, reference)
    except HistoryError as lost:
        raise OSError(str(lost)) from lost
    said = [columns["message"]] if columns["message"] else []
    if apart > 0:
        said.append(
            "in places the material of its mesh is not that of the reference's mesh, because cells have one material "
            "each and lie across the border between two: errors are weighed with the moduli of its own mesh"
        )
    return {**columns, "error": error, "error_end": error_end, "message": "; ".join(said)}


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
        (status, found), *_ = run(outcome, [(function, *given)])
        if status != DONE:
            raise ProblemError(f"the reference that errors are to be measured against was not computed: {found}")
        return found

    targets = grid.targets or [computed(estimated_error, recipe, grid.finest)]
    goal, there = REFERENCE_PART * min(targets), None if fresh else read_reference(folder)
    if there is not None and there.serves(recipe.mark, instants.tolist(), goal, grid.finest):
        return there
    given = recipe, grid.coarsest, grid.finest, instants, goal, folder
    return computed(build_reference, *given)


def finished_row(recipe: Recipe, point: Point, key: str, folder: Path, reference: Reference) -> Row:
    """Run a point, and measure its error, in a process of its own."""
    start = time.perf_counter()
    status, found = outcome(measured_point, recipe, point, folder, reference)
    told = {"key": key, "status": REFUSED if status == NOT_CERTIFIED else status, "at": time.time()}
    columns = found if status == DONE else {"message": found}
    return Row(**{**asdict(point), **told, "wall": time.perf_counter() - start, **columns})
