"""vemcvx compare: one problem by several solvers, held against each other and their certificates."""

from __future__ import annotations

import html
import json
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, astuple, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import TimeElapsedColumn
from rich.table import Table

from vemcvx.arrays import Floats, Ints
from vemcvx.cli.problem_file import Problem, read_problem
from vemcvx.cli.report import page
from vemcvx.cli.solver_names import NAMES, named_solver, read_options
from vemcvx.cli.terminal import Shown, progress_bar
from vemcvx.cost.workers import Crashed, Refused, TookTooLong, alone_within
from vemcvx.errors import NotAccepted, NotCertified, NotContracting, ProblemError, SceneError, VemcvxError
from vemcvx.outline import csv_text
from vemcvx.outline import html as html_table
from vemcvx.program.system import System
from vemcvx.scene.pose import pose_scene
from vemcvx.simulation import simulate
from vemcvx.solvers import Solver, ThroughCvxpy
from vemcvx.solvers.conic import TUNED, installed
from vemcvx.stepping.backward_euler import checked_times
from vemcvx.stepping.trajectory import Trajectory
from vemcvx.version import __version__

# Answers of several solvers to one problem, held against each other and their certificates.
#
# Steps with given weights are nonexpansive in the energy norm, so two answers y, z to the same steps obey
#
#     |y_n - z_n|_K <= sum over m <= n of sqrt(2 gap_m) + sqrt(2 floor_m), of y, plus the same of z.
#
# The left side is exact: K is the matrix of the scene. Against the most certain answer, whose right side is the
# smallest, that is a test of every certificate: those that keep it are *honest*. A certificate that is as small as
# was asked for is *good*; an honest one need not be. Where the weights follow the answer, or friction or rates meet
# limits, a step depends on the one before in ways that the sum does not bound
# (:class:`vemcvx.stepping.trajectory.Trajectory`); the distance is then told only.


CERTIFIED, MISSED, REFUSED, FAILED, STOPPED = "certified", "missed", "refused", "failed", "stopped"
"""What became of a solver: good; not as good as asked; unable to take the program; broken down; out of time."""


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """The attempt of one solver, with some settings, at the problem: a trajectory, or the reason why there is none."""

    solver: str
    settings: str
    """own, tuned, or default"""
    accuracy: float
    trajectory: Trajectory | None = None
    seconds: dict[str, float] | None = None
    """assemble, prepare, solve"""
    outcome: str = CERTIFIED
    says: str = ""

    @property
    def label(self) -> str:
        """Solver and settings, as messages call them."""
        return self.solver if self.settings == "own" else f"{self.solver} ({self.settings})"

    @property
    def in_words(self) -> str:
        """The outcome in words, before it is held against others."""
        if self.trajectory is None or self.seconds is None:
            return f"{self.label}: {self.outcome}"
        certified, seconds = self.trajectory.certificate.max(), sum(self.seconds.values())
        return f"{self.label}: certified to {certified:.1e} in {seconds:.2f} s"


