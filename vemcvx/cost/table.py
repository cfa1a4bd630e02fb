"""What became of the points: the table of a sweep, its Pareto front, and what to use for an accuracy.

Columns of the table, one row a point:

    family, n           meshes, and cells across the shortest side (of an adaptive run to begin with)
    target              relative energy error that an adaptive run aims at; empty for uniform ones
    solver, accuracy    and the certified relative energy error of a step that is asked of it
    steps               of backward Euler, made
    cells, unknowns     of the (last) mesh
    status              done; refused (no well-posed problem, or not certified); crashed (out of memory ...)
    error               true error: the largest over the instants looked at, in the energy norm, against the reference,
                        relative to the reference's largest energy norm
    error_end           the same at the last instant
    estimated           the run's own estimate, vemcvx.error_budget: algebra + space + time; empty where there is none
    certificate         certified relative energy error of the steps, added up
    seconds             what the answer costs: assemble + prepare + solve + adapt
    assemble, prepare, solve    as in history.seconds (of an adaptive run: of its last pass)
    adapt               earlier passes, estimates and refinement of an adaptive run
    mesh                seconds that making the (first) mesh takes; not counted in `seconds`
    repeats             runs of which these seconds are the median one
    peak_mb             most memory (resident set) that a process of its own held, interpreter and libraries included
    wall                seconds of the whole point: start of a process, warming up, repeats, measuring
    at                  when it was done, seconds since 1970
    message             what was refused, or warned of
    key                 identifies the point, the problem and the reference
    front_seconds, front_unknowns    1 for runs that no run at no more cost equals, see :mod:`vemcvx.cost.table`
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

from vemcvx.tables import csv_text

DONE, REFUSED, CRASHED = "done", "refused", "crashed"


@dataclass(frozen=True)
class Row:
    """One point and what came out; see :mod:`vemcvx.cost.table`. None where there is nothing to say."""

    family: str | None
    n: int
    target: float | None
    solver: str
    accuracy: float
    steps: int | None
    status: str
    key: str
    cells: int | None = None
    unknowns: int | None = None
    error: float | None = None
    error_end: float | None = None
    estimated: float | None = None
    certificate: float | None = None
    seconds: float | None = None
    assemble: float | None = None
    prepare: float | None = None
    solve: float | None = None
    adapt: float | None = None
    mesh: float | None = None
    repeats: int | None = None
    peak_mb: float | None = None
    wall: float | None = None
    at: float | None = None
    message: str = ""

    @property
    def done(self) -> bool:
        """Whether there is an answer."""
        return self.status == DONE

    @property
    def whole(self) -> bool:
        """Whether it says what a row must, in values of their kinds."""
        needed = self.done and None in (self.error, self.seconds, self.unknowns, self.steps)
        return of_its_kinds(self) and self.status in (DONE, REFUSED, CRASHED) and not needed

    @property
    def settings(self) -> str:
        """The settings in words."""
        where = "its own mesh" if self.family is None else self.family
        how = f"{self.solver} at {self.accuracy:g}"
        if self.target is not None:
            return f"{where} refined adaptively from n = {self.n}, target {percent(self.target)}, {how}"
        return f"{where} n = {self.n}, {self.steps} steps, {how}"


def of_its_kinds(record: Any) -> bool:
    """Whether every field of a record that was read has a value of its kind, and every number is finite."""
    hints = get_type_hints(type(record))
    return all(_of_kind(getattr(record, field.name), hints[field.name]) for field in fields(record))


def _of_kind(value: object, kind: Any) -> bool:
    if isinstance(value, tuple):
        return get_origin(kind) is tuple and all(_of_kind(part, get_args(kind)[0]) for part in value)
    kinds = get_args(kind) or (kind,)
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return math.isfinite(value) and (float in kinds or (int in kinds and isinstance(value, int)))
    return type(value) in kinds


def percent(share: float) -> str:
    """A share in per cent, in two digits."""
    return f"{100 * share:.2g} %"


def _order(row: Row) -> tuple[object, ...]:
    return (
        row.target is not None,
        row.family or "",
        row.target or 0.0,
        row.n,
        row.steps or 0,
        row.solver,
        row.accuracy,
    )


class Answer(NamedTuple):
    """A row that has an answer, with its error and what it costs."""

    row: Row
    error: float
    seconds: float
    unknowns: int


def answers(rows: Sequence[Row]) -> list[Answer]:
    """The rows that have one."""
    return [
        Answer(row, row.error, row.seconds, row.unknowns)
        for row in rows
        if row.done and row.error is not None and row.seconds is not None and row.unknowns is not None
    ]


def table(rows: Sequence[Row]) -> str:
    """All rows as CSV, in the order of their settings."""
    rows = sorted(rows, key=_order)
    found = answers(rows)
    costs: dict[str, Sequence[float]] = {
        "front_seconds": [one.seconds for one in found],
        "front_unknowns": [one.unknowns for one in found],
    }
    errors = [one.error for one in found]
    fronts = {name: {found[k].row.key for k in front(cost, errors)} for name, cost in costs.items()}
    heads = [*(field.name for field in fields(Row)), *fronts]
    return csv_text(heads, ([*astuple(row), *(int(row.key in keys) for keys in fronts.values())] for row in rows))


SAME = 0.01
"""Errors that differ by less than this part are the same: solvers differ in the last digits of one mesh's error."""


def front(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Which pairs of cost and error are better than all that cost no more, by growing cost; of equal ones the first."""
    best, kept = float("inf"), []
    for k in sorted(range(len(costs)), key=lambda k: (costs[k], errors[k])):
        if errors[k] < (1.0 - SAME) * best:
            best = errors[k]
            kept.append(k)
    return kept


def within_reach(rows: Sequence[Row]) -> list[float]:
    """The two smallest of the levels 50 %, 20 %, 10 % ... that a run is as good as."""
    levels = [share * 10.0**-k for k in range(1, 9) for share in (5.0, 2.0, 1.0)]
    return [level for level in levels if any(one.error <= level for one in answers(rows))][-2:]


def advice(rows: Sequence[Row], levels: Sequence[float]) -> list[str]:
    """One line a level."""
    found = answers(rows)
    best = min(found, key=lambda one: one.error, default=None)
    lines = []
    for level in levels:
        cheapest = min((one for one in found if one.error <= level), key=lambda one: one.seconds, default=None)
        if cheapest is not None:
            row, error, seconds, unknowns = cheapest
            lines.append(
                f"for {percent(level)}: use {row.settings}: costs {seconds:.2g} s, error {percent(error)} "
                f"({unknowns} unknowns, {row.steps} steps, {row.peak_mb or float('nan'):.0f} MB)"
            )
        elif best is not None:
            lines.append(
                f"for {percent(level)}: no run of this sweep is as good; the best is {best.row.settings} with "
                f"{percent(best.error)}. Ask for larger --n, or a smaller --target."
            )
        else:
            lines.append(f"for {percent(level)}: no run of this sweep has an answer.")
    return lines
