"""A history as a folder of files.

- ``history.pvd``: the list of stored steps with their instants, for ParaView and PyVista
- ``step_0000.vtu``: one file per stored step
- ``summary.json``: the run, the accuracy of the answer, energies, and the cost
- ``steps.csv``: energies and certificates of every step, stored or not
- ``contact.csv``: slip, traction, pressure ... at every contact node in every stored step; for plane bodies also the
  piece of contact and the arc length (:mod:`vemcvx.results.arc`)
- ``history.npz``: the arrays of history and mesh without loss, and other data as JSON in the array `about`;
  :func:`vemcvx.read_history` reads only this file

In a VTU file, nodes have displacements and contact arrays, and cells have the fields of `History.on_cells`. At nodes
without contact, `sticking` and `closed` are NaN, and all other contact arrays are zero. On the second body of an
interface, slip and traction have the opposite sign. If writing fails, an older history remains.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
import time
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Set
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vemcvx.base.archives import Arrays, read_arrays, record_of
from vemcvx.base.arrays import Floats, array_fields
from vemcvx.base.errors import HistoryError, MeshError
from vemcvx.base.owned_files import path_of
from vemcvx.base.version import __version__
from vemcvx.meshes import Interface, Mesh, PolygonMesh, PolyhedralMesh
from vemcvx.meshes.interfaces import pad_rows
from vemcvx.meshes.io.vtu import pack_cells, write_cells
from vemcvx.meshes.polygons import rows_in_order
from vemcvx.meshes.polyhedra import Faces, list_faces
from vemcvx.results.forces import largest
from vemcvx.results.quoted import Extreme
from vemcvx.results.results import RECORDS, Results, list_arrays, size_of
from vemcvx.results.tables import FILES, write_tables
from vemcvx.vem.stabilisation import VertexWeights
from vemcvx.vem.tensors import AXISYMMETRIC, component_names

NAME = "vemcvx history"
ENERGIES = "energy", "dissipated", "work", "dissipated_second_order", "work_second_order"
FORMAT = f"{NAME} 7"
ARRAYS = {prefix + name: of for prefix, record in RECORDS.items() for name, of in array_fields(record).items()}
PLAIN = "effects", "inactive", "errors", "bound", "bounded_force", "seconds", "growth", "units"
"""Attributes of a history that are not arrays and go into JSON unchanged."""
WEIGHTS = "stabilisation.tau"  # name of the array of stabilisation weights
ARCHIVE, SERIES, SUMMARY = "history.npz", "history.pvd", "summary.json"
STEP = re.compile(r"step_[0-9]+\.vtu")


def write_archive(history: Results, path: Path) -> None:
    """Write a history to an archive, without its scene."""
    mesh, run = history.mesh, vars(history.trajectory)
    about = {
        "format": FORMAT,
        **{name: getattr(history, name) for name in PLAIN},
        "bodies": {name: found.bodies for name, found in mesh.interfaces.items()},
        "trajectory": {name: value for name, value in run.items() if not isinstance(value, np.ndarray)},
    }
    arrays = {
        "about": np.array(json.dumps(about)),
        **{f"mesh.{name}": getattr(mesh, name) for name in mesh.ARRAYS},
        **{f"boundary.{name}": edges for name, edges in mesh.boundaries.items()},
        **{f"partners.{name}": found.partners for name, found in mesh.interfaces.items()},
        **{f"cell_data.{name}": values for name, values in mesh.cell_data.items()},
        **{name: values for name, values, _ in list_arrays(history)},
    }
    np.savez(path, **arrays)


def read_archive(path: Path) -> Results:
    """Read an archive of :func:`write_archive`, or raise HistoryError."""
    try:
        arrays = read_arrays(path)
    except Exception as error:  # Damaged files may raise any error.
        raise HistoryError(f"{path}: cut short or damaged: {error}. Run the problem again.") from error
    try:
        return _history(arrays)
    except Exception as error:  # Foreign files may raise any error.
        raise HistoryError(f"{path}: not a history of this version: {error}. Run the problem again.") from error


def _history(arrays: Arrays) -> Results:
    if "about" not in arrays:
        raise ValueError(f"it holds {', '.join(sorted(arrays)) or 'nothing'}")
    about: dict[str, Any] = json.loads(str(arrays["about"]))
    if about["format"] != FORMAT:
        raise ValueError(f"found the format {about['format']!r}, wanted {FORMAT!r}")
    mesh = _mesh(arrays, about["bodies"])
    dim = mesh.points.shape[1]
    _check_arrays(arrays, {"nodes": mesh.n_nodes, "cells": mesh.n_cells, "dim": dim})
    known = {name: about[name] for name in PLAIN} | {"mesh": mesh, "scene": None}
    known |= {name: tuple(about[name]) for name in ("effects", "inactive")}
    # Files do not keep user-defined classes.
    known["stabilisation"] = VertexWeights(arrays[WEIGHTS]) if WEIGHTS in arrays else None
    known |= {f"trajectory.{name}": value for name, value in about["trajectory"].items()}
    return record_of(Results, arrays, known)


def _check_arrays(arrays: Arrays, sizes: dict[str, int]) -> None:
    for name, (names, kind, *_) in ARRAYS.items():
        if name not in arrays:
            continue
        array = arrays[name]
        wanted = [int(size) if size.isdecimal() else sizes.get(size) for size in names]
        fits = len(wanted) == array.ndim and all(w in (None, n) for w, n in zip(wanted, array.shape, strict=True))
        if not fits or array.dtype.kind != kind:
            raise ValueError(f"found {name} of shape {array.shape}, {array.dtype}, which does not fit the other arrays")
        sizes.update((size, n) for size, n in zip(names, array.shape, strict=True) if not size.isdecimal())
    components = {AXISYMMETRIC: 4}.get(sizes["constants"], len(component_names(sizes["dim"])))
    if sizes["constants"] not in (2, 6, AXISYMMETRIC, 21) or sizes.get("components", components) != components:
        raise ValueError(f"found {sizes['constants']} moduli per cell, which do not fit the dimension or the stresses")
    numbered = {"contact.nodes": (0, "nodes"), "contact.partners": (-1, "nodes"), "trajectory.stored": (0, "N")}
    for name, (least, size) in numbered.items():
        count = sizes[size]
        if len(arrays[name]) and not (arrays[name].min() >= least and arrays[name].max() < count):
            raise ValueError(f"found {name} in {arrays[name].min()}..{arrays[name].max()}, wanted {least}..{count - 1}")


def _mesh(arrays: Arrays, bodies: dict[str, list[str]]) -> Mesh:
    def under(prefix: str) -> Arrays:
        return {name.removeprefix(prefix): values for name, values in arrays.items() if name.startswith(prefix)}

    named, data = under("boundary."), under("cell_data.")
    named.pop("boundary")  # The mesh computes this boundary.
    solid = "mesh.face_cells" in arrays
    matched = {}
    for name, (one, other) in bodies.items():
        sides = named.pop(name)
        if solid:
            sides = pad_rows(*rows_in_order(arrays["mesh.face_offsets"], arrays["mesh.face_vertices"], sides))
        matched[name] = Interface((one, other), sides, arrays[f"partners.{name}"])
    if solid:
        faces = Faces(*(arrays[f"mesh.{name}"] for name in Faces._fields))
        return PolyhedralMesh(
            arrays["mesh.points"], list_faces(faces), boundaries=named, cell_data=data, interfaces=matched
        )
    cells = np.split(arrays["mesh.vertices"], arrays["mesh.offsets"][1:-1])
    return PolygonMesh(arrays["mesh.points"], cells, boundaries=named, cell_data=data, interfaces=matched)


@dataclass(frozen=True)
class Origin:
    """The problem and the mesh of a history."""

    problem: str = "unnamed"
    family: str | None = None  # The family of meshes, or the mesh file.
    n: int | None = None  # Number of cells across the shortest side; None for a file.


def summary(history: Results, origin: Origin, writing: float) -> dict[str, Any]:
    """Return the summary of a history for JSON."""
    mesh, run, touch, bound = history.mesh, history.trajectory, history.contact, history.bound or {}
    row = history.row(None)
    counts = {"stick": touch.stick_count, "slip": touch.slip_count, "open": touch.open_count}
    seconds = {name: history.seconds[name] for name in ("assemble", "prepare", "solve")} | {"write": writing}
    return {
        "format": FORMAT,
        "version": __version__,
        "problem": origin.problem,
        "mesh": {"family": origin.family, "n": origin.n, **size_of(mesh)},
        "unknowns": run.state.shape[1],
        "steps": history.steps,
        "units": history.units,
        "effects": list(history.effects),
        "left_out": list(history.inactive),
        "solver": history.solver,
        "linear": run.linear or None,
        "accuracy": run.accuracy,
        "certified_energy_error": finite_or_none(run.certified.max()),
        "certificate_kind": run.certificate_kind,
        "estimated_energy_errors": history.errors,
        **{f"bound_{name}": finite_or_none(bound.get(name)) for name in ("upper", "lower")},
        "bound_kind": bound.get("kind"),
        "bound_force": _force_bounds(history),
        **{name: finite_or_none(getattr(run, name)[-1]) for name in ENERGIES},
        "peak": {"energy": finite_or_none(history.energy[row]), "t": float(history.times[row]), "step": history.peak},
        "contact": {"nodes": len(touch.nodes)} | {name: int(count[row]) for name, count in counts.items()},
        "forces": {name: _largest(history, forces) for name, forces in history.resultants.items()},
        "extremes": {one.key: _extreme(one) for one in history.extremes},
        "seconds": {**seconds, "total": sum(seconds.values())},
        "peak_memory_mb": peak_memory_mb(),
    }


def _force_bounds(history: Results) -> dict[str, Any] | None:
    if history.force_bounds is None or history.bounded_force is None:
        return None
    ((on, axis),), (low, high) = history.bounded_force.items(), map(finite_or_none, history.force_bounds[-1])
    return {"on": on, "axis": axis, "low": low, "high": high, "value": float(history.reaction(on)[-1, axis])}


def _extreme(one: Extreme) -> dict[str, Any]:
    where = {"value": finite_or_none(one.value), "place": one.place.tolist(), "t": one.time, "step": one.step}
    return {**where, "unit": one.unit, "unbounded": one.unbounded or None}


def _largest(history: Results, forces: Floats) -> dict[str, Any]:
    row = largest(forces)
    return {"value": forces[row].tolist(), "t": float(history.times[row]), "step": int(history.stored[row])}


def finite_or_none(value: float | None) -> float | None:
    """Return a finite number, else None, because JSON has no infinity."""
    return float(value) if value is not None and np.isfinite(value) else None


def peak_memory_mb() -> float | None:
    """Return the peak memory of this process in MB on Linux, else None."""
    with suppress(OSError):
        if found := re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text()):
            return int(found.group(1)) / 1024
    return None


def write_results(history: Results, folder: str | Path, origin: Origin | None = None) -> Path:
    """Write a history to a folder, in place of an older history."""
    if not np.isfinite(history.displacement).all():
        raise HistoryError(
            "write: found NaN or infinite displacements; only finite fields are written. Run with check=True to see "
            "the error."
        )
    folder, start = writable_folder(folder), time.perf_counter()
    try:
        with tempfile.TemporaryDirectory(prefix=".vemcvx-", dir=folder) as temporary:
            made = Path(temporary)
            # If displacements exceed 1e154, energies overflow, and are written as infinite.
            with np.errstate(over="ignore", invalid="ignore"):
                _write_series(history, made)
            write_archive(history, made / ARCHIVE)
            write_tables(history, made)
            contents = summary(history, origin or Origin(), time.perf_counter() - start)
            (made / SUMMARY).write_text(json.dumps(contents, indent=2, allow_nan=False) + "\n", encoding="utf-8")
            _move(made, folder)
    except (OSError, MeshError) as error:
        raise HistoryError(f"{folder}: cannot write a history there: {error}") from error
    return folder


def _move(made: Path, folder: Path) -> None:
    """Replace the files of an older history by new files."""
    names, older = set(os.listdir(made)), _files_of_history(folder)
    check_replaceable(folder, names)
    order = {ARCHIVE: 0, SERIES: 2, SUMMARY: 3}
    for name in sorted(names, key=lambda name: order.get(name, 1)):
        os.replace(made / name, folder / name)
    for name in older - names:
        (folder / name).unlink(missing_ok=True)


def _write_series(history: Results, folder: Path) -> None:
    root = ET.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ET.SubElement(root, "Collection")
    digits, packed = max(4, len(str(history.steps))), pack_cells(history.mesh)
    for row, step in enumerate(history.stored):
        name = f"step_{step:0{digits}d}.vtu"
        write_cells(folder / name, packed, _at_nodes(history, row), history.on_cells(int(step)))
        ET.SubElement(collection, "DataSet", timestep=repr(float(history.times[row])), part="0", file=name)
    ET.indent(root)
    ET.ElementTree(root).write(folder / SERIES, encoding="utf-8", xml_declaration=True)


def _at_nodes(history: Results, row: int) -> dict[str, Floats]:
    contact, u = history.contact, history.displacement[row]
    fields, joined = {"displacement": u}, contact.partners >= 0
    if history.is_axisymmetric:
        fields["radius"] = history.mesh.points[:, 0]
    for name in (name for name, of in array_fields(type(contact)).items() if of.sizes[0] == "S"):
        values = getattr(contact, name)[row]
        fields[name] = np.full((len(u), *values.shape[1:]), np.nan if values.dtype == bool else 0.0)
        fields[name][contact.partners[joined]] = values[joined] if values.ndim == 1 else -values[joined]
        fields[name][contact.nodes] = values
    return fields


def check_replaceable(folder: Path, names: Set[str] = frozenset({ARCHIVE, SERIES, SUMMARY, *FILES.values()})) -> None:
    """Raise HistoryError if a file with a name in `names` belongs to no history."""
    for name in sorted(names - _files_of_history(folder)):
        if os.path.lexists(folder / name):
            raise HistoryError(
                f"{folder / name}: it belongs to no history, so it is not replaced. Choose another folder, or move it."
            )


def _files_of_history(folder: Path) -> set[str]:
    if not _is_archive(folder / ARCHIVE):
        return set()
    return {ARCHIVE, SERIES, SUMMARY, *FILES.values()} | {name for name in os.listdir(folder) if STEP.fullmatch(name)}


def _is_archive(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as file:
            return "about.npy" in file.namelist()
    except (OSError, ValueError, zipfile.BadZipFile):
        return False


def writable_folder(folder: str | Path) -> Path:
    """Create a folder for output and return it, or raise HistoryError."""
    folder = path_of(folder, "write")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise HistoryError(f"{folder}: cannot be used as a folder for output: {error}") from error
    return folder


def read_results(folder: str | Path) -> Results:
    """Read the results in a folder: see :func:`vemcvx.read_history`."""
    where = path_of(folder, "read_history")
    if not os.path.isfile(where / ARCHIVE):
        raise HistoryError(f"{where}: found no {ARCHIVE} there; a history is a folder that contains this file.")
    return read_archive(where / ARCHIVE)