@dataclass(frozen=True)
class Apart:
    """Distance of two answers and what their certificates allow, relative, where it matters most."""

    distance: float
    allowed: float
    kept: bool


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row of the comparison; errors are relative to the largest energy norm of the states so far."""

    solver: str
    settings: str
    outcome: str
    asked: float
    certified: float | None = None
    floor: float | None = None
    distance: float | None = None
    allowed: float | None = None
    honest: bool | None = None
    good: bool | None = None
    iterations: int | None = None
    """at the median step"""
    safeguards: int | None = None
    """in all steps"""
    assemble_seconds: float | None = None
    prepare_seconds: float | None = None
    solve_seconds: float | None = None
    says: str = ""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """All rows, in the order asked for, and the solver that the others are held against."""

    rows: tuple[Row, ...]
    most_certain: str | None
    rigorous: bool
    """whether certificates bound distances here"""

    @property
    def liars(self) -> tuple[str, ...]:
        """Whose answers are farther from the most certain one than both certificates allow."""
        return tuple(f"{row.solver} ({row.settings})" for row in self.rows if row.honest is False)

    @property
    def trustworthy(self) -> bool:
        """True if some answer is certified as asked, and no certificate was contradicted."""
        return any(row.good for row in self.rows) and not self.liars


def judged(system: System, attempts: Sequence[Attempt]) -> Judged:
    """A row for every attempt, each held against the most certain one."""
    answered = [a.trajectory for a in attempts if a.trajectory is not None and _bounded(a.trajectory)]
    best = min(answered, key=lambda trajectory: allowed(trajectory)[-1], default=None)
    rigorous = bounds_distance(system)
    rows = tuple(_row(system, attempt, best, rigorous) for attempt in attempts)
    certain = next((a.label for a in attempts if best is not None and a.trajectory is best), None)
    return Judged(rows=rows, most_certain=certain, rigorous=rigorous)


def _bounded(trajectory: Trajectory) -> bool:
    """Return True if a trajectory is an answer: its states are numbers and its certificates are finite."""
    return bool(np.isfinite(trajectory.state).all() and np.isfinite(allowed(trajectory)).all())


def allowed(trajectory: Trajectory) -> Floats:
    """(N + 1,) how far the certificates allow the states to be from the exact ones, in energy norm."""
    total: Floats = np.cumsum(np.sqrt(2 * trajectory.gap) + np.sqrt(2 * trajectory.floor))
    return total


def distance(system: System, one: Trajectory, other: Trajectory) -> Apart:
    """Measure two answers' distance where the certificates allow less, else where it is largest."""
    apart = one.state - other.state
    length = np.sqrt(np.maximum(np.einsum("ni,in->n", apart, system.K @ apart.T), 0.0))
    limit, unit = allowed(one) + allowed(other), np.where(one.scale > 0, one.scale, 1.0)
    excess = length - limit
    n = int(np.argmax(excess)) if (excess > 0).any() else int(np.argmax(length / unit))
    return Apart(float(length[n] / unit[n]), float(limit[n] / unit[n]), bool((excess <= 0).all()))


def bounds_distance(system: System) -> bool:
    """Return True if the certificates of all steps, added up, bound the distance of two answers."""
    if system.limits is None:
        return not system.follows_answer
    # Without norm terms and rates a step knows nothing of the one before, and only its own certificate counts.
    return system.norms is None and system.damping is None


def _row(system: System, attempt: Attempt, best: Trajectory | None, rigorous: bool) -> Row:
    told = Row(
        solver=attempt.solver,
        settings=attempt.settings,
        outcome=attempt.outcome,
        asked=attempt.accuracy,
        says=attempt.says,
    )
    run, seconds = attempt.trajectory, attempt.seconds or {}
    if run is None:
        return told
    apart = None if best is None or run is best or not _bounded(run) else distance(system, best, run)
    missed = np.flatnonzero(run.certificate > attempt.accuracy)
    return replace(
        told,
        outcome=MISSED if len(missed) else CERTIFIED,
        certified=float(run.certificate.max()),
        floor=float(run.certificate_floor.max()),
        distance=None if apart is None else apart.distance,
        allowed=None if apart is None else apart.allowed,
        honest=apart.kept if apart is not None and rigorous else None,
        good=len(missed) == 0,
        iterations=int(np.median(run.iterations[1:])) if len(run.times) > 1 else 0,
        safeguards=int(run.safeguards.sum()),
        assemble_seconds=seconds.get("assemble"),
        prepare_seconds=seconds.get("prepare"),
        solve_seconds=seconds.get("solve"),
        says=_of_misses(run, missed),
    )


def _of_misses(run: Trajectory, missed: Ints) -> str:
    if len(missed) == 0:
        return ""
    n, later = missed[0], np.count_nonzero(missed)
    # A settled state is solved for, too, and is none of the steps.
    where = (["at the start"] if n == 0 else []) + ([f"in {later} of {len(run.times) - 1} steps"] if later else [])
    return (
        f"misses its accuracy {' and '.join(where)}, "
        f"first in step {n} at t = {run.times[n]:.6g}, where it reached {run.certificate[n]:.1e}"
    )


