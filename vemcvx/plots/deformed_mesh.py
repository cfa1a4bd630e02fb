"""The deformed body, coloured by the size of its displacement, with the friction forces that act on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.canvas import draw_arrows, new_figure
from vemcvx.plots.contact_line import contact_line
from vemcvx.plots.palette import OUTLINE, SLIP, STICK
from vemcvx.results.history import History

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


SHOWN = 0.15
"""Displacements are magnified to about this part of the body's size at most."""
MOST_ARROWS = 10
OFFSET = 0.05
"""Distance of the arrows from the contact boundary, as part of the body's size."""


def deformed_mesh(history: History, step: int = -1) -> Figure:
    """Draw the mesh deformed at a stored step.

    Parameters
    ----------
    history : History
    step : int
        A stored step; negative ones count from the end.

    Returns
    -------
    matplotlib Figure
        Cells are coloured by the mean of |u| at their vertices. Displacements are magnified by 1, 2 or 5 times
        a power of ten, as the title says; arrows are the friction forces per length on the body at contact nodes.
    """
    row, mesh = history.row(step), history.mesh
    u = history.displacement[row]
    factor = magnification(u, _size(history))
    figure = new_figure(6.0, 1.6 + 4.2 * _slenderness(mesh.points))
    ax = mesh.plot(ax=figure.add_subplot(), displacement=factor * u, linewidth=_line(mesh.n_cells), edgecolor="0.75")
    cells = ax.collections[0]
    size = cell_means(history, np.linalg.norm(u, axis=1))
    cells.set_array(size)
    cells.set(cmap="viridis", clim=(0.0, size.max() or 1.0))
    # In axes of its own beside these, the bar stays as high as the body's frame, whatever its shape.
    figure.colorbar(cells, cax=ax.inset_axes((1.04, 0.0, 0.045, 1.0)), label="$|u|$ (units of length)")
    _outline(ax, history)
    title = f"t = {history.times[row]:.4g}, displacements magnified {factor:g} times"
    if len(history.contact.nodes):
        largest = _arrows(ax, history, row, mesh.points + factor * u)
        title += f"\narrows: friction on the body, at most {largest:.3g} (force per length)"
    ax.set(xlabel="$x_1$ (units of length)", ylabel="$x_2$ (units of length)")
    ax.set_title(title, fontsize="medium")
    ax.autoscale_view()
    figure.legend(loc="outside lower center", ncols=3, frameon=False)
    return figure


def magnification(u: Floats, size: float) -> float:
    """1, 2 or 5 times a power of ten that makes the largest displacement SHOWN of `size`, or a little less."""
    largest = float(np.linalg.norm(u, axis=1).max())
    if largest == 0.0:
        return 1.0
    wanted = SHOWN * size / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    # Powers of ten are rounded: 1 + 1e-9 keeps a wanted 5 from becoming 2.
    return float(max(f for f in (power, 2 * power, 5 * power) if f <= wanted * (1 + 1e-9)))


def cell_means(history: History, at_nodes: Floats) -> Floats:
    """(n_cells,) means of nodal values (n_nodes,) over the vertices of each cell."""
    mesh = history.mesh
    return np.add.reduceat(at_nodes[mesh.vertices], mesh.offsets[:-1]) / np.diff(mesh.offsets)


def _size(history: History) -> float:
    return float(np.ptp(history.mesh.points, axis=0).max())


def _slenderness(points: Floats) -> float:
    """Height over width, within what fits on a page."""
    width, height = np.ptp(points, axis=0)
    return float(np.clip(height / width, 0.2, 1.6))


def _line(cells: int) -> float:
    """Thin enough that the lines do not hide the colours."""
    return float(np.clip(12.0 / np.sqrt(cells), 0.0, 0.5)) if cells < 40_000 else 0.0


def _outline(ax: Axes, history: History) -> None:
    ends = history.mesh.points[history.mesh.boundaries["boundary"]]
    lines = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
    ax.plot(*lines.T, color=OUTLINE, linewidth=0.8, linestyle="--", label="undeformed")


def _arrows(ax: Axes, history: History, row: int, points: Floats) -> float:
    """Friction at contact nodes evenly apart, just outside the body; returns the largest on any node."""
    contact, line = history.contact, contact_line(history, "deformed_mesh")
    places = np.linspace(line.position[0], line.position[-1], MOST_ARROWS)
    shown = line.order[np.unique(np.abs(line.position[:, None] - places).argmin(axis=0))]
    size, largest = _size(history), float(np.linalg.norm(contact.traction[row], axis=1).max())
    centres = points[contact.nodes[shown]] + OFFSET * size * contact.normals[shown]
    spacing = np.linalg.norm(np.diff(centres, axis=0), axis=1).min(initial=0.1 * size)
    forces = contact.traction[row, shown] * (0.9 * spacing / largest if largest else 1.0)
    sticks = contact.sticking[row, shown]
    for chosen, colour, word in ((sticks, STICK, "sticks"), (~sticks, SLIP, "slips")):
        if chosen.any():
            draw_arrows(ax, centres[chosen], forces[chosen], colour=colour, pivot="mid", width=0.006)
            ax.plot([], [], color=colour, linewidth=3, label=word)
    ax.update_datalim(centres)
    return largest
