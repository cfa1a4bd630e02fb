"""Computed values as marks on the line that a closed form draws: agreement, or the lack of it, at a glance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.canvas import light_grid
from vemcvx.plots.palette import COMPUTED, EXACT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_MARKS = 60


def beside_closed_form(
    ax: Axes,
    computed: tuple[ArrayLike, ArrayLike],
    exact: tuple[ArrayLike, ArrayLike],
    *,
    colour: str = COMPUTED,
    marker: str = "o",
    label: str = "computed",
    exact_label: str | None = "closed form",
    style: str = "-",
) -> Axes:
    """Add one pair: marks (x, y) computed, and the line (x, y) of the closed form.

    Of more than `MOST_MARKS` marks, evenly many are drawn. With ``exact_label=None`` the
    legend shows marks and line together, by the name of the marks.
    """
    x, y = (np.asarray(values, dtype=float) for values in computed)
    shown = np.unique(np.linspace(0, len(x) - 1, MOST_MARKS).round().astype(int)) if len(x) > MOST_MARKS else ...
    line = EXACT if colour == COMPUTED else colour
    ax.plot(*exact, style, color=line, linewidth=1.3, label=exact_label, zorder=2)
    marks: dict[str, Any] = {"marker": marker, "color": colour, "markersize": 4, "alpha": 0.85}
    ax.plot(x[shown], y[shown], linestyle="none", **marks, zorder=3, label=label if exact_label else None)
    if exact_label is None:
        # The line has no name of its own: the legend shows it through the marks.
        ax.plot([], [], linestyle=style, linewidth=1.3, **marks, label=label)
    light_grid(ax)
    ax.legend(frameon=False, fontsize="small")
    return ax