# Tables of a comparison on a terminal: as many columns as fit; the rest is in the files that can be asked for.


@dataclass(frozen=True)
class Column:
    """A column: its head, the unit below it, and what it says of a row."""

    head: str
    unit: str
    cell: Callable[[Row], str]
    wide: bool = False
    """whether it is left out where space is short"""


def _error(value: float | None) -> str:
    return "-" if value is None else f"{value:.1e}"


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _word(value: bool | None, no: str = "no") -> str:
    return "-" if value is None else "yes" if value else no


COLUMNS = (
    Column("asked", "rel.", lambda row: f"{row.asked:.0e}"),
    Column("certified", "rel.", lambda row: _error(row.certified)),
    Column("good", "y/n", lambda row: _word(row.good)),
    Column("floor", "rel.", lambda row: _error(row.floor), wide=True),
    Column("distance", "rel.", lambda row: _error(row.distance)),
    Column("allowed", "rel.", lambda row: _error(row.allowed)),
    Column("honest", "y/n", lambda row: _word(row.honest, "NO")),
    Column("iter.", "a step", lambda row: "-" if row.iterations is None else str(row.iterations)),
    Column("safeg.", "in all", lambda row: "-" if row.safeguards is None else str(row.safeguards), wide=True),
    Column("assemble", "s", lambda row: _seconds(row.assemble_seconds), wide=True),
    Column("prepare", "s", lambda row: _seconds(row.prepare_seconds), wide=True),
    Column("solve", "s", lambda row: _seconds(row.solve_seconds)),
)


def in_words(found: Compared) -> str:
    """The tables as text that fits the terminal, without colours and frames."""
    console = Console(highlight=False, markup=False, color_system=None)
    with console.capture() as captured:
        console.print(f"{found.title}\n{found.size}\n")
        answered = [row for row in found.judged.rows if row.certified is not None]
        if answered:
            # All columns take 112 characters.
            console.print(_answers(answered, console.width >= 112))
            console.print()
        for table in (_words(found), _settings(found)):
            if table.row_count:
                console.print(table)
                console.print()
        for line in remarks(found):
            console.print(line)
    return "\n".join(line.rstrip() for line in captured.get().rstrip().splitlines())


def _answers(rows: list[Row], wide: bool) -> Table:
    table = _table("solver", "settings")
    shown = [column for column in COLUMNS if wide or not column.wide]
    for column in shown:
        table.add_column(f"{column.head}\n{column.unit}", justify="right", no_wrap=True)
    for row in rows:
        table.add_row(row.solver, row.settings, *(column.cell(row) for column in shown))
    return table


def _words(found: Compared) -> Table:
    """A table of the attempts without an answer, and of those that miss their accuracy, with the reasons."""
    table = _table("solver", "settings", "outcome")
    table.add_column("what happened", overflow="fold")
    for row in found.judged.rows:
        if row.says:
            table.add_row(row.solver, row.settings, row.outcome, row.says)
    return table


def _settings(found: Compared) -> Table:
    table = _table("solver", "settings")
    table.add_column("as passed on; gap is what a step is asked for", overflow="fold")
    for solver, settings, words in settings_used(found):
        table.add_row(solver, settings, words)
    return table


def _table(*names: str) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False)
    for name in names:
        table.add_column(name, no_wrap=True)
    return table


def settings_used(found: Compared) -> Iterator[tuple[str, str, str]]:
    """(solver, settings, words) of the solvers that cvxpy called, but for those that run as their libraries come."""
    answered = {(row.solver, row.settings) for row in found.judged.rows}
    for entrant in found.entrants:
        solver = entrant.solver
        if isinstance(solver, ThroughCvxpy) and (solver.name, entrant.settings) in answered:
            given = [f"{name} = {value!r} (asked for)" for name, value in solver.options.items()]
            ours = TUNED.get(solver.solver, ()) if solver.tuned else ()
            made = [f"{setting.name} = {setting.words}" for setting in ours if setting.name not in solver.options]
            if made or given:
                yield solver.name, entrant.settings, ", ".join([*made, *given])


