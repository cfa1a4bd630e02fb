"""The table of a sweep: its rows, the journal that keeps them, the Pareto front, advice, and the picture."""

from __future__ import annotations

import hashlib
import json
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from vemcvx.base.canvas import light_grid, new_figure, plain_logarithms
from vemcvx.base.errors import HistoryError
from vemcvx.base.version import __version__
from vemcvx.cost.workers import CRASHED, DONE
from vemcvx.plots.style import MARKERS, SERIES
from vemcvx.results.quoted import growth
from vemcvx.results.table import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Row:
    """One point and what came out; None stands for a value that does not exist.

    Errors are of the energy norm: the largest over the instants looked at, against the reference, relative to its
    largest norm; `error_end` is that at the last instant. Of another quantity both are its relative error at the end.
    """

    family: str | None  # of meshes
    n: int  # cells across the shortest side; of an adaptive run to begin with
    target: float | None  # relative error that an adaptive run aims at; None for uniform ones
    solver: str
    accuracy: float  # certified relative energy error of a step that is asked of it
    steps: int | None  # of backward Euler, made
    status: str  # done, refused or crashed
    key: str  # identifies the point, the problem and the reference
    cells: int | None = None  # of the (last) mesh
    unknowns: int | None = None
    error: float | None = None
    error_end: float | None = None
    estimated: float | None = None  # by vemcvx.error_budget: algebra + space + time; or by vemcvx.quantities
    certificate: float | None = None  # certified errors of the steps, rounding included, added up: the largest
    seconds: float | None = None  # what the answer costs: assemble + prepare + solve + adapt
    assemble: float | None = None  # these three as in history.seconds, of an adaptive run those of its last pass
    prepare: float | None = None
    solve: float | None = None
    adapt: float | None = None  # earlier passes, estimates and refinement of an adaptive run
    mesh: float | None = None  # seconds that making the (first) mesh takes; not counted in `seconds`
    repeats: int | None = None  # runs of which these seconds are the median one
    peak_mb: float | None = None  # most memory that a process of its own held, interpreter and libraries included
    wall: float | None = None  # seconds of the whole point: start of a process, warming up, repeats, measuring
    at: float | None = None  # when it was done, seconds since 1970
    message: str = ""  # the refusal, or warnings
    of: str = "energy"  # the quantity of errors and targets, or "dissipated", "work" or "wear"
    value: float | None = None  # what the run has of another quantity than energy
    bounded: bool = False  # whether a guaranteed bound was asked for
    bound: float | None = None  # guaranteed relative error, vemcvx.error_bound, made after `seconds`
    bound_of: str = ""  # "history": of mesh and steps over the run; "step": the largest of the mesh in a step looked at
    von_mises: float | None = None  # these three are the largest over the instants looked at
    pressure: float | None = None
    friction: float | None = None

    @property
    def done(self) -> bool:
        """True if there is an answer."""
        return self.status == DONE

    @property
    def settings(self) -> str:
        """The settings in words."""
        where = "its own mesh" if self.family is None else self.family
        how = f"{self.solver} at {self.accuracy:g}"
        if self.target is not None:
            return f"{where} refined adaptively from n = {self.n}, target {percent(self.target)}, {how}"
        return f"{where} n = {self.n}, {self.steps} steps, {how}"


SEAL = ', "seal": "'


def sealed(record: Any) -> str:
    """A dataclass as a line of JSON that ends with a digest of what stands before it."""
    words = json.dumps(asdict(record), allow_nan=False)[:-1]
    return f'{words}{SEAL}{_digest(words)}"}}\n'


def unsealed(line: str) -> dict[str, Any] | None:
    """The fields of such a record; None where the digest is not its own: it was torn as its process died, or edited."""
    words, _, digest = line.rstrip("\n").rpartition(SEAL)
    if digest != f'{_digest(words)}"}}':
        return None
    return json.loads(words + "}")


def _digest(words: str) -> str:
    return hashlib.blake2b(f"{__version__} {words}".encode(), digest_size=16).hexdigest()


