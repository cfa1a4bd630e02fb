"""`vemcvx compare`: one problem by several solvers, held against each other and their certificates.

Steps with given weights are nonexpansive in the energy norm, so two answers y, z to the same steps obey

    |y_n - z_n|_K <= sum over m <= n of sqrt(2 gap_m) + sqrt(2 floor_m), of y, plus the same of z.

The left side is exact: K is the matrix of the scene. Against the most certain answer, whose right side is the smallest,
this tests every certificate: those that keep the bound are *honest*. A certificate that is as small as was asked for,
but for its rounding floor, is *good*; an honest one need not be. Where the weights follow the answer, or friction or
viscosity stand beside limits, a step depends on the one before in ways that the sum does not bound
(:class:`vemcvx.stepping.trajectory.Trajectory`); the distance is then told only.

Whatever becomes of a solver is a row: it refuses the program, misses its accuracy, breaks down, or is out of time. With
a time limit each solver has a process of its own, which is ended, so that even a crash is only a row.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import NotAccepted, NotCertified, ProblemError, SceneError, VemcvxError, quietly
from vemcvx.base.table import Table
from vemcvx.cli.options import NONE, Accuracy, File, Mesh, N, Options, Settings, Steps, solver_names
from vemcvx.cli.problem_file import Posed, Problem, read_problem
from vemcvx.cli.solver_names import NAMES, named_solver, read_options
from vemcvx.cli.terminal import NOT_CERTIFIED, check_writable, listed, logged_at_most, progress_bar, say, write_text
from vemcvx.cost.rows import csv
from vemcvx.cost.workers import Crashed, TookTooLong, call_in_process
from vemcvx.program import System
from vemcvx.scene import pose_scene
from vemcvx.solvers import TUNED, Solver, ThroughCvxpy, list_installed
from vemcvx.stepping import Trajectory

CERTIFIED, MISSED, REFUSED, FAILED, STOPPED = "certified", "missed", "refused", "failed", "stopped"
"""Outcomes: good; less accurate than asked; unable to take the program; broken down; out of time."""
ENDS = {NotAccepted: REFUSED, NotCertified: MISSED}
SETTINGS = {"both": ("tuned", "default"), "tuned": ("tuned",), "default": ("default",)}


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row of the comparison: a solver with its own, tuned or default settings, and what became of it.

    Errors are relative to the largest energy norm of the states so far. Iterations are those of the median step, none
    where the solver does not count them.
    """

    solver: str
    settings: str
    outcome: str = CERTIFIED
    asked: float
    certified: float | None = None
    good: bool | None = None
    distance: float | None = None
    allowed: float | None = None
    honest: bool | None = None
    iterations: int | None = None
    seconds: float | None = None
    says: str = ""
    options: str = ""

    @property
    def label(self) -> str:
        """Solver and settings, as messages call them."""
        return self.solver if self.settings == "own" else f"{self.solver} ({self.settings})"


Attempt = tuple[Row, Trajectory | None]  # A row before it is held against others, with its answer if there is one.


@dataclass(frozen=True, kw_only=True)
class Judged:
    """All rows, the label of the most certain solver, and a flag: certificates bound distances of this problem."""

    rows: tuple[Row, ...]
    most_certain: str | None
    rigorous: bool

    @property
    def trustworthy(self) -> bool:
        """True if some answer is certified as asked, and no certificate was contradicted."""
        return any(row.good for row in self.rows) and all(row.honest is not False for row in self.rows)

    @property
    def remarks(self) -> Iterator[str]:
        """Lines on what happened to solvers, on how to read the columns, and on contradicted certificates."""
        for row in self.rows:
            if row.says:
                yield f"{row.label}: {row.outcome}: {row.says}"
        for row in self.rows:
            if row.certified is not None and row.options:
                yield f"{row.label}: was passed {row.options}"
        if (best := self.most_certain) is None:
            return
        yield "certified: rounding included; rel.: to the largest energy norm so far"
        yield "good: certified as asked for in all steps, rounding aside"
        yield f"distance: of the states to those by {best}, the most certain, in energy norm"
        if self.rigorous:
            yield "allowed: what both certificates allow for it; honest: whether the distance is within that"
        else:
            why = "friction follows pressure or slip, or stands, or viscosity does, beside one-sided contact"
            yield f"allowed: no bound here: {why}"
        for row in self.rows:
            if row.honest is False:
                yield f"WRONG: {row.label} is farther from {best} than both certificates allow"


