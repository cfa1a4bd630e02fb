"""The deformed body coloured by a stress, with the forces of contact that act on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Bools, Floats
from vemcvx.canvas import bar_beside, draw_arrows
from vemcvx.errors import HistoryError
from vemcvx.meshes import PolygonMesh, plane_mesh
from vemcvx.plots.palette import COMPRESSION, PUSH, SIGNED, SIZE, SLIP, STICK, TENSION
from vemcvx.plots.scale import common_magnification, value_range
from vemcvx.plots.units import Units, instant, unit
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
        Names of units: see :mod:`vemcvx.plots.units`.

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
    largest = _arrows(ax, history, row, mesh.points + factor * u, (forces, size, window, stretch))
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


def _arrows(
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
