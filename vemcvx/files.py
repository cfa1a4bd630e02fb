"""A history in a folder: pictures for ParaView, a summary for scripts, and everything, to the bit, for us.

    history.pvd      the stored steps in time, for ParaView and PyVista, pointing to
    step_0000.vtu    displacement and contact at nodes, stress and strain energy density on cells; one file a step
    summary.json     what was run, how certain the answer is, the energies, the cost
    history.npz      the arrays of the history, lossless; :func:`read_history` needs no other file

All files are made in a folder of their own inside the target and moved from there when they are complete, so
that a run that dies leaves an older history as it was.
"""

from __future__ import annotations

import json
import os
import re
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
import zipfile
import zlib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.errors import HistoryError, MeshError, VemcvxError
from vemcvx.history import Contact, History
from vemcvx.meshes import PolygonMesh
from vemcvx.meshes.files import write_cells
from vemcvx.trajectory import Trajectory
from vemcvx.vem import Space, strains

Floats = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]

FORMAT = "vemcvx history 1"
ARRAYS, SERIES, SUMMARY = "history.npz", "history.pvd", "summary.json"


@dataclass(frozen=True)
class Origin:
    """Where a history comes from, for its summary."""

    problem: str = "unnamed"
    family: str | None = None
    """The family of meshes, if it was one."""
    n: int | None = None
    """What that family was asked for: cells per unit length."""


def write_history(history: History, folder: str | Path, origin: Origin | None = None) -> Path:
    """Write a history to a folder, which is made if need be; an older history in it is replaced.

    Parameters
    ----------
    history : History
    folder : str or Path
    origin : Origin, optional
        What the summary says of the problem and the mesh.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    HistoryError
        The folder cannot be made or written to.
    """
    folder, start = writable_folder(folder), time.perf_counter()
    older = _listed_steps(folder)
    try:
        with tempfile.TemporaryDirectory(prefix=".writing-", dir=folder) as made:
            new = Path(made)
            steps = [_write_step(history, row, new) for row in range(len(history.stored))]
            np.savez(new / ARRAYS, **_arrays(history))
            (new / SERIES).write_text(_series(history, steps), encoding="utf-8")
            told = _summary(history, origin or Origin(), time.perf_counter() - start)
            (new / SUMMARY).write_text(json.dumps(told, indent=2, allow_nan=False) + "\n", encoding="utf-8")
            for name in (*steps, ARRAYS, SERIES, SUMMARY):
                os.replace(new / name, folder / name)
    except (OSError, MeshError) as error:
        raise HistoryError(f"{folder}: cannot write a history there: {error}") from error
    for name in older - set(steps):
        (folder / name).unlink(missing_ok=True)
    return folder


