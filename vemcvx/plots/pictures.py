"""Pictures of a history, and its energies in time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import choice
from vemcvx.canvas import figure_of, light_grid, new_figure
from vemcvx.errors import HistoryError
from vemcvx.meshes import PolyhedralMesh
from vemcvx.owned_files import path_of
from vemcvx.plots.body_in_plane import deformed_mesh
from vemcvx.plots.body_in_space import MISSING, deformed_body, has_pyvista
from vemcvx.plots.contact_in_plane import friction_traction, stick_slip_map, wear
from vemcvx.plots.contact_in_space import contact_face, friction_disc, hidden, seen
from vemcvx.plots.style import DISSIPATED, NUMERICAL, STORED, WORK, Units, unit, value_range
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Where the work goes, and how certain the numbers are, over time.
#
#     work - (stored - stored at the start) - dissipated = numerical dissipation = sum over steps of 1/2 a(du, du) >= 0,
#
# what backward Euler loses beside friction; it goes to zero with the step.


def energy_ledger(
    history: Results,
    *,
    ax: Axes | Sequence[Axes] | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the energies of all steps, stored or not, and their certificates on a logarithmic axis.

    Parameters
    ----------
    history, units : as of `friction_traction`
    ax : Axes, or two of them, optional
        Where to draw the energies, and the certificates if there are two; by default on a new figure.
    limits : (low, high), optional
        Ends of the axis of energies.

    Raises
    ------
    HistoryError
        The history has no step.
    """
    if history.steps == 0:
        raise HistoryError("energy_ledger: this history has no step after the initial instant.")
    given = new_figure(7.6, 3.9).subplots(1, 2) if ax is None else ax
    panels = list(given) if isinstance(given, Iterable) else [given]
    _energies(panels[0], history, unit(units, "energy"))
    if limits is not None:
        panels[0].set_ylim(value_range(limits, ()))
    for second in panels[1:]:
        _certificates(second, history)
    for panel in panels:
        panel.set_xlabel(f"t ({unit(units, 'time')})")
        light_grid(panel)
        panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2, frameon=False, fontsize="small")
    return figure_of(panels[0])


def _energies(ax: Axes, history: Results, energy: str) -> None:
    run = history.trajectory
    stored = run.energy - run.energy[0]
    lines = (
        (run.work, WORK, "-", "work done on the body"),
        (stored, STORED, "--", "stored" if run.energy[0] == 0 else "stored since the start"),
        (run.dissipated, DISSIPATED, "-.", "dissipated by friction"),
        (run.work - stored - run.dissipated, NUMERICAL, ":", "lost by time stepping"),
    )
    for values, colour, style, label in lines:
        ax.plot(run.times, values, style, color=colour, linewidth=1.6, label=label)
    ax.set(ylabel="energy" if energy == "energy" else f"energy ({energy})", title="Energy ledger")


def _certificates(ax: Axes, history: Results) -> None:
    run = history.trajectory
    lines = (
        (run.certificate, STORED, "o", "each step"),
        (run.certificate_total, DISSIPATED, "-", "all steps so far"),
        (run.certificate_floor, WORK, ":", "rounding floor"),
    )
    ax.set(ylabel="relative energy error, at most", title="Certificate", yscale="log")
    for values, colour, style, label in lines:
        shown = np.isfinite(values) & (values > 0)
        ax.plot(run.times[shown], values[shown], style, color=colour, markersize=2.5, linewidth=1.4, label=label)


# All pictures of a history, as files.


PICTURES: dict[str, Callable[[Results], Figure]] = {
    "deformed_mesh": deformed_mesh,
    "friction_traction": friction_traction,
    "stick_slip_map": stick_slip_map,
    "wear": wear,
    "deformed_body": deformed_body,
    "contact_face": contact_face,
    "friction_disc": friction_disc,
    "energy_ledger": energy_ledger,
}
IN_PLANE, IN_SPACE = {"deformed_mesh", "friction_traction", "stick_slip_map", "wear"}, {"deformed_body"}
ON_FACE = {"contact_face", "friction_disc"}
OF_CONTACT = {"friction_traction", "stick_slip_map", *ON_FACE}
OF_STEPS = {"stick_slip_map", "energy_ledger"}
DPI = 200
MARKS = {
    ".png": ({"Software": "vemcvx"}, b"Software\0vemcvx"),
    ".svg": ({"Creator": "vemcvx"}, b"<dc:title>vemcvx</dc:title>"),
    ".pdf": ({"Creator": "vemcvx"}, b"/Creator (vemcvx)"),
}
"""Our mark, in the file: what is said to matplotlib, and what it writes."""


def write_plots(history: Results, folder: str | Path, suffix: str = ".png") -> list[Path]:
    """Write the pictures that a history has something to show for; without contact or steps there are fewer.

    Parameters
    ----------
    history : History
    folder : str or Path
        Made if need be.
    suffix : {".png", ".svg", ".pdf"}
        The kind of file.

    Returns
    -------
    list of Path
        The files written; those of an older run that this one does not write are removed.

    Raises
    ------
    HistoryError
        The folder cannot be written to, or pictures of others are there by those names.
    VemcvxError
        matplotlib is not installed.
    """
    folder = path_of(folder, "write_plots")
    suffix = choice(suffix, "write_plots", "suffix", list(MARKS), HistoryError)
    check_pictures(folder, suffix)
    drawn = draw_pictures(history)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in PICTURES:
            (folder / f"{name}{suffix}").unlink(missing_ok=True)
        for name, figure in drawn.items():
            figure.savefig(folder / f"{name}{suffix}", dpi=DPI, metadata=MARKS[suffix][0])
    except OSError as error:
        raise HistoryError(f"{folder}: cannot write pictures there: {error}.") from error
    return [folder / f"{name}{suffix}" for name in drawn]


def draw_pictures(history: Results) -> dict[str, Figure]:
    """The pictures that a history has something to show for, by name."""
    return {name: draw(history) for name, draw in PICTURES.items() if _has(history, name)}


def check_pictures(folder: Path, suffix: str = ".png") -> None:
    """Raise HistoryError where a picture of a name of ours is there that was not drawn by us."""
    for path in (folder / f"{name}{suffix}" for name in PICTURES):
        if os.path.lexists(path) and not _ours(path):
            raise HistoryError(
                f"{path}: not drawn by this version, so it is not replaced. Choose another folder, or move it away."
            )


def _ours(path: Path) -> bool:
    try:
        return MARKS[path.suffix][1] in path.read_bytes()
    except OSError:
        return False


def left_out(history: Results) -> dict[str, str]:
    """Pictures that there would be, by name, and why there are not."""
    body = {} if has_pyvista() else {"deformed_body": MISSING}
    faces = {name: hidden(name) for name in ON_FACE if len(history.contact.nodes) and not seen(history.contact)}
    return body | faces if _in_space(history) else {}


def _in_space(history: Results) -> bool:
    return isinstance(history.mesh, PolyhedralMesh)


def _has(history: Results, name: str) -> bool:
    contact, steps = len(history.contact.nodes) > 0, bool((history.stored > 0).any())
    if name in (IN_PLANE if _in_space(history) else IN_SPACE | ON_FACE) or name in left_out(history):
        return False
    if name == "friction_disc":
        return bool((history.contact.bound[-1] > 0).any())
    if name == "wear":
        return steps and bool(history.contact.wear.any())
    return (contact or name not in OF_CONTACT) and (steps or name not in OF_STEPS)
