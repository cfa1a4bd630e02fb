"""Pareto fronts, advice and a picture of the rows of a sweep."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import TYPE_CHECKING

from vemcvx.base.canvas import light_grid, new_figure, plain_logarithms
from vemcvx.base.errors import VemcvxError
from vemcvx.base.outline import count_steps
from vemcvx.cost.rows import Row, csv
from vemcvx.cost.workers import DONE
from vemcvx.plots.style import MARKERS, SERIES
from vemcvx.results import growth

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

AXES = {"seconds": "seconds, in one thread", "unknowns": "unknowns"}
EXTREMES = {"von_mises": "von Mises stress", "pressure": "pressure", "friction": "friction"}


def in_words(row: Row) -> str:
    """Describe the settings of a row in words."""
    where, how = row["family"] or "its own mesh", f"{row['solver']} at {row['accuracy']:g}"
    if row["target"] is not None:
        return f"{where} refined adaptively from n = {row['n']}, target {_percent(row['target'])}, {how}"
    return f"{where} n = {row['n']}, {count_steps(row['steps'])}, {how}"


def _percent(part: float) -> str:
    return f"{100.0 * part:.2g} %"


def answers(rows: Sequence[Row]) -> list[Row]:
    """Return the rows that have an answer."""
    return [row for row in rows if row["status"] == DONE]


def table(rows: Sequence[Row]) -> str:
    """Return the rows as CSV, with columns that mark the Pareto fronts."""
    fronts = {f"front_{cost}": front(answers(rows), cost) for cost in AXES}
    return csv([row | {name: int(row in best) for name, best in fronts.items()} for row in rows])


def front(rows: Sequence[Row], cost: str) -> list[Row]:
    """Return the rows on the Pareto front of error and cost, by increasing cost."""
    best, kept = float("inf"), []
    for row in sorted(rows, key=lambda row: (row[cost], row["error"])):
        # Errors that differ by less than 1 % count as equal.
        if row["error"] < 0.99 * best:
            best = row["error"]
            kept.append(row)
    return kept


def growing_extremes(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a sentence for each extreme that grows on the finest meshes of a family."""
    uniform = [row for row in answers(rows) if row["target"] is None]
    for (key, words), family in product(EXTREMES.items(), dict.fromkeys(row["family"] for row in uniform)):
        own = {row["n"]: row.get(key) or 0.0 for row in uniform if row["family"] == family}
        if found := growth([1.0 / n for n in sorted(own)], [own[n] for n in sorted(own)]):
            yield f"the largest {words} {found} ({family or 'its own mesh'}, n = {', '.join(map(str, sorted(own)))})"


def advice(rows: Sequence[Row], levels: Sequence[float]) -> Iterator[str]:
    """Yield a line for each error level, with the fastest run that reaches the level."""
    found = sorted(answers(rows), key=lambda row: row["seconds"])
    best = min(found, key=lambda row: row["error"], default=None)
    for level in levels:
        words = "no run of this sweep has an answer."
        if cheapest := next((row for row in found if row["error"] <= level), None):
            words = f"use {in_words(cheapest)}: costs {cheapest['seconds']:.2g} s, error {_percent(cheapest['error'])} "
            size = f"{cheapest['unknowns']} unknowns, {count_steps(cheapest['steps'])}"
            words += f"({size}, {cheapest['peak_mb'] or 0:.0f} MB)"
        elif best:
            words = f"no run of this sweep is as good; the best is {in_words(best)} with {_percent(best['error'])}. "
            words += "Use a larger --n, or a smaller --target."
        yield f"for {_percent(level)}: {words}"


def picture(rows: Sequence[Row], levels: Sequence[float], resolved: float | None, title: str) -> Figure:
    """Draw true errors over costs, with lines at error levels and a band of unresolved errors."""
    figure, found = new_figure(10.0, 4.4), [row for row in answers(rows) if row["error"] > 0]
    if not found:
        raise VemcvxError("no run has an answer")
    axes, percents = figure.subplots(1, 2, sharey=True), [100 * row["error"] for row in found]
    low = min([*percents, *([] if resolved is None else [100 * resolved])]) / 1.25
    for ax, (cost, words) in zip(axes, AXES.items(), strict=True):
        _draw_rows(ax, found, cost)
        for level in levels:
            ax.axhline(100 * level, color="0.75", linewidth=0.8, linestyle="--", zorder=0)
        if resolved is not None:
            ax.axhspan(low, 100 * resolved, color="0.93", zorder=0, label="the reference's own error")
        ax.set(xscale="log", yscale="log", xlabel=words)
        light_grid(ax)
    axes[0].set(ylim=(low, max(percents) * 1.25), ylabel="true error of the energy norm, %")
    plain_logarithms(axes[0].yaxis)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper", frameon=False, fontsize="small")
    figure.suptitle(title, fontsize="medium")
    return figure


def _draw_rows(ax: Axes, rows: Sequence[Row], cost: str) -> None:
    best = front(rows, cost)
    ax.plot([row[cost] for row in best], [100 * row["error"] for row in best], "0.25", label="Pareto front")
    kinds: dict[str, list[Row]] = {}
    for row in rows:
        adapted = ", adaptive" * (row["target"] is not None)
        kinds.setdefault(f"{row['family'] or 'own mesh'}, {row['solver']}{adapted}", []).append(row)
    for k, words in enumerate(sorted(kinds)):
        x, y = [row[cost] for row in kinds[words]], [100 * row["error"] for row in kinds[words]]
        color = SERIES[(k + k // len(MARKERS)) % len(SERIES)]
        ax.plot(x, y, linestyle="", marker=MARKERS[k % len(MARKERS)], color=color, markersize=6, label=words)
