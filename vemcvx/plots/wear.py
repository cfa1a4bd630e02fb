"""How friction wears the contact boundary: the depth worn off is in proportion to friction work (Archard 1953)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.canvas import axes_or_new, figure_of, legend_below, light_grid
from vemcvx.errors import HistoryError
from vemcvx.plots.contact_line import contact_line
from vemcvx.plots.palette import EARLY_TO_LATE
from vemcvx.plots.scale import value_range
from vemcvx.plots.units import Units, instant, unit
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = len(EARLY_TO_LATE)


def wear(
    history: Results,
    steps: Sequence[int] | None = None,
    *,
    ax: Axes | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the friction work per length of the contact boundary that was done until some steps.

    Parameters
    ----------
    history, ax, units : as of `friction_traction`
    steps : sequence of int, optional
        Stored steps, at most `MOST`; by default as many, evenly apart, the last among them.
    limits : (low, high), optional
        Ends of the axis of wear; by default from 0 to a little more than the largest of all steps.

    Raises
    ------
    HistoryError
        The history has no contact, or no step; or too many steps are asked for.
    """
    line = contact_line(history, "wear")
    later = history.stored[history.stored > 0]
    if len(later) == 0:
        raise HistoryError("wear: this history has no step after the initial instant.")
    evenly = later[np.unique(np.linspace(0, len(later), min(MOST, len(later)) + 1)[1:].round().astype(int)) - 1]
    rows = [history.row(step) for step in (evenly.tolist() if steps is None else steps)]
    if not 0 < len(rows) <= MOST:
        raise HistoryError(f"wear: found {len(rows)} steps; it draws 1 to {MOST} of them.")
    ax = axes_or_new(ax, 6.4, 3.6)
    for row, colour in zip(rows, EARLY_TO_LATE[-len(rows) :], strict=True):
        worn = line.broken(history.contact.wear[row, line.order])
        ax.plot(*worn, ".-", color=colour, linewidth=1.4, markersize=4, label=instant(history.times[row], units))
    top = 1.05 * float(history.contact.wear.max()) or 1.0
    ax.set(
        xlim=(line.limits.min(), line.limits.max()),
        ylim=value_range(limits, (0.0, top)),
        xlabel=f"{line.label} ({unit(units, 'length')})",
        ylabel=f"friction work\n({unit(units, 'energy per length')})",
    )
    ax.set_title("Wear of the contact boundary, in proportion to friction work", fontsize="medium")
    light_grid(ax)
    legend_below(ax)
    return figure_of(ax)
