"""Tables of a comparison on a terminal: as many columns as fit; the rest is in the files that can be asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from vemcvx.cli.compare import Compared
from vemcvx.cli.judgement import Row
from vemcvx.solvers import ThroughCvxpy
from vemcvx.solvers.settings import TUNED

WIDE = 112
"""Characters that all columns take."""


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
            console.print(_answers(answered, console.width >= WIDE))
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
    """What became of those that are not in the table above, and of those that miss."""
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
    """How to read the columns, and what is wrong."""
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
