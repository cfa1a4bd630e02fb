"""A history as named arrays in one NPZ file, lossless; what is not an array goes along as JSON in the array `about`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.errors import HistoryError, VemcvxError
from vemcvx.history import Contact, History
from vemcvx.meshes import PolygonMesh
from vemcvx.stepping.trajectory import Trajectory

Arrays = dict[str, NDArray[Any]]

FORMAT = "vemcvx history 1"
# What not every scene has.
MAYBE = ("prestress", "across", "prestress_across")


def write_archive(history: History, path: Path) -> None:
    """Write every array of a history, its mesh with boundaries and cell data, and its words."""
    mesh, run = history.mesh, vars(history.trajectory)
    about = {
        "format": FORMAT,
        "effects": history.effects,
        "void": history.void,
        "errors": history.errors,
        "seconds": history.seconds,
        "trajectory": {name: value for name, value in run.items() if not isinstance(value, np.ndarray)},
    }
    arrays = {
        "about": np.array(json.dumps(about)),
        **{f"mesh.{name}": getattr(mesh, name) for name in ("points", "offsets", "vertices")},
        **{f"boundary.{name}": edges for name, edges in mesh.boundaries.items()},
        **{f"cell_data.{name}": values for name, values in mesh.cell_data.items()},
        **{name: getattr(history, name) for name in ("displacement", "forces", "moduli")},
        **{name: getattr(history, name) for name in MAYBE if getattr(history, name) is not None},
        **{f"contact.{name}": value for name, value in vars(history.contact).items()},
        **{f"trajectory.{name}": value for name, value in run.items() if isinstance(value, np.ndarray)},
    }
    np.savez(path, **arrays)


def read_archive(path: Path) -> History:
    """Read what :func:`write_archive` wrote.

    Raises
    ------
    HistoryError
        The file is damaged, foreign, or of another format.
    """
    try:
        # Opened here, because numpy leaves a damaged file open.
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except Exception as error:  # damage shows as whatever numpy, zipfile or the parser of headers stumbles over
        raise HistoryError(f"{path}: cut short or damaged: {error}. Run the problem again.") from error
    try:
        return _history(arrays, _about(arrays))
    except (KeyError, TypeError, ValueError, VemcvxError) as error:
        raise HistoryError(f"{path}: no history that this version reads: {error}. Run the problem again.") from error


def _about(arrays: Arrays) -> dict[str, Any]:
    if "about" not in arrays:
        raise ValueError(f"it holds {', '.join(sorted(arrays)) or 'nothing'}")
    about = json.loads(str(arrays["about"]))
    if about["format"] != FORMAT:
        raise ValueError(f"found the format {about['format']!r}, wanted {FORMAT!r}")
    return about


def _history(arrays: Arrays, about: dict[str, Any]) -> History:
    return History(
        mesh=_mesh(arrays),
        scene=None,
        effects=tuple(about["effects"]),
        displacement=arrays["displacement"],
        forces=arrays["forces"],
        contact=Contact(**_under("contact.", arrays)),
        moduli=arrays["moduli"],
        trajectory=Trajectory(**_under("trajectory.", arrays), **about["trajectory"]),
        seconds=about["seconds"],
        void=tuple(about.get("void", ())),
        errors=about.get("errors"),
        **{name: arrays.get(name) for name in MAYBE},
    )


def _mesh(arrays: Arrays) -> PolygonMesh:
    cells = np.split(arrays["mesh.vertices"], arrays["mesh.offsets"][1:-1])
    named = _under("boundary.", arrays)
    # Every mesh makes this one itself.
    named.pop("boundary")
    return PolygonMesh(arrays["mesh.points"], cells, boundaries=named, cell_data=_under("cell_data.", arrays))


def _under(prefix: str, arrays: Arrays) -> Arrays:
    return {name.removeprefix(prefix): values for name, values in arrays.items() if name.startswith(prefix)}