def judged(system: System, attempts: Sequence[Attempt]) -> Judged:
    """Hold every attempt against the most certain one."""
    answers = [(row.label, run) for row, run in attempts if run is not None and _is_answer(run)]
    label, best = min(answers, key=lambda answer: allowed(answer[1])[-1], default=(None, None))
    rigorous = bounds_distance(system)
    rows = tuple(_judged_row(system, row, run, best, rigorous) for row, run in attempts)
    return Judged(rows=rows, most_certain=label, rigorous=rigorous)


def _judged_row(system: System, row: Row, run: Trajectory | None, best: Trajectory | None, rigorous: bool) -> Row:
    if run is None:
        return row
    apart = limit = kept = None
    if best is not None and run is not best and _is_answer(run):
        apart, limit, kept = distance(system, best, run)
    missed, says = np.flatnonzero(run.certificate > row.asked), ""
    if len(missed):
        n, later = int(missed[0]), np.count_nonzero(missed)
        # A settled initial state is solved for and certified, too, but it is none of the steps.
        where = ["at the start"] if n == 0 else []
        where += [f"in {later} of {len(run.times) - 1} steps"] if later else []
        says = f"misses its accuracy {' and '.join(where)}, first in step {n} at t = {run.times[n]:.6g}, "
        says += f"where it reached {run.certified[n]:.1e}"
    return replace(
        row,
        outcome=MISSED if says else CERTIFIED,
        certified=float(run.certified.max()),
        good=not says,
        distance=apart,
        allowed=limit,
        honest=kept if rigorous else None,
        iterations=int(np.median(run.iterations[1:])) if run.iterations[1:].any() else None,
        says=says,
    )


def _is_answer(run: Trajectory) -> bool:
    return bool(np.isfinite(run.state).all() and np.isfinite(allowed(run)).all())


def allowed(run: Trajectory) -> Floats:
    """Return (N + 1,) how far the certificates allow the states to be from the exact ones, in energy norm."""
    total: Floats = np.cumsum(np.sqrt(2 * run.gap) + np.sqrt(2 * run.floor))
    return total


def distance(system: System, one: Trajectory, other: Trajectory) -> tuple[float, float, bool]:
    """Return the distance of two answers, what their certificates allow, both relative, and whether that is kept.

    The instant is that at which the distance exceeds the most what is allowed, else that of the largest distance.
    """
    apart = one.state - other.state
    length = np.sqrt(np.maximum(np.einsum("ni,in->n", apart, system.K @ apart.T), 0.0))
    limit, unit = allowed(one) + allowed(other), np.where(one.unit > 0, one.unit, 1.0)
    kept = bool((length <= limit).all())
    n = int(np.argmax(length / unit if kept else length - limit))
    return float(length[n] / unit[n]), float(limit[n] / unit[n]), kept


def bounds_distance(system: System) -> bool:
    """Return True if the certificates of all steps, added up, bound the distance of two answers."""
    if system.limits is None:
        return not system.follows_answer
    # Without norm terms and rates a step knows nothing of the one before, and only its own certificate counts.
    return system.norms is None and system.damping is None


