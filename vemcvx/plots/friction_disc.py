"""Friction in space against its bound: vectors in a disc, on whose rim nodes slip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vemcvx.canvas import axes_or_new, figure_of, legend_under, light_grid
from vemcvx.errors import HistoryError
from vemcvx.plots.face_layout import face_layout
from vemcvx.plots.palette import SLIP, STICK
from vemcvx.plots.units import Units, instant
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

REACH = 1.15


def friction_disc(history: Results, step: int = -1, *, ax: Axes | None = None, units: Units | None = None) -> Figure:
    """Draw the friction on the body at every contact node over its bound, as points in the unit disc.

    Parameters
    ----------
    history, step, ax, units : as of `friction_traction`

    Raises
    ------
    HistoryError
        The body is plane, has no contact or no friction at that step, or contact goes round it.
    """
    row, layout, contact = history.row(step), face_layout(history, "friction_disc"), history.contact
    rubs = contact.bound[row] > 0
    if not rubs.any():
        raise HistoryError(f"friction_disc: there is no friction at step {history.stored[row]}; draw another step.")
    share = layout.flat(contact.traction[row, rubs]) / contact.bound[row, rubs, None]
    sticks = contact.sticking[row, rubs]
    ax = axes_or_new(ax, 5.0, 5.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 241)
    ax.plot(np.cos(angle), np.sin(angle), "--", color="black", linewidth=1.2, label="bound", zorder=2)
    for chosen, colour, marker, word in ((sticks, STICK, "o", "sticks"), (~sticks, SLIP, "s", "slips")):
        if chosen.any():
            ends = np.zeros((chosen.sum(), 3, 2))
            ends[:, 1], ends[:, 2] = share[chosen], np.nan
            ax.plot(*ends.reshape(-1, 2).T, color=colour, linewidth=0.5, alpha=0.35, zorder=1.5)
            ax.plot(*share[chosen].T, marker, color=colour, markersize=4, label=word, zorder=3)
    ax.set(xlim=(-REACH, REACH), ylim=(-REACH, REACH), aspect="equal")
    ax.set(xlabel=f"friction on the body / bound, along {layout.labels[0]}", ylabel=f"along {layout.labels[1]}")
    ax.set_title(
        f"{instant(history.times[row], units)}: {sticks.sum()} contact nodes stick, {(~sticks).sum()} slip",
        fontsize="small",
    )
    light_grid(ax)
    legend_under(ax)
    return figure_of(ax)
