"""Pictures of energies and forces over a run, image files, and films."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vemcvx.base import canvas
from vemcvx.base.arrays import Floats, brief, choice
from vemcvx.base.errors import HistoryError
from vemcvx.base.owned_files import path_of
from vemcvx.meshes import PolyhedralMesh
from vemcvx.plots import contact, faces, style
from vemcvx.plots.body import MISSING, deformed_body, deformed_mesh, has_pyvista, size_of_page, stressed_body
from vemcvx.plots.contact import along_contact, pressures, slips
from vemcvx.plots.style import Units, instant, label, label_axes, positive, unit, units_of
from vemcvx.results import Results, loop_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def energy_ledger(history: Results, *, ax: Axes | None = None, units: Units | None = None) -> Figure:
    """Draw the energies of every step and, on a logarithmic axis, the certificates of the steps.

    Parameters
    ----------
    history, units : as for `friction_traction`
    ax : Axes, optional
        Axes for the energies alone; by default, a new figure also shows the certificates.

    Returns
    -------
    matplotlib Figure
        Work, stored energy, dissipated energy and the loss of time stepping; certificates in the second panel.

    Raises
    ------
    HistoryError
        The history has no step.

    Examples
    --------
    >>> figure = vx.plots.energy_ledger(history)
    """
    units = units_of(history, units)
    contact.list_steps(history, "energy_ledger")
    panels = canvas.row_of_axes(2, 3.8, 3.9) if ax is None else [ax]
    energy = unit(units, "energy")
    words = "energy" if energy == "energy" else f"energy ({energy})" + ", per thickness" * _is_plane(history)
    _energies(panels[0], history, words)
    for second in panels[1:]:
        _certificates(second, history)
    for panel in panels:
        panel.set_xlabel(label("t", "time", units))
        canvas.light_grid(panel)
        canvas.legend_under(panel, columns=2)
    return canvas.figure_of(panels[0])


def _energies(ax: Axes, history: Results, words: str) -> None:
    run = history.trajectory
    stored = run.energy - run.energy[0]
    lines = (
        (run.work, style.WORK, "-", "work done on the body"),
        (stored, style.STORED, "--", "stored" if run.energy[0] == 0 else "stored since the start"),
        (run.dissipated, style.DISSIPATED, "-.", "dissipated by friction"),
        (run.work - stored - run.dissipated, style.NUMERICAL, ":", "lost by time stepping"),
    )
    for values, colour, line, name in lines:
        ax.plot(run.times, values, line, color=colour, linewidth=1.6, label=name)
    if history.energy_bounds is not None:
        _bars(ax, run.times, history.energy_bounds - run.energy[0], style.STORED)
    ax.set(ylabel=words, title="Energy ledger")


def _bars(ax: Axes, x: Floats, between: Floats, colour: str) -> None:
    known = np.isfinite(between).all(axis=1)
    low, high = between[known].T
    bars: dict[str, Any] = {"fmt": "none", "ecolor": colour, "elinewidth": 1.4, "capsize": 2.5}
    ax.errorbar(x[known], 0.5 * (low + high), yerr=0.5 * (high - low), label="guaranteed bounds", **bars)


def _certificates(ax: Axes, history: Results) -> None:
    run = history.trajectory
    each, total = (run.certified, style.STORED, "o"), (run.certified_total, style.DISSIPATED, "-")
    ax.set(ylabel="relative energy error, at most", title="Certificate", yscale="log")
    for (values, colour, mark), words in ((each, "each step"), (total, "all steps so far")):
        shown = np.isfinite(values) & (values > 0)
        ax.plot(run.times[shown], values[shown], mark, color=colour, markersize=2.5, linewidth=1.4, label=words)


def hysteresis_loop(
    history: Results, on: str | None = None, *, ax: Axes | None = None, units: Units | None = None
) -> Figure:
    """Draw the force on a driven boundary against the mean motion of this boundary.

    Parameters
    ----------
    history, ax, units : as for `friction_traction`
    on : str, optional
        By default the driven boundary with the longest path. If no support moves, the default is the
        boundary of the load that changes most.

    Returns
    -------
    matplotlib Figure
        The loop along one axis, with marks at the first and last instant, and `history.force_bounds` as bars.

    Raises
    ------
    SceneError, HistoryError
        There is no boundary of this name, or no driven boundary.

    Examples
    --------
    >>> figure = vx.plots.hysteresis_loop(history, on="top")
    """
    units = units_of(history, units)
    if (loop := loop_of(history, on)) is None:
        names = ", ".join(map(repr, history.mesh.boundaries))
        raise HistoryError(f"hysteresis_loop: no driven boundary is known; give on=, one of {names}.")
    name, axis, u, force = loop.on, loop.axis, loop.motion, loop.force
    ax = canvas.axes_or_new(ax, 6.0, 4.4)
    ax.plot(u, force, ".-", color=style.DISSIPATED, linewidth=1.4, markersize=4)
    if history.force_bounds is not None and history.bounded_force == {name: axis}:
        _bars(ax, u, history.force_bounds[history.stored], style.NUMERICAL)
    for row, mark in ((0, "o"), (-1, "s")):
        when = instant(history.times[row], units)
        ax.plot(u[row], force[row], mark, color=style.WORK, fillstyle="none", markersize=8, label=when)
    canvas.light_grid(ax)
    ax.locator_params(axis="x", nbins=6)  # Labels of small numbers are long.
    canvas.legend_below(ax)
    x = label(f"mean motion of {name} along $x_{axis + 1}$", "length", units)
    y = label(loop.kind, "force", units) + ", per thickness" * _is_plane(history)
    return label_axes(ax, x, y, f"{loop.kind.capitalize()} of {name} along $x_{axis + 1}$ against its motion")


def forces_over_time(history: Results, *, ax: Axes | None = None, units: Units | None = None) -> Figure:
    """Draw the forces on named boundaries over time, one curve per component.

    Parameters
    ----------
    history, ax, units : as for `friction_traction`

    Returns
    -------
    matplotlib Figure
        The eight largest components of `History.resultants`, without components below 1 % of the largest component.

    Raises
    ------
    HistoryError
        No force acts on a named boundary.

    Examples
    --------
    >>> figure = vx.plots.forces_over_time(history)
    """
    units = units_of(history, units)
    curves = {
        f"{name}, $x_{axis + 1}$": values[:, axis]
        for name, values in history.resultants.items()
        for axis in range(values.shape[1])
    }
    sizes = {name: float(np.abs(values).max()) for name, values in curves.items()}
    most = max(sizes.values(), default=0.0)
    if most == 0:
        raise HistoryError("forces_over_time: no force acts on a named boundary.")
    shown = [name for name in sorted(sizes, key=lambda one: -sizes[one]) if sizes[name] > 0.01 * most]
    ax = canvas.axes_or_new(ax, 6.0, 4.4)
    for name, colour, mark in zip(shown, style.SERIES, style.MARKERS, strict=False):
        ax.plot(history.times, curves[name], marker=mark, color=colour, linewidth=1.4, markersize=3, label=name)
    canvas.light_grid(ax)
    canvas.legend_under(ax, columns=2)
    y = label("force", "force", units) + ", per thickness" * _is_plane(history)
    return label_axes(ax, label("t", "time", units), y, "Forces on boundaries")


def _draw_stress(history: Results, units: Units | None = None) -> Figure:
    return stressed_body(history, stress="shear" if history.out_of_plane is None else "von_mises", units=units)


def _is_plane(history: Results) -> bool:
    return not isinstance(history.mesh, PolyhedralMesh)


def _has_steps(history: Results) -> bool:
    return bool((history.stored > 0).any())


def _has_faces(history: Results) -> bool:
    return not _is_plane(history) and len(history.contact.nodes) > 0 and bool(faces.contact_faces(history))


def _has_line(history: Results) -> bool:
    return _is_plane(history) and len(history.contact.nodes) > 0 and _has_steps(history)


PICTURES: dict[str, tuple[Callable[..., Figure], Callable[[Results], bool | np.bool_]]] = {
    "deformed_mesh": (deformed_mesh, _is_plane),
    "stressed_body": (_draw_stress, _is_plane),
    "contact_pressure": (partial(along_contact, show="pressure"), lambda h: _has_line(h) and pressures(h).any()),
    "contact_slip": (partial(along_contact, show="slip"), lambda h: _has_line(h) and slips(h).any()),
    "friction_traction": (contact.friction_traction, lambda h: _is_plane(h) and h.contact.has_friction),
    "stick_slip_map": (contact.stick_slip_map, _has_line),
    "wear": (partial(along_contact, show="wear"), lambda h: _is_plane(h) and _has_steps(h) and h.contact.wear.any()),
    "deformed_body": (deformed_body, lambda h: not _is_plane(h) and has_pyvista()),
    "contact_face": (faces.contact_face, _has_faces),
    "hysteresis_loop": (hysteresis_loop, lambda h: _has_steps(h) and loop_of(h) is not None),
    "forces_over_time": (forces_over_time, lambda h: _has_steps(h) and any(f.any() for f in h.resultants.values())),
    "energy_ledger": (energy_ledger, _has_steps),
}
"""Name of a picture -> function that draws the picture, and condition for drawing."""
SUFFIXES = ".png", ".svg", ".pdf"


def omissions(history: Results) -> list[str]:
    """Return a sentence for each picture of a body in space that cannot be drawn."""
    if _is_plane(history):
        return []
    around = len(history.contact.nodes) > 0 and not _has_faces(history)
    return [f"deformed_body: {MISSING}"] * (not has_pyvista()) + [f"contact_face: {faces.HIDDEN}"] * around


def write_plots(
    history: Results, folder: str | Path, suffix: str = ".png", *, units: Units | None = None
) -> list[Path]:
    """Write all pictures of a history, and remove older pictures with the same suffix.

    Parameters
    ----------
    history, units : as for `friction_traction`
    folder : str or Path
        Created if it does not exist.
    suffix : {".png", ".svg", ".pdf"}
        The kind of file.

    Returns
    -------
    list of Path
        The written files.

    Raises
    ------
    HistoryError
        The suffix is unknown, or the folder cannot be written to.
    VemcvxError
        matplotlib is not installed.

    Examples
    --------
    >>> paths = vx.plots.write_plots(history, "pictures")
    """
    folder = path_of(folder, "write_plots")
    suffix = choice(suffix, "write_plots", "suffix", list(SUFFIXES), HistoryError)
    drawn = draw_pictures(history, units)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in PICTURES:
            (folder / f"{name}{suffix}").unlink(missing_ok=True)
        for name, figure in drawn.items():
            figure.savefig(folder / f"{name}{suffix}", dpi=200)
    except OSError as error:
        raise HistoryError(f"{folder}: cannot write pictures there: {error}.") from error
    return [folder / f"{name}{suffix}" for name in drawn]


def draw_pictures(history: Results, units: Units | None) -> dict[str, Figure]:
    """Draw all pictures of a history, and return the figures by name."""
    return {name: draw(history, units=units) for name, (draw, shows) in PICTURES.items() if shows(history)}


def animate(
    history: Results,
    path: str | Path,
    *,
    seconds: float = 5.0,
    magnify: float | None = None,
    units: Units | None = None,
) -> Path:
    """Write a film of the deformed mesh over all stored steps.

    Parameters
    ----------
    history : History
    path : str or Path
        ``.gif`` or ``.mp4`` (if ffmpeg is installed). An existing file is replaced.
    seconds : float
        Approximate duration of the film.
    magnify, units : as for `deformed_mesh`

    Returns
    -------
    Path
        The file.

    Raises
    ------
    SceneError, HistoryError
        The suffix is unknown, an argument is invalid, or the file cannot be written.
    VemcvxError
        matplotlib, or ffmpeg for .mp4, is not installed.

    Examples
    --------
    >>> path = vx.plots.animate(history, "film.gif", seconds=1.0)
    """
    path = path_of(path, "animate")
    kinds = {".gif": "pillow", ".mp4": "ffmpeg"}
    if path.suffix not in kinds:
        raise HistoryError(f"animate: found {brief(str(path))}; films end in .gif or .mp4.")
    length = positive(seconds, "animate: found seconds =", "a positive number")
    rate = round(min(max(len(history.stored) / length, 1.0), 50.0))
    figure = canvas.new_figure(*size_of_page(history))
    writer = canvas.film_writer(kinds[path.suffix], rate)
    frames = _frames(history, figure, magnify=magnify, units=units)
    # Wrong arguments raise errors before an existing file is replaced.
    next(frames)
    try:
        with writer.saving(figure, path, 110):
            writer.grab_frame()
            for _ in frames:
                writer.grab_frame()
    except OSError as error:
        raise HistoryError(f"{path}: cannot write a film there: {error}.") from error
    return path


def _frames(history: Results, figure: Figure, **how: Any) -> Iterator[None]:
    draw = deformed_mesh if _is_plane(history) else deformed_body
    for step in history.stored:
        figure.clear()
        draw(history, int(step), ax=figure.add_subplot(), **how)
        yield
