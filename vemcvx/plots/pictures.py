"""All pictures of a history, as files."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from vemcvx.arguments import choice
from vemcvx.errors import HistoryError
from vemcvx.meshes import PolyhedralMesh
from vemcvx.owned_files import path_of
from vemcvx.plots.contact_face import contact_face
from vemcvx.plots.deformed_body import deformed_body
from vemcvx.plots.deformed_mesh import deformed_mesh
from vemcvx.plots.energy_ledger import energy_ledger
from vemcvx.plots.face_layout import hidden, seen
from vemcvx.plots.friction_disc import friction_disc
from vemcvx.plots.friction_traction import friction_traction
from vemcvx.plots.rendering import MISSING, has_pyvista
from vemcvx.plots.stick_slip_map import stick_slip_map
from vemcvx.plots.wear import wear
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
