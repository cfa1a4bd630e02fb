"""A history as named arrays in one NPZ file, lossless; what is not an array goes along as JSON in the array `about`."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from vemcvx.archives import Arrays, read_arrays
from vemcvx.arrays import sizes_of
from vemcvx.errors import HistoryError
from vemcvx.meshes import AnyMesh, Interface, PolygonMesh, PolyhedralMesh
from vemcvx.meshes.polyhedra import Faces, listed_faces
from vemcvx.results.contact import Contact
from vemcvx.results.results import RECORDS, Results, labelled
from vemcvx.stepping.trajectory import Trajectory
from vemcvx.vem import component_names

NAME = "vemcvx history"
FORMAT = f"{NAME} 4"
SHAPES = {prefix + name: shape for prefix, record in RECORDS.items() for name, shape in sizes_of(record).items()}


def write_archive(history: Results, path: Path) -> None:
    """Write every array of a history, its mesh with boundaries and cell data, and its words."""
    mesh, run = history.mesh, vars(history.trajectory)
    about = {
        "format": FORMAT,
        "effects": history.effects,
        "inactive": history.inactive,
        "errors": history.errors,
        "seconds": history.seconds,
        "bodies": {name: found.bodies for name, found in mesh.interfaces.items()},
        "trajectory": {name: value for name, value in run.items() if not isinstance(value, np.ndarray)},
    }
    arrays = {
        "about": np.array(json.dumps(about)),
        **{f"mesh.{name}": getattr(mesh, name) for name in mesh.ARRAYS},
        **{f"boundary.{name}": edges for name, edges in mesh.boundaries.items()},
        **{f"partners.{name}": found.partners for name, found in mesh.interfaces.items()},
        **{f"cell_data.{name}": values for name, values in mesh.cell_data.items()},
        **{name: values for name, values, _ in labelled(history)},
    }
    np.savez(path, **arrays)


def is_archive(path: Path) -> bool:
    """True if that file is the archive of a history, of whatever version, as far as its list of contents says."""
    try:
        with zipfile.ZipFile(path) as file:
            return "about.npy" in file.namelist()
    except (OSError, ValueError, zipfile.BadZipFile):
        return False


def read_archive(path: Path) -> Results:
    """Read what :func:`write_archive` wrote.

    Raises
    ------
    HistoryError
        The file is damaged, foreign, or of another format.
    """
    try:
        arrays = read_arrays(path)
    except Exception as error:  # damage shows as whatever numpy, zipfile or the parser of headers stumbles over
        raise HistoryError(f"{path}: cut short or damaged: {error}. Run the problem again.") from error
    try:
        return _history(arrays, _about(arrays))
    except Exception as error:  # what is written in it may be anything
        raise HistoryError(f"{path}: no history that this version reads: {error}. Run the problem again.") from error


def _about(arrays: Arrays) -> dict[str, Any]:
    if "about" not in arrays:
        raise ValueError(f"it holds {', '.join(sorted(arrays)) or 'nothing'}")
    about: dict[str, Any] = json.loads(str(arrays["about"]))
    if about["format"] != FORMAT:
        raise ValueError(f"found the format {about['format']!r}, wanted {FORMAT!r}")
    return about


def _history(arrays: Arrays, about: dict[str, Any]) -> Results:
    mesh = _mesh(arrays, about.get("bodies", {}))
    dim = mesh.points.shape[1]
    components = len(component_names(dim))
    _check_arrays(arrays, {"nodes": mesh.n_nodes, "cells": mesh.n_cells, "dim": dim, "components": components})
    _check_words(about)
    return Results(
        mesh=mesh,
        scene=None,
        effects=tuple(about["effects"]),
        contact=Contact(**_under("contact.", arrays)),
        trajectory=Trajectory(**_under("trajectory.", arrays), **about["trajectory"]),
        seconds=about["seconds"],
        inactive=tuple(about.get("inactive", ())),
        errors=about.get("errors"),
        **{name: arrays[name] for name in sizes_of(Results) if name in arrays},
    )


def _check_arrays(arrays: Arrays, sizes: dict[str, int]) -> None:
    """Raise ValueError unless the arrays go together; `sizes` are those known before."""
    for name, (names, kind) in SHAPES.items():
        if name not in arrays:
            continue
        array = arrays[name]
        wanted = [int(size) if size.isdecimal() else sizes.get(size) for size in names]
        fits = len(wanted) == array.ndim and all(w in (None, n) for w, n in zip(wanted, array.shape, strict=True))
        if not fits or array.dtype.kind != kind:
            raise ValueError(f"found {name} of shape {array.shape}, {array.dtype}, which does not go with the rest")
        sizes.update((size, n) for size, n in zip(names, array.shape, strict=True) if not size.isdecimal())
    if sizes["constants"] not in (2, 6):
        raise ValueError(f"found {sizes['constants']} moduli a cell, wanted 2 or 6")
    numbered = {"contact.nodes": (0, "nodes"), "contact.partners": (-1, "nodes"), "trajectory.stored": (0, "N")}
    for name, (least, size) in numbered.items():
        count = sizes[size]
        if len(arrays[name]) and not (arrays[name].min() >= least and arrays[name].max() < count):
            raise ValueError(f"found {name} from {arrays[name].min()} to {arrays[name].max()} of {count}")


def _check_words(about: dict[str, Any]) -> None:
    """Raise ValueError unless what is no array is of its kind."""
    run, lists = about["trajectory"], (about["effects"], about.get("inactive", []))
    kinds: list[tuple[Any, Any]] = [
        *((one, list) for one in lists),
        *((word, str) for one in lists for word in one),
        *((about["seconds"][name], (int, float)) for name in ("assemble", "prepare", "solve")),
        *((run["solver"], str), (run.get("linear", ""), str), (run["seconds"], dict)),
        *((run.get("accuracy"), (float, type(None))), (about.get("errors"), (dict, type(None)))),
    ]
    if not all(isinstance(value, kind) for value, kind in kinds):
        raise ValueError("found words and numbers of other kinds beside the arrays")


def _mesh(arrays: Arrays, bodies: dict[str, list[str]]) -> AnyMesh:
    named = _under("boundary.", arrays)
    # Every mesh makes this one itself.
    named.pop("boundary")
    matched = {
        name: Interface((one, other), named.pop(name), arrays[f"partners.{name}"])
        for name, (one, other) in bodies.items()
    }
    data = _under("cell_data.", arrays)
    if "mesh.face_cells" in arrays:
        faces = Faces(*(arrays[f"mesh.{name}"] for name in Faces._fields))
        return PolyhedralMesh(arrays["mesh.points"], listed_faces(faces), boundaries=named, cell_data=data)
    cells = np.split(arrays["mesh.vertices"], arrays["mesh.offsets"][1:-1])
    return PolygonMesh(arrays["mesh.points"], cells, boundaries=named, cell_data=data, interfaces=matched)


def _under(prefix: str, arrays: Arrays) -> dict[str, Any]:
    return {name.removeprefix(prefix): values for name, values in arrays.items() if name.startswith(prefix)}
