"""All pictures of a history, as files."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from vemcvx.errors import HistoryError
from vemcvx.owned_files import path_of
from vemcvx.plots.deformed_mesh import deformed_mesh
from vemcvx.plots.energy_ledger import energy_ledger
from vemcvx.plots.friction_traction import friction_traction
from vemcvx.plots.stick_slip_map import stick_slip_map
from vemcvx.results.history import History

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES: dict[str, Callable[[History], Figure]] = {
    "deformed_mesh.png": deformed_mesh,
    "friction_traction.png": friction_traction,
    "stick_slip_map.png": stick_slip_map,
    "energy_ledger.png": energy_ledger,
}
OF_CONTACT = {"friction_traction.png", "stick_slip_map.png"}
OF_STEPS = {"stick_slip_map.png", "energy_ledger.png"}
DPI = 200
DRAWN_BY = {"Software": "vemcvx"}
"""Our mark, in the file."""


def write_plots(history: History, folder: str | Path) -> list[Path]:
    """Write the pictures that a history has something to show for; without contact or steps there are fewer.

    Parameters
    ----------
    history : History
    folder : str or Path
        Made if need be.

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
    check_pictures(folder)
    drawn = {name: draw(history) for name, draw in PICTURES.items() if _has(history, name)}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in PICTURES:
            (folder / name).unlink(missing_ok=True)
        for name, figure in drawn.items():
            figure.savefig(folder / name, dpi=DPI, metadata=DRAWN_BY)
    except OSError as error:
        raise HistoryError(f"{folder}: cannot write pictures there: {error}.") from error
    return [folder / name for name in drawn]


def check_pictures(folder: Path) -> None:
    """Raise HistoryError where a picture of a name of ours is there that was not drawn by us."""
    for name in PICTURES:
        if os.path.lexists(folder / name) and not _ours(folder / name):
            raise HistoryError(
                f"{folder / name}: not drawn by this version, so it is not replaced. Choose another folder, or move it "
                "away."
            )


def _ours(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return b"Software\0vemcvx" in file.read(1024)
    except OSError:
        return False


def _has(history: History, name: str) -> bool:
    contact, steps = len(history.contact.nodes) > 0, bool((history.stored > 0).any())
    return (contact or name not in OF_CONTACT) and (steps or name not in OF_STEPS)
