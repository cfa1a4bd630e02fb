"""Where and when the contact boundary sticks or slips, and which way: a map over position and time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.canvas import axes_or_new, distinct, figure_of, legend_below
from vemcvx.errors import HistoryError
from vemcvx.plots.contact_line import ContactLine, apart, contact_line
from vemcvx.plots.palette import BACKWARD, FORWARD, STICK_AREA
from vemcvx.plots.units import Units, unit
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


STATES = ((-1, BACKWARD, "slip towards smaller {}"), (0, STICK_AREA, "stick"), (1, FORWARD, "slip towards larger {}"))


def stick_slip_map(history: Results, *, ax: Axes | None = None, units: Units | None = None) -> Figure:
    """Draw, for every contact node and stored step, whether it sticks or slips and which way.

    A step fills the time from the stored instant before it to its own. Where steps between the two were not stored, the
    band still shows its last step alone, and the title says so.

    Parameters
    ----------
    history, ax, units : as of `friction_traction`

    Raises
    ------
    HistoryError
        The history has no contact, or no step.
    """
    line = contact_line(history, "stick_slip_map")
    steps = history.stored[history.stored > 0]
    if len(steps) == 0:
        raise HistoryError("stick_slip_map: this history has no step after the initial instant.")
    times, states = history.trajectory.times, directions(history, line)
    ax = axes_or_new(ax, 6.4, 4.2)
    edges = times[np.concatenate([[0], steps])]
    colours = distinct([colour for _, colour, _ in STATES])
    ax.pcolormesh(line.limits.ravel(), edges, _with_gaps(states), cmap=colours, vmin=-1.5, vmax=1.5)
    for state, colour, words in STATES:
        if (states == state).any():
            ax.plot([], [], "s", markersize=9, color=colour, label=words.format(line.symbol))
    missing = history.steps - len(steps)
    ax.set(
        ylim=(edges[0], edges[-1]),
        xlabel=f"{line.label} ({unit(units, 'length')})",
        ylabel=f"t ({unit(units, 'time')})",
    )
    bands = f"\neach band: its last step ({missing} of {history.steps} steps not stored)" if missing else ""
    ax.set_title("Stick and slip on the contact boundary" + bands, fontsize="medium")
    legend_below(ax)
    return figure_of(ax)


def directions(history: Results, line: ContactLine) -> Floats:
    """0 where a node sticks, 1 or -1 where it slips towards larger or smaller positions; a row a stored step > 0.

    NaN where contact is open, and nothing rubs.

    Friction opposes the slip of its step, whether or not the step before is stored; where there is no friction
    the slip since the last stored step tells.
    """
    contact, rows = history.contact, history.stored > 0
    against = line.along(contact.traction)
    moved = np.diff(line.along(contact.slip), axis=0, prepend=0.0)
    way = np.sign(np.where(against == 0.0, moved, -against))
    way = np.where(contact.sticking[:, line.order], 0.0, way)
    return np.where(apart(history, line), np.nan, way)[rows]


def _with_gaps(states: Floats) -> Floats:
    """Columns of NaN between those of `states`: what no node owns."""
    rows, columns = states.shape
    whole = np.full((rows, 2 * columns - 1), np.nan)
    whole[:, ::2] = states
    return whole