def remarks(found: Compared) -> list[str]:
    """The lines below the tables: how to read the columns, and which certificates were contradicted."""
    judged = found.judged
    if judged.most_certain is None:
        return []
    default = any(row.settings == "default" for row in judged.rows)
    lines = ["default: as the solver's library comes, through cvxpy"] if default else []
    lines.append("good: certified as asked, in all steps; rel.: to the largest energy norm so far")
    if sum(row.certified is not None for row in judged.rows) > 1:
        lines.append(f"distance: of the states to those by {judged.most_certain}, the most certain, in energy norm")
        lines.append("allowed: what both certificates allow for it; honest: whether the distance is within that")
    if not judged.rigorous:
        lines.append("allowed: no bound here, where weights follow the answer, or friction or rates meet limits")
    best = judged.most_certain
    return lines + [f"WRONG: {name} is farther from {best} than both certificates allow" for name in judged.liars]


# Files of a comparison: JSON with everything, CSV with the table, an HTML page that needs nothing else.


COLUMN_NAMES = tuple(field.name for field in fields(Row))


def as_json(found: Compared) -> str:
    """All rows, the settings used with their reasons, and how to read them; what is not finite is a string."""
    rows = [{key: _finite(value) for key, value in asdict(row).items()} for row in found.judged.rows]
    used = [
        {"solver": solver, "settings": settings, "passed_on": words, "reasons": _reasons(solver, settings)}
        for solver, settings, words in settings_used(found)
    ]
    told = {
        "format": "vemcvx comparison",
        "version": __version__,
        "problem": found.title,
        "size": found.size,
        "units": "errors: relative to the largest energy norm of the states so far; times: seconds",
        "most_certain": found.judged.most_certain,
        "certificates_bound_distances": found.judged.rigorous,
        "trustworthy": found.judged.trustworthy,
        "rows": rows,
        "settings": used,
    }
    return json.dumps(told, indent=1) + "\n"


def as_csv(found: Compared) -> str:
    """One line a row, by the same names."""
    return csv_text(COLUMN_NAMES, map(astuple, found.judged.rows))


def as_html(found: Compared) -> str:
    """A page with the tables of the terminal, all columns, and the reasons of settings."""
    heads = ["solver", "settings", *(f"{column.head}\n{column.unit}" for column in COLUMNS), "outcome"]
    body = [
        [row.solver, row.settings, *(column.cell(row) for column in COLUMNS), f"{row.outcome}: {row.says}".rstrip(": ")]
        for row in found.judged.rows
    ]
    why = [[solver, *reason] for solver, settings, _ in settings_used(found) for reason in _reasons(solver, settings)]
    return page(
        found.title,
        f"<p>{html.escape(found.size)}</p>{html_table(heads, body)}"
        + "".join(f"<p>{html.escape(line)}</p>" for line in remarks(found))
        + "<h2>Settings tuned for solvers</h2>"
        + html_table(["solver", "setting", "value", "why"], why),
    )


WRITERS: dict[str, Callable[[Compared], str]] = {"json": as_json, "csv": as_csv, "html": as_html}


def check_writable(path: Path, option: str) -> None:
    """Raise ProblemError for a file that could not be written: early, before the work is done."""
    if path.is_dir() or not path.parent.is_dir():
        raise ProblemError(f"{option}: {path} cannot be written: its folder must exist, and it must be none itself.")


def _reasons(solver: str, settings: str) -> list[tuple[str, str, str]]:
    """(setting, value, reason) of those tuned for a solver."""
    found = TUNED.get(solver.upper(), ()) if settings == "tuned" else ()
    return [(setting.name, setting.words, setting.why) for setting in found]


