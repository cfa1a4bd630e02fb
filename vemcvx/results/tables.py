"""Results as tables: CSV files, and objects of pandas and xarray."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.base.arrays import Floats, Ints, array_fields, choice
from vemcvx.base.errors import HistoryError, VemcvxError
from vemcvx.base.table import Table
from vemcvx.meshes import PolygonMesh
from vemcvx.results.arc import contact_path
from vemcvx.results.results import Results, list_arrays

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

Columns = dict[str, NDArray[Any]]
TABLES = "steps", "contact"
FILES = {name: f"{name}.csv" for name in TABLES}
DERIVED = "work_second_order", "certificate", "certificate_floor", "certificate_total", "certified", "certified_total"
"""Properties of `Trajectory` with a value for every step."""
DIMENSIONS = {"S": "step", "N": "instant", "nodes": "node", "cells": "cell", "m": "contact", "dim": "axis"}
"""Name of a size in `list_arrays` -> dimension in datasets."""


def table(history: Results, name: object) -> Columns:
    """Return a table of a history: see :meth:`vemcvx.History.table`."""
    choice(name, "table", "name", TABLES, HistoryError)
    return _steps(history) if name == "steps" else _contact(history)


def _steps(history: Results) -> Columns:
    run = history.trajectory
    names = [name for name, of in array_fields(type(run)).items() if of.sizes == ("N",) and name != "times"]
    found = {name: getattr(run, name) for name in (*names, *DERIVED)}
    columns = {"step": np.arange(len(run.times)), "time": run.times}
    columns |= {name: values for name, values in found.items() if values is not None}
    for name, forces in history.resultants.items():
        values = np.full((len(run.times), forces.shape[1]), np.nan)
        values[history.stored] = forces
        columns |= _by_axis(name.replace(" of ", "_", 1), values)
    return columns


def _contact(history: Results) -> Columns:
    contact, steps = history.contact, len(history.stored)
    rows = [np.repeat(each, len(contact.nodes)) for each in (history.stored, history.times)]
    columns: Columns = {"step": rows[0], "time": rows[1], **_along(history)}
    for name, of in array_fields(type(contact)).items():
        values = getattr(contact, name)
        if of.sizes[0] == "S":
            columns |= _by_axis(name, values.reshape(-1, *values.shape[2:]))
        else:
            one = "" if name == "points" else name.removesuffix("s")
            columns |= _by_axis(one, np.tile(values, (steps, *[1] * (values.ndim - 1))))
    return columns


def _along(history: Results) -> Columns:
    """Return the piece of contact and the arc length of each node, or {} in space."""
    mesh, nodes = history.mesh, history.contact.nodes
    if not isinstance(mesh, PolygonMesh):
        return {}
    path, found = contact_path(mesh, history.contact), np.zeros((2, mesh.n_nodes))
    found[:, nodes[path.rows]] = path.pieces, path.s
    pieces, s = np.tile(found[:, nodes], len(history.stored))
    return {"piece": pieces.astype(int), "s": s}


def _by_axis(name: str, values: Floats | Ints) -> Columns:
    if values.ndim == 1:
        return {name: values}
    return {f"{name}_{axis}".strip("_"): column for axis, column in zip("xyz", values.T, strict=False)}


def write_tables(history: Results, folder: Path) -> None:
    """Write the nonempty tables as CSV files, booleans as 1 and 0."""
    names = TABLES if len(history.contact.nodes) else TABLES[:1]
    for name in names:
        columns = table(history, name)
        plain = [(values.astype(int) if values.dtype == bool else values).tolist() for values in columns.values()]
        text = Table(list(columns), list(zip(*plain, strict=True))).csv()
        (folder / FILES[name]).write_text(text, encoding="utf-8")


def frame(columns: Columns) -> DataFrame:
    """Return a table for pandas: see :meth:`vemcvx.History.to_pandas`."""
    try:
        from pandas import DataFrame
    except ImportError:
        raise VemcvxError("to_pandas needs pandas, which is not installed: pip install 'vemcvx[pandas]'") from None
    return DataFrame(columns)


def dataset(history: Results) -> Dataset:
    """Return every array of a history as a labelled dataset: see :meth:`vemcvx.History.to_xarray`."""
    try:
        from xarray import Dataset
    except ImportError:
        raise VemcvxError("to_xarray needs xarray, which is not installed: pip install 'vemcvx[xarray]'") from None
    arrays = {}
    for name, values, of in list_arrays(history):
        sizes = [f"of_{size}" if size.isdecimal() else DIMENSIONS.get(size, size) for size in of.sizes]
        arrays[name] = sizes, values, {"units": of.unit}
    axes = list("xyz")[: history.mesh.points.shape[1]]
    coordinates = {"step": history.stored, "instant": history.trajectory.times, "axis": axes}
    return Dataset(arrays, {**coordinates, "time": ("step", history.times)}, {"solver": history.solver})
