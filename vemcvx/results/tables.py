"""Results as tables: columns of equal length by name, a row for every step, or every place at every stored step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.arrays import Floats, Ints, brief, sizes_of
from vemcvx.errors import HistoryError, VemcvxError
from vemcvx.results.contact import Contact
from vemcvx.results.probe.places import places
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from pandas import DataFrame

Columns = dict[str, NDArray[Any]]
STEPS, CONTACT, PROBES = "steps", "contact", "probes"
OF_STEPS = (
    *("energy", "dissipated", "work", "certificate", "certificate_floor", "certificate_total", "estimated"),
    *("iterations", "safeguards"),
)
ONE_EACH = {
    **{"nodes": "node", "partners": "partner", "points": "", "normals": "normal"},
    **{"lengths": "length", "friction_lengths": "friction_length"},
}
"""What the arrays of contact that do not change in time are called where a row is about one node."""


def table(history: Results, name: object, points: ArrayLike | None = None) -> Columns:
    """A table of a history: see :meth:`vemcvx.History.table`."""
    if not isinstance(name, str) or name not in (STEPS, CONTACT, PROBES):
        raise HistoryError(f"table: found {brief(name)}; there are 'steps', 'contact' and, with points, 'probes'.")
    if (name == PROBES) != (points is not None):
        raise HistoryError("table: points go with 'probes', and only with that: table('probes', [[0.5, 0.5]]).")
    if points is not None:
        return _probes(history, points)
    return _steps(history) if name == STEPS else _contact(history)


def frame(columns: Columns) -> DataFrame:
    """The same for pandas.

    Raises
    ------
    VemcvxError
        pandas is not installed.
    """
    try:
        from pandas import DataFrame
    except ImportError:
        raise VemcvxError("to_pandas needs pandas, which is not installed: pip install 'vemcvx[pandas]'") from None
    return DataFrame(columns)


def _steps(history: Results) -> Columns:
    run = history.trajectory
    return {"step": np.arange(len(run.times)), "time": run.times} | {name: getattr(run, name) for name in OF_STEPS}


def _contact(history: Results) -> Columns:
    """Every field of contact, whatever there is: those of nodes are repeated at every step."""
    contact, steps = history.contact, len(history.stored)
    columns = _when(history, len(contact.nodes))
    for name, (sizes, _) in sizes_of(Contact).items():
        values = getattr(contact, name)
        if sizes[0] == "S":
            columns |= _by_axis(name, values.reshape(-1, *values.shape[2:]))
        else:
            columns |= _by_axis(ONE_EACH.get(name, name), np.tile(values, (steps, *[1] * (values.ndim - 1))))
    return columns


def _probes(history: Results, points: ArrayLike) -> Columns:
    at = places(history.mesh, points, "table")
    x, values = np.asarray(points, dtype=float), at.at_nodes(history.displacement)
    steps = len(values)
    columns = _when(history, len(x)) | {"point": np.tile(np.arange(len(x)), steps)}
    return columns | _by_axis("", np.tile(x, (steps, 1))) | _by_axis("displacement", values.reshape(-1, x.shape[1]))


def _when(history: Results, count: int) -> Columns:
    """The columns that say when, for rows of so many places a step."""
    return {"step": np.repeat(history.stored, count), "time": np.repeat(history.times, count)}


def _by_axis(name: str, values: Floats | Ints) -> Columns:
    """A column of numbers, or one for each component of vectors."""
    if values.ndim == 1:
        return {name: values}
    return {f"{name}_{axis}".strip("_"): column for axis, column in zip("xyz", values.T, strict=False)}