def _finite(value: Any) -> Any:
    return str(value) if isinstance(value, float) and not np.isfinite(value) else value


# `vemcvx compare`: one problem by several solvers, each with settings tuned for it and as its library comes.
#
# Whatever becomes of a solver is a row: it refuses the program, misses, breaks down, or is out of time. With a time
# limit each is given a process of its own, which is ended; then even one that takes its process down is but a row.


SETTINGS = {"both": ("tuned", "default"), "tuned": ("tuned",), "default": ("default",)}


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """The options of the command."""

    family: str | None
    n: int
    steps: int
    solvers: str
    accuracy: float | None
    settings: tuple[str, ...]
    options: tuple[str, ...] = ()
    tuning: str = "both"
    time_limit: float | None = None


@dataclass(frozen=True)
class Entrant:
    """A solver that is asked, and whose settings it has: its own, tuned ones, or those of its library."""

    solver: Solver
    settings: str

    @property
    def attempt(self) -> Attempt:
        """Its attempt, before anything came of it."""
        return Attempt(solver=self.solver.name, settings=self.settings, accuracy=self.solver.accuracy)


@dataclass(frozen=True)
class Compared:
    """A comparison: the problem, the solvers with their settings, and the judged rows."""

    title: str
    size: str
    entrants: tuple[Entrant, ...]
    judged: Judged


def compare_solvers(problem: Problem, asked: Comparison, tell: Callable[[str], object] | None = None) -> Compared:
    """Simulate the problem by all solvers asked for; `tell` is called with a sentence on each as soon as it is done.

    Raises
    ------
    VemcvxError
        The problem itself cannot be posed, or names or options of solvers mean nothing.
    """
    if asked.time_limit is not None and not asked.time_limit > 0:
        raise ProblemError(f"--time-limit: found {asked.time_limit:g}; wanted seconds, more than zero.")
    chosen = entrants(asked)
    scene, mesh = problem.scene(asked.settings), problem.mesh(asked.n, asked.family)
    with warned_once(), progress_bar("posing", TimeElapsedColumn()) as shown:
        system = pose_scene(scene, mesh, checked_times(problem.times(asked.steps)).tolist()).system
        attempts = []
        for i in range(len(chosen)):
            attempts.append(_attempted(problem, asked, chosen, i, shown))
            if tell is not None:
                tell(f"{i + 1} of {len(chosen)}: {attempts[-1].in_words}")
        _raise_what_all_say(attempts)
        found = judged(system, _once(attempts))
    size = f"{mesh.n_cells} cells, {mesh.n_nodes} nodes, {system.n} unknowns, {asked.steps} steps"
    return Compared(f"{problem.name}: {problem.title}", size, chosen, found)


def entrants(asked: Comparison) -> tuple[Entrant, ...]:
    """The solvers asked for, by name; those that cvxpy calls with each of the settings asked for."""
    if asked.tuning not in SETTINGS:
        raise ProblemError(f"--tuning: found {asked.tuning!r}; there are {', '.join(SETTINGS)}.")
    # This imports cvxpy: the first solver should not pay for that.
    every = [*NAMES, *(name.lower() for name in installed() if name.lower() not in NAMES)]
    typed = [name.strip() for name in asked.solvers.split(",") if name.strip()]
    typed = [name if ":" in name else name.lower() for name in typed]
    names = list(dict.fromkeys(one for name in typed for one in (every if name == "all" else [name])))
    if not names:
        raise ProblemError(f"--solvers: found {asked.solvers!r}; wanted names such as newton,clarabel,SCS, or all.")
    options = read_options(asked.options, names)
    solvers = [named_solver(name, asked.accuracy, "--solvers", options.get(name, {})) for name in names]
    return tuple(entrant for solver in solvers for entrant in _with_settings(solver, SETTINGS[asked.tuning]))


