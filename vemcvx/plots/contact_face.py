"""Which part of a face of contact in space sticks, which slips and where to; pressure, friction and wear on it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arguments import choice
from vemcvx.arrays import Floats, Ints
from vemcvx.canvas import axes_or_new, colour_bar, draw_arrows, draw_polygons, figure_of, legend_under
from vemcvx.errors import HistoryError
from vemcvx.plots.face_layout import FaceLayout, apart, face_layout
from vemcvx.plots.palette import OPEN_AREA, SIZE, SLIP, SLIP_AREA, STICK_AREA
from vemcvx.plots.scale import value_range
from vemcvx.plots.units import Units, instant, unit
from vemcvx.results.contact import Contact
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Window = tuple[tuple[float, float], tuple[float, float]]
AREAS = {"sticks": STICK_AREA, "slips": SLIP_AREA, "is open": OPEN_AREA}
STICKS, SLIPS, OPEN = range(3)
STATES = "states"
FIELDS: dict[str, tuple[str, str, Callable[[Contact], Floats]]] = {
    "pressure": ("force per area", "contact pressure", lambda contact: contact.pressure),
    "friction": ("force per area", "friction", lambda contact: np.linalg.norm(contact.traction, axis=2)),
    "wear": ("energy per area", "friction work", lambda contact: contact.wear),
}
LONGEST, MOST = 0.085, 14
"""The longest arrow as part of the picture's size, and how many there are across it, about."""


def contact_face(
    history: Results,
    step: int = -1,
    *,
    ax: Axes | None = None,
    show: str = STATES,
    window: Window | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the face of contact of a body in space at a stored step, seen along its normal.

    Parameters
    ----------
    history, step, ax, units : as of `friction_traction`
    show : {"states", "pressure", "friction", "wear"}
        What colours say: what nodes do, or how large these are.
    window : ((low, high), (low, high)), optional
        Draw this part only, in units of length.
    limits : (low, high), optional
        Ends of the colour scale of what has one; by default the same for all stored steps.

    Returns
    -------
    matplotlib Figure
        Colours are those of the part of the face that each node owns; arrows are the slip since the last
        stored step, the longest as the title says.

    Raises
    ------
    HistoryError
        The body is plane, has no contact, or contact goes round it; or nothing of that name can be shown.
    """
    row, layout = history.row(step), face_layout(history, "contact_face")
    choice(show, "contact_face", "show", [STATES, *FIELDS], HistoryError)
    ax = axes_or_new(ax, 6.0, 5.0)
    if show == STATES:
        _colour_states(ax, layout, _states(history, row))
    else:
        quantity, words, values = FIELDS[show]
        field = values(history.contact)
        scale = value_range(limits, (min(0.0, float(field.min())), float(field.max()) or 1.0))
        drawn = draw_polygons(ax, layout.corners, None)
        drawn.set_array(field[row, layout.owners])
        drawn.set(cmap=SIZE, clim=scale)
        colour_bar(ax, drawn, f"{words} ({unit(units, quantity)})")
    largest = _arrows(ax, history, row, layout, window)
    length = unit(units, "length")
    ax.set(xlabel=f"{layout.labels[0]} ({length})", ylabel=f"{layout.labels[1]} ({length})", aspect="equal")
    ax.locator_params(nbins=5)
    if window is None:
        ax.autoscale_view()
    else:
        ax.set(xlim=window[0], ylim=window[1])
    last = row > 0 and history.stored[row - 1] == history.stored[row] - 1
    moved = f", slip {'of the step' if last else 'since the last stored step'} at most {largest:.3g}" if largest else ""
    ax.set_title(f"{instant(history.times[row], units)}{moved}", fontsize="small")
    return figure_of(ax)


def _colour_states(ax: Axes, layout: FaceLayout, states: Ints) -> None:
    """Colour what nodes do, and say which colour is what."""
    colours = list(AREAS.values())
    draw_polygons(ax, layout.corners, [colours[state] for state in states[layout.owners]])
    for state, (words, colour) in enumerate(AREAS.items()):
        if (states == state).any():
            ax.plot([], [], "s", color=colour, markeredgecolor="0.6", markersize=8, label=words)
    legend_under(ax)


def _states(history: Results, row: int) -> Ints:
    """(m,) what each contact node does."""
    return np.where(apart(history)[row], OPEN, np.where(history.contact.sticking[row], STICKS, SLIPS))


def _arrows(ax: Axes, history: Results, row: int, layout: FaceLayout, window: Window | None) -> float:
    """Draw how far nodes slipped since the last stored step; returns the largest, 0 if none did."""
    if row == 0:
        return 0.0
    low, high = np.transpose(window) if window is not None else (-np.inf, np.inf)
    shown = np.flatnonzero(
        (_states(history, row) == SLIPS) & ((layout.places >= low) & (layout.places <= high)).all(axis=1)
    )
    moved = layout.flat(history.contact.slip[row] - history.contact.slip[row - 1])[shown]
    largest = float(np.linalg.norm(moved, axis=1).max(initial=0.0))
    if largest == 0.0:
        return 0.0
    places = layout.places[shown]
    size = float(np.ptp(layout.places if window is None else np.transpose(window), axis=0).max())
    # One in each square of a grid, so that what is left out is left out evenly.
    squares = np.floor((places - places.min(axis=0)) * MOST / size + 0.5)
    _, kept = np.unique(squares, axis=0, return_index=True)
    arrows = moved[kept] * LONGEST * size / largest
    draw_arrows(ax, places[kept], arrows, colour=SLIP, pivot="mid", width=0.005).set_in_layout(False)
    return largest
