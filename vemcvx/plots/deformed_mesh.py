"""The deformed body, coloured by the size of its displacement, with the friction forces that act on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats
from vemcvx.canvas import axes_or_new, bar_beside, draw_arrows, figure_of, legend_below
from vemcvx.meshes import plane_mesh
from vemcvx.plots.contact_line import contact_line
from vemcvx.plots.palette import OUTLINE, SLIP, STICK
from vemcvx.plots.scale import common_magnification, extent, value_range
from vemcvx.plots.units import Units, instant, unit
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MOST_ARROWS = 10
OFFSET = 0.05
"""Distance of the arrows from the contact boundary, as part of the body's size."""


def deformed_mesh(
    history: Results,
    step: int = -1,
    *,
    ax: Axes | None = None,
    magnify: float | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the mesh deformed at a stored step.

    Magnification, colours, arrows and the part of the plane that is shown are the same at all steps.

    Parameters
    ----------
    history, step, ax : as of `friction_traction`
    magnify : float, optional
        How many times larger displacements are drawn than they are; by default 1, 2 or 5 times a power of ten.
    limits : (low, high), optional
        Ends of the colour scale; by default 0 and the largest |u| of all stored steps.
    units : mapping of str to str, optional
        Names of units, such as {"length": "mm", "force": "N", "time": "s"}: see :mod:`vemcvx.plots.units`.

    Returns
    -------
    matplotlib Figure
        Cells are coloured by the mean of |u| at their vertices; the dashed line is the undeformed outline; arrows are
        the friction forces per length on the body at contact nodes.
    """
    row, mesh = history.row(step), plane_mesh(history.mesh, "deformed_mesh", "deformed_body draws it")
    factor = common_magnification(history, _size(history), magnify)
    u = history.displacement[row]
    ax = axes_or_new(ax, *size_of_page(history))
    mesh.plot(ax=ax, displacement=factor * u, linewidth=_line(mesh.n_cells), edgecolor="0.75")
    cells = ax.collections[-1]
    cells.set_array(cell_means(history, np.linalg.norm(u, axis=1)))
    cells.set(cmap="viridis", clim=value_range(limits, (0.0, _largest_mean(history))))
    length = unit(units, "length")
    bar_beside(ax, cells).set_label(f"$|u|$ ({length})")
    _outline(ax, history)
    title = f"{instant(history.times[row], units)}, displacements magnified {factor:g} times"
    if len(history.contact.nodes):
        largest = _arrows(ax, history, row, factor)
        force = unit(units, "force per length")
        title += f"\narrows: friction on the body, at most {largest:.3g} ({force})"
    ax.set(xlabel=f"$x_1$ ({length})", ylabel=f"$x_2$ ({length})")
    ax.set_title(title, fontsize="medium")
    ax.update_datalim(extent(history, factor))
    ax.autoscale_view()
    legend_below(ax)
    return figure_of(ax)


def _largest_mean(history: Results) -> float:
    """The largest colour of all stored steps; 1 where nothing moves."""
    return max(float(cell_means(history, np.linalg.norm(u, axis=1)).max()) for u in history.displacement) or 1.0


def cell_means(history: Results, at_nodes: Floats) -> Floats:
    """(n_cells,) means of nodal values (n_nodes,) over the vertices of each cell."""
    mesh = plane_mesh(history.mesh, "deformed_mesh")
    return np.add.reduceat(at_nodes[mesh.vertices], mesh.offsets[:-1]) / np.diff(mesh.offsets)


def _size(history: Results) -> float:
    return float(np.ptp(history.mesh.points, axis=0).max())


def size_of_page(history: Results) -> tuple[float, float]:
    """Width and height, in inches, of a page for the body, its title and its legend."""
    width, height = np.ptp(history.mesh.points, axis=0)
    return 6.0, 1.6 + 4.2 * float(np.clip(height / width, 0.2, 1.6))


def _line(cells: int) -> float:
    """Thin enough that the lines do not hide the colours."""
    return float(np.clip(12.0 / np.sqrt(cells), 0.0, 0.5)) if cells < 40_000 else 0.0


def _outline(ax: Axes, history: Results) -> None:
    ends = history.mesh.points[history.mesh.boundaries["boundary"]]
    lines = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
    ax.plot(*lines.T, color=OUTLINE, linewidth=0.8, linestyle="--", label="undeformed", zorder=2.5)


def _arrows(ax: Axes, history: Results, row: int, factor: float) -> float:
    """Friction at contact nodes evenly apart; returns the largest on any node at this step.

    Arrows are just outside the body; between bodies they are just inside both of them, and opposite.
    """
    contact, line = history.contact, contact_line(history, "deformed_mesh")
    places = np.linspace(line.position[0], line.position[-1], MOST_ARROWS)
    shown = line.order[np.unique(np.abs(line.position[:, None] - places).argmin(axis=0))]
    size, points = _size(history), history.mesh.points + factor * history.displacement[row]
    partners, margin = contact.partners[shown], OFFSET * size * contact.normals[shown]
    joined = partners >= 0
    centres = points[contact.nodes[shown]] + np.where(joined[:, None], -margin, margin)
    centres = np.concatenate([centres, points[partners[joined]] + margin[joined]])
    # Lengths do not depend on the step: the nodes' places do not, and the largest force is that of all steps.
    spacing = np.linalg.norm(np.diff(contact.points[shown], axis=0), axis=1).min(initial=0.1 * size)
    sizes = np.linalg.norm(contact.traction, axis=2).max(axis=1)
    forces = contact.traction[row, shown] * (0.9 * spacing / sizes.max() if sizes.any() else 1.0)
    forces = np.concatenate([forces, -forces[joined]])
    sticks = contact.sticking[row, np.append(shown, shown[joined])]
    for chosen, colour, word in ((sticks, STICK, "sticks"), (~sticks, SLIP, "slips")):
        if chosen.any():
            draw_arrows(ax, centres[chosen], forces[chosen], colour=colour, pivot="mid", width=0.006)
        ax.plot([], [], color=colour, linewidth=3, label=word)
    for corner in extent(history, factor):
        ax.update_datalim(corner + margin)
    return float(sizes[row])