def writable_folder(folder: str | Path) -> Path:
    """The folder, made if need be.

    Raises
    ------
    HistoryError
        It is a file, or may not be written to.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise HistoryError(f"{folder}: cannot be made a folder to write to: {error}") from error
    return folder


def read_history(folder: str | Path) -> History:
    """Read a history back, every number to the bit.

    The scene is not kept (its data may be functions): `scene` is None, `effects` says it in words.

    Parameters
    ----------
    folder : str or Path
        What :func:`write_history` was given.

    Raises
    ------
    HistoryError
        There is no such folder, no history in it, or one that is cut short or of another format.
    """
    path = Path(folder) / ARRAYS
    if not path.is_file():
        raise HistoryError(f"{folder}: {_what_is(Path(folder))}; a history is a folder with {ARRAYS} in it.")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise HistoryError(f"{path}: cut short or damaged: {error}. Run the problem again.") from error
    if "about" not in arrays:
        raise HistoryError(f"{path}: not a history of vemcvx; it holds {', '.join(sorted(arrays)) or 'nothing'}.")
    about = json.loads(str(arrays["about"]))
    if about.get("format") != FORMAT:
        raise HistoryError(f"{path}: found the format {about.get('format')!r}; this version reads {FORMAT!r}.")
    try:
        return _history(arrays, about)
    except (KeyError, TypeError, VemcvxError) as error:
        raise HistoryError(f"{path}: incomplete or inconsistent: {error}. Run the problem again.") from error


def _what_is(folder: Path) -> str:
    if folder.is_dir():
        return f"found {', '.join(sorted(p.name for p in folder.iterdir())[:5]) or 'nothing'}"
    return "found a file, not a folder" if folder.exists() else "there is no such folder"


def _arrays(history: History) -> Arrays:
    """Everything a history is, as named arrays; what is not an array goes into one JSON text."""
    mesh = history.mesh
    about = {
        "format": FORMAT,
        "effects": history.effects,
        "seconds": history.seconds,
        "trajectory": {name: value for name, value in vars(history.trajectory).items() if not _is_array(value)},
    }
    return {
        "about": np.array(json.dumps(about)),
        **{f"mesh.{name}": getattr(mesh, name) for name in ("points", "offsets", "vertices")},
        **{f"boundary.{name}": edges for name, edges in mesh.boundaries.items()},
        **{f"cell_data.{name}": values for name, values in mesh.cell_data.items()},
        **{name: getattr(history, name) for name in ("displacement", "forces", "moduli")},
        **{f"contact.{name}": value for name, value in vars(history.contact).items()},
        **{f"trajectory.{name}": value for name, value in vars(history.trajectory).items() if _is_array(value)},
    }


def _is_array(value: Any) -> bool:
    return isinstance(value, np.ndarray)


def _history(arrays: Arrays, about: dict[str, Any]) -> History:
    scalars = about["trajectory"]
    trajectory = {f.name: scalars.get(f.name, arrays.get(f"trajectory.{f.name}")) for f in fields(Trajectory)}
    missing = [name for name, value in trajectory.items() if value is None]
    if missing:
        raise KeyError(f"trajectory.{missing[0]}")
    return History(
        mesh=_mesh(arrays),
        scene=None,
        effects=tuple(about["effects"]),
        displacement=arrays["displacement"],
        forces=arrays["forces"],
        contact=Contact(**{f.name: arrays[f"contact.{f.name}"] for f in fields(Contact)}),
        moduli=arrays["moduli"],
        trajectory=Trajectory(**trajectory),
        seconds=about["seconds"],
    )


def _mesh(arrays: Arrays) -> PolygonMesh:
    cells = np.split(arrays["mesh.vertices"], arrays["mesh.offsets"][1:-1])
    named = _under("boundary.", arrays)
    named.pop("boundary")
    return PolygonMesh(arrays["mesh.points"], cells, boundaries=named, cell_data=_under("cell_data.", arrays))


def _under(prefix: str, arrays: Arrays) -> Arrays:
    return {name.removeprefix(prefix): values for name, values in arrays.items() if name.startswith(prefix)}


def _write_step(history: History, row: int, folder: Path) -> str:
    """One stored step as a VTU; returns its name."""
    step = int(history.stored[row])
    name = f"step_{step:0{max(4, len(str(history.steps)))}d}.vtu"
    stress = history.stress(step)
    strain = strains(Space(history.mesh), history.displacement[row])
    on_cells = {"stress": stress, "strain_energy": 0.5 * np.einsum("ci,ci->c", stress, strain)}
    write_cells(folder / name, history.mesh, _at_nodes(history, row), on_cells)
    return name


def _at_nodes(history: History, row: int) -> Arrays:
    """Displacement and contact as nodal fields; zero away from contact."""
    contact, u = history.contact, history.displacement[row]
    fields = {"displacement": u}
    for name in ("slip", "traction"):
        whole = np.zeros_like(u)
        whole[contact.nodes] = getattr(contact, name)[row]
        fields[name] = whole
    for name in ("pressure", "sticking"):
        fields[name] = np.zeros(len(u))
        fields[name][contact.nodes] = getattr(contact, name)[row]
    return fields


def _series(history: History, steps: list[str]) -> str:
    root = ET.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ET.SubElement(root, "Collection")
    for t, name in zip(history.times, steps, strict=True):
        ET.SubElement(collection, "DataSet", timestep=repr(float(t)), part="0", file=name)
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _listed_steps(folder: Path) -> set[str]:
    """Step files of an older history of ours: those that its series lists and that lie beside it."""
    try:
        listed = [str(item.get("file")) for item in ET.parse(folder / SERIES).iter("DataSet")]
    except (OSError, ET.ParseError):
        return set()
    return {name for name in listed if name.startswith("step_") and name == Path(name).name}


def _summary(history: History, origin: Origin, writing: float) -> dict[str, Any]:
    from vemcvx import __version__

    mesh, last = history.mesh, history.trajectory
    seconds = {name: history.seconds[name] for name in ("assemble", "prepare", "solve")} | {"write": writing}
    size = {"cells": mesh.n_cells, "nodes": mesh.n_nodes, "h": mesh.h}
    return {
        "format": FORMAT,
        "version": __version__,
        "problem": origin.problem,
        "mesh": {"family": origin.family, "n": origin.n, **size},
        "unknowns": last.state.shape[1],
        "steps": history.steps,
        "effects": list(history.effects),
        "solver": history.solver,
        "accuracy": _accuracy(history.solver),
        "certified_energy_error": _finite(last.certificate.max()),
        "energy": _finite(last.energy[-1]),
        "dissipated": _finite(last.dissipated[-1]),
        "work": _finite(last.work[-1]),
        "seconds": {**seconds, "total": sum(seconds.values())},
        "peak_memory_mb": peak_memory_mb(),
    }


def _accuracy(solver: str) -> float | None:
    """The certified relative energy error asked of each step, which every solver names among its settings."""
    found = re.search(r"accuracy=([^,)]+)", solver)
    return float(found.group(1)) if found else None


def _finite(value: float) -> float | None:
    """JSON has no infinity."""
    return float(value) if np.isfinite(value) else None


def peak_memory_mb() -> float | None:
    """The most memory this process has held so far, in MB; None where the system does not tell (Windows)."""
    try:
        import resource
    except ImportError:
        return None
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
