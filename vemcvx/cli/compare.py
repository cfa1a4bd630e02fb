"""`vemcvx compare`: solve one problem by several solvers, and compare answers and certificates.

If friction bounds do not depend on the answer, the states y_n and z_n of two solvers at step n obey

    |y_n - z_n|_K <= E_n(y) + E_n(z),    E_n = sum over m <= n of (sqrt(2 gap_m) + sqrt(2 floor_m)).

Here |.|_K is the energy norm, gap_m the duality gap, and floor_m the rounding floor of step m. Two certificates are
*honest* if the inequality holds. A certificate is *good* if the requested accuracy is met.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import NotAccepted, NotCertified, SceneError, VemcvxError
from vemcvx.base.outline import count_steps
from vemcvx.base.table import Table
from vemcvx.cli.options import NONE, Accuracy, File, Mesh, N, Settings
from vemcvx.cli.problem_file import Posed, read_problem
from vemcvx.cli.solver_names import NAMES, make_solver
from vemcvx.cli.terminal import NOT_CERTIFIED, limit_log, parse_list, progress_bar, say, write_text
from vemcvx.program import System
from vemcvx.results.files import finite_or_none
from vemcvx.scene import pose_scene
from vemcvx.solvers import TUNED, Solver, ThroughCvxpy, list_installed
from vemcvx.stepping import Trajectory

CERTIFIED, MISSED, REFUSED, FAILED = "certified", "missed", "refused", "failed"
"""Outcomes: as accurate as requested, less accurate, program not accepted, no answer."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row of the comparison; `settings` is "own", "tuned" or "default"."""

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
    message: str = ""

    @property
    def label(self) -> str:
        """The name of the row in messages."""
        return self.solver if self.settings == "own" else f"{self.solver} ({self.settings})"


Attempt = tuple[Row, Trajectory | None]  # a row that is not yet compared, and the answer


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """The rows; `rigorous` is True if certificates bound the distance of two answers."""

    rows: tuple[Row, ...]
    most_certain: str | None
    rigorous: bool

    @property
    def trustworthy(self) -> bool:
        """True if some answer is certified as requested, and no certificate was contradicted."""
        return any(row.good for row in self.rows) and all(row.honest is not False for row in self.rows)

    @property
    def remarks(self) -> Iterator[str]:
        """Lines on the outcomes of solvers, and on contradicted certificates."""
        for row in self.rows:
            if row.message:
                yield f"{row.label}: {row.outcome}: {row.message}"
        if self.most_certain is not None and not self.rigorous:
            why = "friction depends on pressure or slip, or one-sided contact occurs with friction or viscosity"
            yield f"the column 'allowed' is no bound here, because {why}"
        for row in self.rows:
            if row.honest is False:
                yield f"WRONG: {row.label} is farther from {self.most_certain} than both certificates allow"


def judge(system: System, attempts: Sequence[Attempt]) -> Comparison:
    """Compare all answers with the answer that has the smallest certified error."""
    answers = [(row.label, run) for row, run in attempts if run is not None and _is_answer(run)]
    label, best = min(answers, key=lambda answer: error_bounds(answer[1])[-1], default=(None, None))
    rigorous = bounds_distance(system)
    rows = tuple(_judge_row(system, row, run, best, rigorous) for row, run in attempts)
    return Comparison(rows=rows, most_certain=label, rigorous=rigorous)


def _judge_row(system: System, row: Row, run: Trajectory | None, best: Trajectory | None, rigorous: bool) -> Row:
    if run is None:
        return row
    apart = limit = kept = None
    if best is not None and run is not best and _is_answer(run):
        apart, limit, kept = distance(system, best, run)
    missed, message = np.flatnonzero(run.certificate > row.asked), ""
    if len(missed):
        first = f"t = {run.times[missed[0]]:.6g}, where it reached {run.certified[missed[0]]:.1e}"
        message = f"misses its accuracy at {len(missed)} of {len(run.times)} instants, first at {first}"
    return replace(
        row,
        outcome=MISSED if message else CERTIFIED,
        certified=float(run.certified.max()),
        good=not message,
        distance=apart,
        allowed=limit,
        honest=kept if rigorous else None,
        iterations=int(np.median(run.iterations[1:])) if run.iterations[1:].any() else None,
        message=message,
    )


def _is_answer(run: Trajectory) -> bool:
    return bool(np.isfinite(run.state).all() and np.isfinite(error_bounds(run)).all())


def error_bounds(run: Trajectory) -> Floats:
    """Return the certified bounds on the errors of all states, in energy norm."""
    total: Floats = np.cumsum(np.sqrt(2 * run.gap) + np.sqrt(2 * run.floor))
    return total


def distance(system: System, one: Trajectory, other: Trajectory) -> tuple[float, float, bool]:
    """Return the distance of two answers, the allowed distance, and True if the distance is allowed."""
    apart = one.state - other.state
    length = np.sqrt(np.maximum(np.einsum("ni,in->n", apart, system.K @ apart.T), 0.0))
    limit, unit = error_bounds(one) + error_bounds(other), np.where(one.unit > 0, one.unit, 1.0)
    kept = bool((length <= limit).all())
    n = int(np.argmax(length / unit if kept else length - limit))
    return float(length[n] / unit[n]), float(limit[n] / unit[n]), kept