def read_journal(path: Path) -> dict[str, Row]:
    """The finished points by key, each as it was last written; crashed ones are left out, to be tried again."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else []
    rows = [Row(**record) for record in map(unsealed, lines) if record is not None]
    return {key: row for key, row in {row.key: row for row in rows}.items() if row.status != CRASHED}


def append(path: Path, row: Row) -> None:
    """Write a row on a line of its own, down to the disk."""
    try:
        with path.open("ab+") as stream:
            stream.seek(max(0, stream.tell() - 1))
            torn = stream.read(1) not in (b"", b"\n")
            stream.write(b"\n" * torn + sealed(row).encode())
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise HistoryError(f"{path}: cannot write the journal: {error}. What it holds is kept.") from error


def percent(share: float) -> str:
    """A share in per cent, in two digits."""
    return f"{100 * share:.2g} %"


class Answer(NamedTuple):
    """A row that has an answer, with its error and what it costs."""

    row: Row
    error: float
    seconds: float
    unknowns: int


def answers(rows: Sequence[Row]) -> list[Answer]:
    """The rows that have an answer."""
    return [
        Answer(row, row.error, row.seconds, row.unknowns)
        for row in rows
        if row.done and row.error is not None and row.seconds is not None and row.unknowns is not None
    ]


def table(rows: Sequence[Row]) -> str:
    """All rows as CSV, in the order of their settings.

    The last columns, front_seconds and front_unknowns, are 1 for runs that no run at no more cost equals.
    """

    def order(row: Row) -> tuple[object, ...]:
        where = row.target is not None, row.family or "", row.target or 0.0, row.n, row.steps or 0
        return *where, row.solver, row.accuracy

    found, heads = answers(rows), [*(field.name for field in fields(Row)), "front_seconds", "front_unknowns"]
    errors, costs = [one.error for one in found], ([float(getattr(one, cost)) for one in found] for cost in AXES)
    fronts = [{found[k].row.key for k in front(cost, errors)} for cost in costs]
    plain = [[*astuple(row), *(int(row.key in keys) for keys in fronts)] for row in sorted(rows, key=order)]
    return Table(heads, plain).csv()


def front(costs: Sequence[float], errors: Sequence[float]) -> list[int]:
    """Pareto front: the pairs of cost and error better than all that cost no more, by growing cost; first of equals."""
    best, kept = float("inf"), []
    for k in sorted(range(len(costs)), key=lambda k: (costs[k], errors[k])):
        # Errors that differ by less than a hundredth are the same: solvers differ in the last digits of a mesh's error.
        if errors[k] < (1.0 - 0.01) * best:
            best = errors[k]
            kept.append(k)
    return kept


EXTREMES = {
    "von_mises": "the largest von Mises stress",
    "pressure": "the largest pressure",
    "friction": "the largest friction",
}


def without_limit(rows: Sequence[Row]) -> list[str]:
    """A sentence for each extreme that has grown from one of the last meshes of a family to the next."""
    uniform = [row for row in rows if row.done and row.target is None]
    lines = []
    for key, words in EXTREMES.items():
        for family in dict.fromkeys(row.family for row in uniform):
            own = {row.n: getattr(row, key) or 0.0 for row in uniform if row.family == family}
            found = growth([1.0 / n for n in sorted(own)], [own[n] for n in sorted(own)])
            if found:
                counts = ", ".join(map(str, sorted(own)[-4:]))
                lines.append(f"{words} {found} ({family or 'its own mesh'}, n = {counts})")
                break
    return lines


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
        words = "no run of this sweep has an answer."
        if cheapest is not None:
            row, error, seconds, unknowns = cheapest
            words = f"use {row.settings}: costs {seconds:.2g} s, error {percent(error)} "
            words += f"({unknowns} unknowns, {row.steps} steps, {row.peak_mb or float('nan'):.0f} MB)"
        elif best is not None:
            words = f"no run of this sweep is as good; the best is {best.row.settings} with {percent(best.error)}. "
            words += "Ask for larger --n, or a smaller --target."
        lines.append(f"for {percent(level)}: {words}")
    return lines


def effectivities(rows: Sequence[Row], title: str = "") -> Figure | None:
    """Draw estimates and guaranteed bounds over true errors, which are 1 at best; None where no run has a bound.

    Bounds of steps are of another error than the true one, and left out.
    """
    found = [one for one in answers(rows) if one.error > 0 and one.row.bound_of == "history"]
    if not found:
        return None
    figure = new_figure(7.4, 4.0)
    ax = figure.subplots()
    for k, family in enumerate(sorted({one.row.family for one in found}, key=str)):
        own = [one for one in found if one.row.family == family]
        style: dict[str, Any] = {"markersize": 6, "color": SERIES[k % len(SERIES)]}
        sizes = {"bound": [one.row.bound for one in own], "estimate": [one.row.estimated for one in own]}
        for (word, known), fill in zip(sizes.items(), ("full", "none"), strict=True):
            marks = [(100.0 * one.error, size / one.error) for one, size in zip(own, known, strict=True) if size]
            label = f"{family or 'own mesh'}, {word}"
            ax.plot(*np.reshape(marks, (-1, 2)).T, MARKERS[k % len(MARKERS)], fillstyle=fill, label=label, **style)
    ax.axhline(1.0, color="0.25", linewidth=1.0)
    ax.set(xscale="log", yscale="log", xlabel="true error, %", ylabel="bound or estimate over true error", title=title)
    plain_logarithms(ax.yaxis, (1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 7.0))
    plain_logarithms(ax.xaxis)
    light_grid(ax)
    figure.legend(loc="outside right upper", frameon=False, fontsize="small")
    return figure


AXES = {"seconds": "seconds, in one thread", "unknowns": "unknowns"}
FILLED = ("full", "none", "left", "top", "right", "bottom")  # Marks of solvers.


def picture(
    rows: Sequence[Row], levels: Sequence[float], resolved: float | None, title: str = "", of: str = "the energy norm"
) -> Figure:
    """Draw true errors of a quantity against seconds and against unknowns, of rows of which some has an answer.

    Lines mark the errors of `levels`, and a band those below the estimated error of the reference, `resolved`.
    """
    figure = new_figure(10.0, 4.4)
    axes, found = figure.subplots(1, 2, sharey=True), [answer for answer in answers(rows) if answer.error > 0]
    errors = [100 * answer.error for answer in found]
    for ax, cost in zip(axes, AXES, strict=True):
        _marked(ax, found, [getattr(answer, cost) for answer in found])
        for level in levels:
            ax.axhline(100 * level, color="0.75", linewidth=0.8, linestyle="--", zorder=0)
        ax.set(xscale="log", yscale="log", xlabel=AXES[cost])
        light_grid(ax)
    low = min([*errors, np.inf if resolved is None else 100 * resolved]) / 1.25
    axes[0].set(ylim=(low, max(errors) * 1.25), ylabel=f"true error of {of}, %")
    plain_logarithms(axes[0].yaxis)
    if resolved is not None:
        for ax in axes:
            ax.axhspan(low, 100 * resolved, color="0.93", zorder=0)
        how: dict[str, Any] = {"transform": axes[1].get_yaxis_transform(), "va": "top", "fontsize": "small"}
        axes[1].text(0.02, 100 * resolved, "the reference's own error", **how)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper", frameon=False, fontsize="small")
    figure.suptitle(title, fontsize="medium")
    return figure


def _marked(ax: Axes, found: Sequence[Answer], costs: Sequence[float]) -> None:
    """Draw the errors over the costs: the Pareto front, and marks by family, solver and whether meshes are adaptive."""
    errors = [100 * answer.error for answer in found]
    families = sorted({answer.row.family for answer in found}, key=str)
    # Rows come in any order; most have the solver that a sweep is about.
    solvers = [solver for solver, _ in Counter(answer.row.solver for answer in found).most_common()]
    kinds = [(answer.row.family, answer.row.solver, answer.row.target is not None) for answer in found]
    best = front(costs, errors)
    ax.plot([costs[k] for k in best], [errors[k] for k in best], "0.25", linewidth=1.1, label="Pareto front")
    for family, solver, adaptive in sorted(set(kinds), key=lambda kind: (kind[2], solvers.index(kind[1]), str(kind))):
        own = [k for k, kind in enumerate(kinds) if kind == (family, solver, adaptive)]
        # A mark a family, for print in grey; with a black edge where meshes are adaptive. Solvers mostly give the same
        # errors: marks of the second are hollow, of others filled in half.
        place = families.index(family)
        colour, mark = SERIES[place % len(SERIES)], MARKERS[place % len(MARKERS)]
        (drawn,) = ax.plot([costs[k] for k in own], [errors[k] for k in own], mark, color=colour, markersize=5)
        drawn.set(fillstyle=FILLED[solvers.index(solver) % len(FILLED)], markerfacecoloralt="white")
        drawn.set(label=f"{family or 'own mesh'}, {solver}{', adaptive' * adaptive}")
        if adaptive:
            drawn.set(markersize=8, markeredgecolor="black", markeredgewidth=1.6)
