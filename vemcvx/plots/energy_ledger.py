"""Where the work goes, and how certain the numbers are, over time.

    work - (stored - stored at the start) - dissipated = numerical dissipation = sum over steps of 1/2 a(du, du) >= 0,

what backward Euler loses beside friction; it goes to zero with the step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vemcvx.canvas import light_grid, new_figure
from vemcvx.errors import HistoryError
from vemcvx.plots.palette import DISSIPATED, NUMERICAL, STORED, WORK
from vemcvx.results.history import History

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def energy_ledger(history: History) -> Figure:
    """Draw the energies of all steps, stored or not, and their certificates on a logarithmic axis.

    Raises
    ------
    HistoryError
        The history has no step.
    """
    if history.steps == 0:
        raise HistoryError("energy_ledger: this history has no step after the initial instant.")
    figure = new_figure(7.6, 3.9)
    left, right = figure.subplots(1, 2)
    _energies(left, history)
    _certificates(right, history)
    for ax in (left, right):
        ax.set_xlabel("t (units of time)")
        light_grid(ax)
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2, frameon=False, fontsize="small")
    return figure


def _energies(ax: Axes, history: History) -> None:
    run = history.trajectory
    stored = run.energy - run.energy[0]
    lines = (
        (run.work, WORK, "-", "work done on the body"),
        (stored, STORED, "--", "stored" if run.energy[0] == 0 else "stored since the start"),
        (run.dissipated, DISSIPATED, "-.", "dissipated by friction"),
        (run.work - stored - run.dissipated, NUMERICAL, ":", "lost by time stepping"),
    )
    for values, colour, style, label in lines:
        ax.plot(run.times, values, style, color=colour, linewidth=1.6, label=label)
    ax.set(ylabel="energy (units of force × length)", title="Energy ledger")


def _certificates(ax: Axes, history: History) -> None:
    run = history.trajectory
    lines = (
        (run.certificate, STORED, "o", "each step"),
        (run.certificate_total, DISSIPATED, "-", "all steps so far"),
        (run.certificate_floor, WORK, ":", "rounding floor"),
    )
    ax.set(ylabel="relative energy error, at most", title="Certificate", yscale="log")
    for values, colour, style, label in lines:
        shown = np.isfinite(values) & (values > 0)
        ax.plot(run.times[shown], values[shown], style, color=colour, markersize=2.5, linewidth=1.4, label=label)
