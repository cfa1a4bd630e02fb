"""The deformed plane body: displacement, stress, forces of contact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Bools, Floats
from vemcvx.canvas import axes_or_new, bar_beside, draw_arrows, figure_of, legend_below
from vemcvx.errors import HistoryError
from vemcvx.meshes import PolygonMesh, plane_mesh
from vemcvx.plots.contact_in_plane import contact_line
from vemcvx.plots.style import (
    COMPRESSION,
    OUTLINE,
    PUSH,
    SIGNED,
    SIZE,
    SLIP,
    STICK,
    TENSION,
    Units,
    common_magnification,
    extent,
    instant,
    unit,
    value_range,
)
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# The deformed body, coloured by the size of its displacement, with the friction forces that act on it.


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
        Names of units, such as {"length": "mm", "force": "N", "time": "s"}: see :mod:`vemcvx.plots.style`.

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


# The deformed body coloured by a stress, with the forces of contact that act on it.


Window = tuple[tuple[float, float], tuple[float, float]]

STRESSES: dict[str, tuple[str, Callable[[Floats], Floats]]] = {
    "xx": (r"$\sigma_{11}$", lambda s: s[:, 0]),
    "yy": (r"$\sigma_{22}$", lambda s: s[:, 1]),
    "xy": (r"$\sigma_{12}$", lambda s: s[:, 2]),
    "mean": (r"$(\sigma_{11}+\sigma_{22})/2$", lambda s: 0.5 * (s[:, 0] + s[:, 1])),
    "shear": ("largest shear stress", lambda s: np.hypot(0.5 * (s[:, 0] - s[:, 1]), s[:, 2])),
}
UNSIGNED = {"shear"}
FORCES = ("contact", "friction", "none")
ONE_SIGN, UNIFORM = 0.1, 0.02
"""Stresses whose other sign stays below this part of the largest are drawn as of one sign; varying less, as uniform."""
# The corner of a clamp has no largest stress: colours end where all but one cell in a hundred are.
SHOWN_CELLS = 99.0
LONGEST, MOST, ASIDE = 0.13, 26, 0.03
"""Of the arrows: length as part of the body's (or the window's) size, number, and distance if they run along it."""


def stressed_body(
    ax: Axes,
    history: Results,
    *,
    step: int = -1,
    stress: str = "mean",
    forces: str = "contact",
    window: Window | None = None,
    stretch: float = 1.0,
    mirrors: Sequence[tuple[int, int]] = (),
    magnify: float | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Axes:
    """Draw the body on given axes.

    Parameters
    ----------
    ax : Axes
    history : History
    step : int
        A stored step; negative ones count from the end.
    stress : str
        Which: one of `STRESSES`. Tension is red and compression blue.
    forces : {"contact", "friction", "none"}
        Arrows of pressure and friction together, their heads on the body; of friction alone, beside it; or none. Blue
        where contact sticks, orange where it slips, grey without friction.
    window : ((x0, x1), (y0, y1)), optional
        Draw this part only, in units of length.
    stretch : float
        How many times longer lengths along x_2 are drawn: of slender bodies.
    mirrors : sequence of (1 or -1, 1 or -1)
        Signs of x_1 and x_2 in the images to be drawn, without mesh, of a body that is the half or quarter of a whole.
    magnify : float, optional
        How many times larger displacements are drawn than they are; by default one that suits all stored steps.
    limits : (low, high), optional
        Ends of the colour scale; by default the same for all stored steps.
    units : mapping of str to str, optional
        Names of units: see :mod:`vemcvx.plots.style`.

    Returns
    -------
    Axes
        Displacements are magnified, and forces (per length, on the body) at most, as the title says.

    Raises
    ------
    HistoryError
        There is no stress, or are no forces, of that name.
    """
    for name, found, known in (("stress", stress, STRESSES), ("forces", forces, FORCES)):
        if found not in known:
            raise HistoryError(f"stressed_body: found {name} = {found!r}; there are {', '.join(known)}.")
    row, mesh = history.row(step), plane_mesh(history.mesh, "stressed_body", "deformed_body draws it")
    u, (label, part) = history.displacement[row], STRESSES[stress]
    seen = _inside(mesh.centroids, window)
    size = float(np.ptp(mesh.points, axis=0).max() if window is None else max(np.ptp(window, axis=1)))
    factor = common_magnification(history, 0.5 * size, magnify, _inside(mesh.points, window))
    line = float(np.clip(9.0 / np.sqrt(seen.sum()), 0.0, 0.5))
    mesh.plot(ax=ax, displacement=factor * u, linewidth=line, edgecolor="0.35")
    cells = ax.collections[0]
    cells.set_array(part(history.stress(step)))
    stresses = [part(history.stress(int(n)))[seen] for n in history.stored]
    colours, ends = colours_of(stresses, stress in UNSIGNED)
    cells.set(cmap=colours, clim=value_range(limits, ends))
    for signs in mirrors:
        _image(ax, history, factor * u, signs)
    bar = bar_beside(ax, cells)
    bar.set_label(f"{label} ({unit(units, 'force per area')})", fontsize="small")
    largest = _contact_arrows(ax, history, row, mesh.points + factor * u, (forces, size, window, stretch))
    words = f", {'forces of contact' if forces == 'contact' else forces} at most {largest:.3g}" if largest else ""
    ax.set_title(f"{instant(history.times[row], units)}, displacements × {factor:g}{words}", fontsize="small")
    drawn = "" if stretch == 1.0 else f",\n× {stretch:g}"
    length = unit(units, "length")
    ax.set(xlabel=f"$x_1$ ({length})", ylabel=f"$x_2$ ({length}{drawn})", aspect=stretch)
    ax.tick_params(labelsize="small")
    if window is None:
        ax.autoscale_view()
    else:
        ax.set(xlim=window[0], ylim=window[1])
    return ax


def _inside(points: Floats, window: Window | None) -> Bools:
    if window is None:
        return np.ones(len(points), dtype=bool)
    low, high = np.transpose(window)
    within: Bools = ((points >= low) & (points <= high)).all(axis=1)
    return within


def _image(ax: Axes, history: Results, moved: Floats, signs: tuple[int, int]) -> None:
    """The body in the mirror, coloured like the body itself."""
    cells, mesh = ax.collections[0], plane_mesh(history.mesh, "stressed_body")
    # No orientation and no check is needed to draw cells; bodies in contact have nodes in the same places.
    PolygonMesh.unchecked((mesh.points + moved) * signs, mesh.offsets, mesh.vertices).plot(
        ax=ax,
        array=cells.get_array(),
        linewidth=0,
        antialiased=False,
        cmap=cells.get_cmap(),
        clim=cells.get_clim(),
    )


def colours_of(stresses: Sequence[Floats], unsigned: bool) -> tuple[str, tuple[float, float]]:
    """Colours for the stresses of all steps and their ends: of both signs about zero, or of one."""
    few = 100.0 - SHOWN_CELLS
    low = min(float(np.percentile(s, few)) for s in stresses)
    high = max(float(np.percentile(s, SHOWN_CELLS)) for s in stresses)
    top = max(float(np.percentile(np.abs(s), SHOWN_CELLS)) for s in stresses) or 1.0
    if max(float(np.ptp(s)) for s in stresses) < UNIFORM * top:
        # The end of a colour map is its darkest, or brightest: one stress everywhere is drawn in its middle.
        top *= 2.0
    if unsigned:
        return SIZE, (0.0, top)
    if low > -ONE_SIGN * top:
        return TENSION, (0.0, top)
    if high < ONE_SIGN * top:
        return COMPRESSION, (-top, 0.0)
    return SIGNED, (-top, top)


def _contact_arrows(
    ax: Axes, history: Results, row: int, places: Floats, how: tuple[str, float, Window | None, float]
) -> float:
    """Forces per length at contact nodes; returns the largest, 0 if there are none."""
    contact, (kind, size, window, stretch) = history.contact, how
    together = kind == "contact"
    force = contact.traction[row] - together * contact.pressure[row][:, None] * contact.normals
    seen = np.flatnonzero(_inside(contact.points, window))
    largest = float(np.linalg.norm(force[seen], axis=1).max(initial=0.0))
    # One length of arrows for all steps: the largest of them is as long as may be.
    every = contact.traction[:, seen] - together * contact.pressure[:, seen, None] * contact.normals[seen]
    most = float(np.linalg.norm(every, axis=2).max(initial=0.0))
    if largest == 0.0 or kind == "none":
        return 0.0
    # Along the boundary, so that what is left out is left out evenly.
    order = seen[np.argsort(contact.points[seen] @ [1.0, 1e-3])]
    shown = order[np.unique(np.linspace(0, len(order) - 1, MOST).round().astype(int))]
    heads, longest = places[contact.nodes[shown]], LONGEST * size
    if not together:
        longest = min(longest, 0.8 * np.linalg.norm(np.diff(heads, axis=0), axis=1).min(initial=longest))
        heads = heads + ASIDE * size * contact.normals[shown] / [1.0, stretch]
    arrows = force[shown] * longest / most / [1.0, stretch]
    slips = ~contact.sticking[row, shown]
    colours = np.where(slips, SLIP, STICK) if contact.bound.any() else PUSH
    drawn = draw_arrows(ax, heads, arrows, colour=colours, pivot="tip" if together else "mid", width=0.0055)
    drawn.set_in_layout(False)
    ax.update_datalim(np.concatenate([heads - arrows, heads]))
    return largest
