"""Friction traction along the contact boundary, between its bounds: at them it slips, inside them it sticks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats
from vemcvx.canvas import axes_or_new, figure_of, legend_below, light_grid
from vemcvx.plots.contact_line import ContactLine, apart, contact_line
from vemcvx.plots.palette import SLIP, STICK
from vemcvx.plots.scale import value_range
from vemcvx.plots.units import Units, instant, unit
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def friction_traction(
    history: Results,
    step: int = -1,
    *,
    ax: Axes | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the friction traction on the body against +-g at a stored step.

    Parameters
    ----------
    history : History
    step : int
        A stored step; negative ones count from the end.
    ax : Axes, optional
        Where to draw; by default on a new figure.
    limits : (low, high), optional
        Ends of the axis of forces; by default the same for all steps.
    units : mapping of str to str, optional
        Names of units: see :mod:`vemcvx.plots.units`.

    Raises
    ------
    HistoryError
        The history has no contact.
    """
    row = history.row(step)
    line = contact_line(history, "friction_traction")
    traction = line.along(history.contact.traction[row])
    low, high = _range(history, row, line)
    touches, still = ~apart(history, line)[row], history.contact.sticking[row, line.order]
    sticks, slips = touches & still, touches & ~still
    ax = axes_or_new(ax, 6.4, 3.6)
    for chosen, colour in ((sticks, STICK), (slips, SLIP)):
        for start, stop in line.spans(chosen):
            ax.axvspan(start, stop, color=colour, alpha=0.13, linewidth=0)
    for bound, label in ((high, "bound $\\pm g$"), (low, None)):
        ax.plot(*line.broken(bound), color="black", linestyle="--", linewidth=1.2, label=label)
    ax.plot(*line.broken(traction), color="0.35", linewidth=1.0, zorder=1.5)
    style = {"linestyle": "none", "markersize": np.clip(150 / len(sticks), 1.5, 4), "clip_on": False, "zorder": 3}
    for chosen, colour, marker, word in ((sticks, STICK, "o", "stick"), (slips, SLIP, "s", "slip")):
        if chosen.any():
            ax.plot(line.position[chosen], traction[chosen], marker=marker, color=colour, label=word, **style)
    contact, gone = history.contact, "" if touches.all() else f", {(~touches).sum()} are open"
    top = 1.2 * max(float(np.abs(force).max()) for force in (contact.bound, contact.backward, contact.traction)) or 1.0
    ax.set(
        xlim=(line.limits.min(), line.limits.max()),
        ylim=value_range(limits, (-top, top)),
        xlabel=f"{line.label} ({unit(units, 'length')})",
        ylabel=f"friction on the body\n({unit(units, 'force per length')})",
        title=f"{instant(history.times[row], units)}: {sticks.sum()} contact nodes stick, {slips.sum()} slip{gone}",
    )
    light_grid(ax)
    legend_below(ax)
    return figure_of(ax)


def _range(history: Results, row: int, line: ContactLine) -> tuple[Floats, Floats]:
    """The least and the largest friction along the line: against slip forward, and against slip backward."""
    contact = history.contact
    tangents = np.column_stack([-contact.normals[:, 1], contact.normals[:, 0]])
    onward = line.along(tangents) > 0
    forward, backward = contact.bound[row, line.order], contact.backward[row, line.order]
    return -np.where(onward, forward, backward), np.where(onward, backward, forward)