def bounds_distance(system: System) -> bool:
    """Return True if certificates bound the distance of two answers."""
    if system.limits is None:
        return not system.follows_answer
    return system.norms is None and system.damping is None and not system.limits.rates.any()


@dataclass(frozen=True, kw_only=True)
class Compare:
    """The command `vemcvx compare`."""

    file: File
    mesh: Mesh = None
    n: N = None
    steps: Annotated[int, typer.Option(min=1, help="Steps of backward Euler.")] = 8
    solvers: Annotated[
        str, typer.Option(metavar="A,B,...", help="Names of solvers, FILE.py:CLASS, or all: every installed solver.")
    ] = "newton,clarabel,osqp,direct"
    accuracy: Accuracy = None
    json: Annotated[Path | None, typer.Option(metavar="PATH", help="Write all numbers to this file.")] = None
    settings: Settings = NONE

    def __call__(self) -> None:
        """Solve a problem by several solvers, and compare their answers and certificates."""
        problem, solvers = read_problem(self.file), entrants(self.solvers, self.accuracy)
        with limit_log(1), progress_bar("posing") as show:
            mesh = problem.mesh(self.n or problem.default_n(16, self.mesh), self.mesh, self.settings)
            posed = problem.pose(self.settings, mesh, self.steps)
            system = pose_scene(posed.scene, posed.mesh, posed.times.tolist()).system
            attempts = list[Attempt]()
            for i, (solver, settings) in enumerate(solvers, start=1):
                row = Row(solver=solver.name, settings=settings, asked=solver.accuracy)
                doing = f"{row.label}, {i} of {len(solvers)}"
                show(doing, 0, self.steps)
                row, run = attempt(replace(posed, solver=solver), row, partial(show, doing))
                words = row.outcome if run is None else f"certified to {run.certified.max():.1e} in {row.seconds:.2f} s"
                say(f"{i} of {len(solvers)}: {row.label}: {words}", err=True)
                attempts.append((row, run))
            # If all solvers fail with the same error, the problem is at fault.
            tried = [(row.outcome, row.message) for row, _ in attempts if row.outcome != REFUSED]
            if len(tried) > 1 and len(set(tried)) == 1 and tried[0][0] == FAILED:
                raise SceneError(tried[0][1])
            found = judge(system, attempts)
        title = f"{problem.name}: {problem.title}"
        size = f"{posed.mesh.n_cells} cells, {posed.mesh.n_nodes} nodes, {system.n} unknowns, {count_steps(self.steps)}"
        if self.json is not None:
            rows = [
                {key: finite_or_none(x) if isinstance(x, float) else x for key, x in asdict(row).items()}
                for row in found.rows
            ]
            contents = {"problem": title, "size": size, "trustworthy": found.trustworthy, "rows": rows}
            write_text(self.json, f"{json.dumps(contents, indent=1)}\n", "--json")
        say(in_words(found, title, size))
        if not found.trustworthy:
            raise typer.Exit(NOT_CERTIFIED)


def entrants(typed: str, accuracy: float | None) -> list[tuple[Solver, str]]:
    """Return pairs (solver, name of the settings)."""
    # `list_installed` imports cvxpy before the first timed run.
    every = dict.fromkeys([*NAMES, *(name.lower() for name in list_installed())])
    chosen = parse_list("--solvers", typed, str, "names such as newton,clarabel,SCS, or all")
    spelt = [name if ":" in name else name.lower() for name in chosen]
    names = list(dict.fromkeys(one for name in spelt for one in (every if name == "all" else [name])))
    found: list[tuple[Solver, str]] = []
    for name in names:
        solver = make_solver(name, accuracy, "--solvers")
        if not isinstance(solver, ThroughCvxpy):
            found.append((solver, "own"))
        else:
            kinds = ("tuned", "default") if solver.solver in TUNED else ("default",)
            found += [(replace(solver, tuned=kind == "tuned"), kind) for kind in kinds]
    return found


def attempt(posed: Posed, row: Row, progress: Callable[[int, int], None]) -> Attempt:
    """Solve the problem, and return exceptions as outcomes."""
    try:
        history = posed.simulate(check=False, progress=progress)
    except (NotAccepted, NotCertified) as error:
        first_clause = re.split(r"[;.](?:\s|$)", _own_words(str(error)), maxsplit=1)[0]
        return replace(row, outcome=REFUSED if isinstance(error, NotAccepted) else MISSED, message=first_clause), None
    except VemcvxError as error:
        return replace(row, outcome=FAILED, message=_own_words(str(error))), None
    except MemoryError:
        return replace(row, outcome=FAILED, message="it ran out of memory"), None
    return replace(row, seconds=sum(history.seconds.values())), history.trajectory


def _own_words(message: str) -> str:
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
"""Heading -> field of `Row`, and number format (or the word for False)."""


def _cell(value: object, form: str) -> str:
    words = {None: "-", False: form, True: "yes"}
    return words[value] if value is None or isinstance(value, bool) else f"{value:{form}}"


def in_words(found: Comparison, title: str, size: str) -> str:
    """Return the table with a title above and remarks below."""
    cells = [[_cell(getattr(row, name), form) for name, form in COLUMNS.values()] for row in found.rows]
    rows = [[row.solver, row.settings, *own] for row, own in zip(found.rows, cells, strict=True)]
    return "\n".join([title, size, "", Table(("solver", "settings", *COLUMNS), rows).text(), "", *found.remarks])
