"""The work-precision picture: true error against seconds, and against unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from vemcvx.canvas import light_grid, new_figure
from vemcvx.cost.table import Row, answers, front, percent
from vemcvx.plots.palette import SERIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

UNIFORM, ADAPTIVE = "o", "D"
AXES = {"seconds": "seconds, in one thread", "unknowns": "unknowns"}


def picture(rows: Sequence[Row], levels: Sequence[float], resolved: float | None, title: str = "") -> Figure:
    """Draw the rows that have an answer, of which there must be one.

    Parameters
    ----------
    rows : sequence of Row
    levels : sequence of float
        Errors to mark by lines.
    resolved : float or None
        Estimated error of the reference.
    title : str

    Raises
    ------
    VemcvxError
        matplotlib is not installed.
    """
    figure = new_figure(10.0, 4.4)
    left, right = figure.subplots(1, 2, sharey=True)
    found = [answer for answer in answers(rows) if answer.error > 0]
    done, errors = [answer.row for answer in found], [answer.error for answer in found]
    for ax, cost in ((left, "seconds"), (right, "unknowns")):
        _draw(ax, done, [getattr(answer, cost) for answer in found], errors)
        for level in levels:
            ax.axhline(level, color="0.75", linewidth=0.8, linestyle=(0, (5, 4)), zorder=0)
        if resolved is not None:
            ax.axhspan(resolved / 10, resolved, color="0.93", zorder=0)
        ax.set(xscale="log", yscale="log", xlabel=AXES[cost])
        light_grid(ax)
    _error_axis(left, errors, resolved)
    left.set_ylabel("true error, relative, in the energy norm")
    if resolved is not None:
        right.text(
            0.02, resolved * 0.93, "the reference's own error", transform=right.get_yaxis_transform(), va="top",
            fontsize="small", color="0.45",
        )  # fmt: skip
    figure.legend(handles=_legend(left, done), loc="outside right upper", frameon=False, fontsize="small")
    figure.suptitle(title, fontsize="medium")
    return figure


def _draw(ax: Axes, done: Sequence[Row], costs: Sequence[float], errors: Sequence[float]) -> None:
    best = front(costs, errors)
    ax.plot([costs[k] for k in best], [errors[k] for k in best], "-", color="0.25", linewidth=1.1, zorder=2)
    colours = _colours(done)
    for row, x, y in zip(done, costs, errors, strict=True):
        newton, adaptive = row.solver == done[0].solver, row.target is not None
        ax.plot(
            x, y, ADAPTIVE if adaptive else UNIFORM, markersize=6.5 if adaptive else 5.0, color=colours[row.family],
            markerfacecolor=colours[row.family] if newton else "white", markeredgewidth=1.0, zorder=3 + adaptive,
        )  # fmt: skip


def _colours(done: Sequence[Row]) -> dict[str | None, str]:
    families = sorted({row.family for row in done}, key=str)
    return {family: SERIES[k % len(SERIES)] for k, family in enumerate(families)}


def _error_axis(ax: Axes, errors: Sequence[float], resolved: float | None) -> None:
    """Error marks in per cent, one, two and five of every power of ten."""
    low, high = min([*errors, *([resolved] if resolved else [])]) / 1.25, max(errors) * 1.25
    ticks = [m * 10.0**e for e in range(-9, 2) for m in (1, 2, 5)]
    shown = [tick for tick in ticks if low <= tick <= high]
    ax.set_ylim(low, high)
    ax.set_yticks(shown, [percent(tick) for tick in shown])
    ax.minorticks_off()


def _legend(ax: Axes, done: Sequence[Row]) -> list[Line2D]:
    def mark(label: str, color: str = "0.25", marker: str = UNIFORM, face: str | None = None) -> Line2D:
        face = face or color
        return ax.plot([], [], linestyle="", color=color, marker=marker, markerfacecolor=face, label=label)[0]

    made = [mark(family or "own mesh", color=colour) for family, colour in _colours(done).items()]
    kinds = {row.target is not None for row in done}
    made += [mark("uniform")] if False in kinds else []
    made += [mark("adaptive", marker=ADAPTIVE)] if True in kinds else []
    others = sorted({row.solver for row in done} - {done[0].solver})
    made += [mark(", ".join(others), face="white")] if others else []
    return [*made, ax.plot([], [], "-", color="0.25", linewidth=1.1, label="Pareto front")[0]]