def _with_settings(solver: Solver, wanted: Sequence[str]) -> list[Entrant]:
    if not isinstance(solver, ThroughCvxpy):
        return [Entrant(solver, "own")]
    if solver.solver not in TUNED:
        return [Entrant(replace(solver, tuned=False), "default")]
    return [Entrant(replace(solver, tuned=settings == "tuned"), settings) for settings in wanted]


def _attempted(problem: Problem, asked: Comparison, chosen: Sequence[Entrant], i: int, shown: Shown | None) -> Attempt:
    entrant = chosen[i]
    label = f"{entrant.attempt.label}, {i + 1} of {len(chosen)}"

    def advance(n: int, steps: int) -> None:
        if shown is not None:
            shown(label, n, steps)

    if asked.time_limit is None:
        advance(0, asked.steps)
        return attempted(problem, asked, entrant, advance)
    if shown is not None:
        shown(label, i, len(chosen))
    try:
        return alone_within(asked.time_limit, installed, attempted_alone, path=problem.path, asked=asked, i=i)
    except TookTooLong:
        return replace(entrant.attempt, outcome=STOPPED, says=f"stopped after {asked.time_limit:g} s")
    except Crashed as crash:
        return replace(entrant.attempt, outcome=FAILED, says=f"its process ended: {crash}")
    except Refused as refusal:
        return replace(entrant.attempt, outcome=FAILED, says=_own_words(str(refusal)))


def attempted_alone(path: Path, asked: Comparison, i: int) -> Attempt:
    """The attempt of entrant `i`, in a process that has read nothing yet."""
    return attempted(read_problem(path), asked, entrants(asked)[i], None)


def attempted(
    problem: Problem, asked: Comparison, entrant: Entrant, progress: Callable[[int, int], None] | None
) -> Attempt:
    """Solve the problem by one solver, whatever comes of it."""
    scene, mesh = problem.scene(asked.settings), problem.mesh(asked.n, asked.family)
    times, solver = problem.times(asked.steps), entrant.solver
    advance = False if progress is None else progress
    try:
        history = simulate(scene, mesh, times, solver=solver, initial=problem.initial, check=False, progress=advance)
    except NotAccepted as error:
        return replace(entrant.attempt, outcome=REFUSED, says=clause(str(error)))
    except (NotCertified, NotContracting) as error:
        return replace(entrant.attempt, outcome=MISSED, says=clause(str(error)))
    except VemcvxError as error:
        return replace(entrant.attempt, outcome=FAILED, says=_own_words(str(error)))
    except MemoryError:
        return replace(entrant.attempt, outcome=FAILED, says="it ran out of memory")
    return replace(entrant.attempt, trajectory=history.trajectory, seconds=dict(history.seconds))


def _raise_what_all_say(attempts: Sequence[Attempt]) -> None:
    """An error that every solver ends in, of those that take the program, is one of the problem."""
    tried = [(attempt.outcome, attempt.says) for attempt in attempts if attempt.outcome != REFUSED]
    if len(tried) > 1 and len(set(tried)) == 1 and tried[0][0] == FAILED:
        raise SceneError(tried[0][1])


def _once(attempts: Sequence[Attempt]) -> list[Attempt]:
    """A solver that refuses the program with all settings is told once."""
    told = [(a.solver, a.says) if a.outcome == REFUSED else i for i, a in enumerate(attempts)]
    return [a for i, a in enumerate(attempts) if told.index(told[i]) == i]


@contextmanager
def warned_once() -> Iterator[None]:
    """Say each warning once, however many solvers meet it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for words, kind in dict.fromkeys((str(warning.message), warning.category) for warning in caught):
        warnings.warn(words, kind, stacklevel=2)


def clause(message: str) -> str:
    """An error's first clause, without the name of the solver before it."""
    return re.split(r"[;.](?:\s|$)", _own_words(message), maxsplit=1)[0]


def _own_words(message: str) -> str:
    """An error without the name of the solver before it."""
    return re.sub(r"^solver \S+: ", "", message).removesuffix(".")