@dataclass(frozen=True, kw_only=True)
class Compare:
    """Solve a problem by several solvers, and hold their answers against each other and their certificates."""

    file: File
    mesh: Mesh = None
    n: N = None
    steps: Steps = 8
    solvers: Annotated[
        str,
        typer.Option(
            metavar="A,B,...",
            autocompletion=solver_names,
            help="Names of solvers, FILE.py:CLASS for your own, or all for every solver that is installed.",
        ),
    ] = "newton,clarabel,osqp,direct"
    accuracy: Accuracy = None
    options: Options = NONE
    tuning: Annotated[str, typer.Option(metavar="both|tuned|default", help="Settings of solvers that cvxpy calls.")] = (
        "both"
    )
    time_limit: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="End each solver, in a process of its own, after so long.")
    ] = None
    json: Annotated[Path | None, typer.Option(metavar="PATH", help="Write all figures there.")] = None
    csv: Annotated[Path | None, typer.Option(metavar="PATH", help="Write the table there.")] = None
    settings: Settings = NONE

    def __call__(self) -> None:
        """Compare, write what is asked for, and print the table; exit code 3 where no answer can be trusted."""
        if self.time_limit is not None and not self.time_limit > 0:
            raise ProblemError(f"--time-limit: found {self.time_limit:g}; wanted seconds, more than zero.")
        for option, path in (("--json", self.json), ("--csv", self.csv)):
            if path is not None:
                check_writable(path, option)
        problem, solvers = read_problem(self.file), entrants(self)
        posed = self.posed(problem)
        with warned_once(), logged_at_most(1), progress_bar("posing") as shown:
            system = pose_scene(posed.scene, posed.mesh, posed.times.tolist()).system
            attempts = list[Attempt]()
            for i, (solver, settings) in enumerate(solvers):
                row = Row(solver=solver.name, settings=settings, asked=solver.accuracy, options=_passed_on(solver))
                doing = f"{row.label}, {i + 1} of {len(solvers)}"
                shown(doing, 0, self.steps)
                if self.time_limit is None:
                    row, run = attempted(problem, self, row, solver, partial(shown, doing))
                else:
                    row, run = _attempted_within(self.time_limit, problem, self, i, row)
                words = row.outcome if run is None else f"certified to {run.certified.max():.1e} in {row.seconds:.2f} s"
                say(f"{i + 1} of {len(solvers)}: {row.label}: {words}", err=True)
                attempts.append((row, run))
            # An error in which every solver ends, of those that take the program, is one of the problem.
            tried = [(row.outcome, row.says) for row, _ in attempts if row.outcome != REFUSED]
            if len(tried) > 1 and len(set(tried)) == 1 and tried[0][0] == FAILED:
                raise SceneError(tried[0][1])
            found = judged(system, attempts)
        title = f"{problem.name}: {problem.title}"
        size = f"{posed.mesh.n_cells} cells, {posed.mesh.n_nodes} nodes, {system.n} unknowns, {self.steps} steps"
        if self.json is not None:
            write_text(self.json, as_json(found, title, size), "--json")
        if self.csv is not None:
            write_text(self.csv, csv([asdict(row) for row in found.rows]), "--csv")
        say(in_words(found, title, size))
        if not found.trustworthy:
            raise typer.Exit(NOT_CERTIFIED)

    def posed(self, problem: Problem) -> Posed:
        """Return the scene, the mesh and the instants."""
        mesh = problem.mesh(self.n or problem.usual_n(16, self.mesh), self.mesh, self.settings)
        return problem.posed(self.settings, mesh, self.steps)


def entrants(asked: Compare) -> list[tuple[Solver, str]]:
    """Return the solvers asked for, with words for their settings; cvxpy's with each setting asked for."""
    if asked.tuning not in SETTINGS:
        raise ProblemError(f"--tuning: found {asked.tuning!r}; there are {', '.join(SETTINGS)}.")
    # This imports cvxpy: the first solver should not pay for that.
    every = dict.fromkeys([*NAMES, *(name.lower() for name in list_installed())])

    def spelt(name: str) -> str:
        return name if ":" in name else name.lower()

    typed = listed("--solvers", asked.solvers, spelt, "names such as newton,clarabel,SCS, or all")
    names = list(dict.fromkeys(one for name in typed for one in (every if name == "all" else [name])))
    options = read_options(asked.options, names)
    found: list[tuple[Solver, str]] = []
    for name in names:
        solver = named_solver(name, asked.accuracy, "--solvers", options.get(name, {}))
        if not isinstance(solver, ThroughCvxpy):
            found.append((solver, "own"))
        else:
            wanted = SETTINGS[asked.tuning] if solver.solver in TUNED else ("default",)
            found += [(replace(solver, tuned=settings == "tuned"), settings) for settings in wanted]
    return found


def _passed_on(solver: Solver) -> str:
    """Return the settings that cvxpy passes on to a solver, in words; none of solvers that it does not call."""
    if not isinstance(solver, ThroughCvxpy):
        return ""
    made = [f"{setting.name} = {setting.words}" for setting in solver.settings if setting.name not in solver.options]
    return ", ".join([*made, *(f"{name} = {value!r} (asked for)" for name, value in solver.options.items())])


