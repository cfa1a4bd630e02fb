"""What pictures of problems share: the stressed body beside a graph, and marks on the line of a closed form."""

import numpy as np

from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots import contact_face, stressed_body
from vemcvx.plots.style import COMPUTED, EXACT, SLIP, STICK

MM = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
"""Names of units, in the plane for a body 1 mm thick; problems that have others say so."""
STUCK = {"linestyle": "none", "marker": "o", "color": STICK}
SLID = {"linestyle": "none", "marker": "s", "color": SLIP, "fillstyle": "none"}
"""Marks of nodes that stick and slip, full and empty for print in grey."""
MOST_MARKS = 60
SLENDER = 0.2
"""Height over width below which the body is drawn above the graph, not beside it."""


def body_and_graph(history, *, window=None, stretch=1.0, shares=(1.0, 1.0), units=MM, **how):
    """Return a figure with the stressed body, and axes beside it (below it, if it is slender) for a graph.

    Options are those of `stressed_body`; `shares` divides the figure between body and graph.
    """
    width, height = np.ptp(history.mesh.points, axis=0) if window is None else np.ptp(window, axis=1)
    slender = stretch * height < SLENDER * width
    figure = new_figure(8.4, 5.0) if slender else new_figure(9.4, 3.9)
    if slender:
        body, graph = figure.subplots(2, 1, height_ratios=shares)
    else:
        body, graph = figure.subplots(1, 2, width_ratios=shares)
    figure.set_layout_engine("constrained", w_pad=0.1)
    # Numbers of small steps are long, and run into each other where there are more.
    graph.locator_params(nbins=6)
    stressed_body(history, ax=body, window=window, stretch=stretch, units=units, **how)
    return figure, graph


def beside_closed_form(
    ax,
    computed,
    exact,
    *,
    colour=COMPUTED,
    marker=None,
    label="computed",
    exact_label="closed form",
    style="-",
):
    """Add one pair: marks (x, y) computed, and the line (x, y) of the closed form.

    Of more than `MOST_MARKS` marks, evenly many are drawn. With ``exact_label=None`` the
    legend shows marks and line together, by the name of the marks.
    """
    x, y = (np.asarray(values, dtype=float) for values in computed)
    shown = np.unique(np.linspace(0, len(x) - 1, MOST_MARKS).round().astype(int)) if len(x) > MOST_MARKS else ...
    line = EXACT if colour == COMPUTED else colour
    ax.plot(*exact, style, color=line, linewidth=1.3, label=exact_label, zorder=2)
    # A second pair has other marks, for print in grey.
    marker = marker or ("o" if colour == COMPUTED else "s")
    marks = {"marker": marker, "color": colour, "markersize": 4, "alpha": 0.85}
    ax.plot(x[shown], y[shown], linestyle="none", **marks, zorder=3, label=label if exact_label else None)
    if exact_label is None:
        # The line has no name of its own: the legend shows it through the marks.
        ax.plot([], [], linestyle=style, linewidth=1.3, **marks, label=label)
    light_grid(ax)
    ax.legend(frameon=False, fontsize="small")
    return ax


def face_and_graph(history, *, shares=(1.0, 1.0), units=MM, **how):
    """Return a figure with the face of contact in space, and axes beside it for a graph.

    Options are those of `contact_face`.
    """
    figure = new_figure(9.4, 3.9)
    face, graph = figure.subplots(1, 2, width_ratios=shares)
    contact_face(history, ax=face, units=units, **how)
    return figure, graph
