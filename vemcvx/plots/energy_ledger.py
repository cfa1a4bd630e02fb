"""Where the work goes, and how certain the numbers are, over time.

    work - (stored - stored at the start) - dissipated = numerical dissipation = sum over steps of 1/2 a(du, du) >= 0,

what backward Euler loses beside friction; it goes to zero with the step.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.canvas import figure_of, light_grid, new_figure
from vemcvx.errors import HistoryError
from vemcvx.plots.palette import DISSIPATED, NUMERICAL, STORED, WORK
from vemcvx.plots.scale import value_range
from vemcvx.plots.units import Units, unit
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def energy_ledger(
    history: Results,
    *,
    ax: Axes | Sequence[Axes] | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the energies of all steps, stored or not, and their certificates on a logarithmic axis.

    Parameters
    ----------
    history, units : as of `friction_traction`
    ax : Axes, or two of them, optional
        Where to draw the energies, and the certificates if there are two; by default on a new figure.
    limits : (low, high), optional
        Ends of the axis of energies.

    Raises
    ------
    HistoryError
        The history has no step.
    """
    if history.steps == 0:
        raise HistoryError("energy_ledger: this history has no step after the initial instant.")
    given = new_figure(7.6, 3.9).subplots(1, 2) if ax is None else ax
    panels = list(given) if isinstance(given, Iterable) else [given]
    _energies(panels[0], history, unit(units, "energy"))
    if limits is not None:
        panels[0].set_ylim(value_range(limits, ()))
    for second in panels[1:]:
        _certificates(second, history)
    for panel in panels:
        panel.set_xlabel(f"t ({unit(units, 'time')})")
        light_grid(panel)
        panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2, frameon=False, fontsize="small")
    return figure_of(panels[0])


def _energies(ax: Axes, history: Results, energy: str) -> None:
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
    ax.set(ylabel="energy" if energy == "energy" else f"energy ({energy})", title="Energy ledger")


def _certificates(ax: Axes, history: Results) -> None:
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
