"""Friction traction along the contact boundary, between its bounds: at them it slips, inside them it sticks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.canvas import light_grid, new_figure
from vemcvx.plots.contact_line import ContactLine, contact_line
from vemcvx.plots.palette import SLIP, STICK
from vemcvx.results.history import History

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def friction_traction(history: History, step: int = -1) -> Figure:
    """Draw the friction traction on the body against +-g at a stored step.

    Raises
    ------
    HistoryError
        The history has no contact.
    """
    row = history.row(step)
    line = contact_line(history, "friction_traction")
    traction = line.along(history.contact.traction[row])
    low, high = _range(history, row, line)
    sticks = history.contact.sticking[row, line.order]
    figure = new_figure(6.4, 3.6)
    ax = figure.add_subplot()
    for chosen, colour in ((sticks, STICK), (~sticks, SLIP)):
        for start, stop in line.spans(chosen):
            ax.axvspan(start, stop, color=colour, alpha=0.13, linewidth=0)
    for bound, label in ((high, "bound $\\pm g$"), (low, None)):
        ax.plot(*line.broken(bound), color="black", linestyle="--", linewidth=1.2, label=label)
    ax.plot(*line.broken(traction), color="0.35", linewidth=1.0, zorder=1.5)
    style = {"linestyle": "none", "markersize": np.clip(150 / len(sticks), 1.5, 4), "clip_on": False, "zorder": 3}
    for chosen, colour, marker, word in ((sticks, STICK, "o", "stick"), (~sticks, SLIP, "s", "slip")):
        if chosen.any():
            ax.plot(line.position[chosen], traction[chosen], marker=marker, color=colour, label=word, **style)
    top = 1.2 * max(float(high.max()), float(-low.min()), float(np.abs(traction).max())) or 1.0
    ax.set(
        xlim=(line.limits.min(), line.limits.max()),
        ylim=(-top, top),
        xlabel=f"{line.label} (units of length)",
        ylabel="friction on the body\n(units of force per length)",
        title=f"t = {history.times[row]:.4g}: {sticks.sum()} contact nodes stick, {(~sticks).sum()} slip",
    )
    light_grid(ax)
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    return figure


def _range(history: History, row: int, line: ContactLine) -> tuple[Floats, Floats]:
    """The least and the largest friction along the line: against slip forward, and against slip backward."""
    contact = history.contact
    tangents = np.column_stack([-contact.normals[:, 1], contact.normals[:, 0]])
    onward = line.along(tangents) > 0
    forward, backward = contact.bound[row, line.order], contact.backward[row, line.order]
    return -np.where(onward, forward, backward), np.where(onward, backward, forward)