def _attempted_within(seconds: float, problem: Problem, asked: Compare, i: int, row: Row) -> Attempt:
    """Let solver `i` solve the problem in a process of its own, which is ended when the time is up."""
    try:
        return call_in_process(attempted_alone, problem.path, asked, i, row, seconds=seconds)
    except TookTooLong:
        return replace(row, outcome=STOPPED, says=f"stopped after {seconds:g} s"), None
    except Crashed as end:
        return replace(row, outcome=FAILED, says=f"its process ended: {end}"), None
    except VemcvxError as error:
        return replace(row, outcome=FAILED, says=_own_words(str(error))), None


def attempted_alone(path: Path, asked: Compare, i: int, row: Row) -> Attempt:
    """Let solver `i` solve the problem in a process that has read nothing yet; the first logs what all would log."""
    with logged_at_most(0 if i else 1):
        return attempted(read_problem(path), asked, row, entrants(asked)[i][0], None)


def attempted(
    problem: Problem, asked: Compare, row: Row, solver: Solver, progress: Callable[[int, int], None] | None
) -> Attempt:
    """Solve the problem by one solver, whatever comes of it."""
    posed = replace(asked.posed(problem), solver=solver)
    try:
        history = posed.simulated(check=False, progress=progress or False)
    except (VemcvxError, MemoryError) as error:
        outcome = next((end for kind, end in ENDS.items() if isinstance(error, kind)), FAILED)
        told = "it ran out of memory" if isinstance(error, MemoryError) else str(error)
        return replace(row, outcome=outcome, says=_own_words(told) if outcome == FAILED else clause(told)), None
    return replace(row, seconds=sum(history.seconds.values())), history.trajectory


@contextmanager
def warned_once() -> Iterator[None]:
    """Say each warning once, however many solvers meet it, and if all of them fail."""
    caught = list[warnings.WarningMessage]()
    try:
        with quietly() as caught:
            yield
    finally:
        for words, kind in dict.fromkeys((str(warning.message), warning.category) for warning in caught):
            warnings.warn(words, kind, stacklevel=2)


def clause(message: str) -> str:
    """Return an error's first clause, without the name of the solver before it."""
    return re.split(r"[;.](?:\s|$)", _own_words(message), maxsplit=1)[0]


def _own_words(message: str) -> str:
    """Return an error without the name of the solver before it."""
    return re.sub(r"^solver \S+: ", "", message).removesuffix(".")


COLUMNS = {
    "asked\nrel.": ("asked", ".0e"),
    "certified\nrel.": ("certified", ".1e"),
    "good\ny/n": ("good", "no"),
    "distance\nrel.": ("distance", ".1e"),
    "allowed\nrel.": ("allowed", ".1e"),
    "honest\ny/n": ("honest", "NO"),
    "iter.\na step": ("iterations", "d"),
    "total\ns": ("seconds", ".3f"),
}
"""Heading -> column of `Row`, and its format, or the word for a no."""


def _cell(value: object, form: str) -> str:
    words = {None: "-", False: form, True: "yes"}
    return words[value] if value is None or isinstance(value, bool) else f"{value:{form}}"


def in_words(found: Judged, title: str, size: str) -> str:
    """Return the table, which takes less than 80 columns, with a title above and remarks below."""
    cells = [[_cell(getattr(row, name), form) for name, form in COLUMNS.values()] for row in found.rows]
    rows = [[row.solver, row.settings, *own] for row, own in zip(found.rows, cells, strict=True)]
    return "\n".join([title, size, "", Table(("solver", "settings", *COLUMNS), rows).text(), "", *found.remarks])


def as_json(found: Judged, title: str, size: str) -> str:
    """Return all rows; numbers that are not finite are words."""
    rows = [
        {key: str(x) if isinstance(x, float) and not np.isfinite(x) else x for key, x in asdict(row).items()}
        for row in found.rows
    ]
    told = {"problem": title, "size": size, "trustworthy": found.trustworthy, "rows": rows}
    return json.dumps(told, indent=1) + "\n"
