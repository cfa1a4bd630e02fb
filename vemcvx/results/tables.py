"""Results as tables of columns of equal length, as CSV files, and as a few lines of words."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.arrays import Floats, Ints, brief, sizes_of
from vemcvx.errors import HistoryError, VemcvxError
from vemcvx.outline import Lines, Outline, csv_text
from vemcvx.results.contact import Contact
from vemcvx.results.probe import places
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from pandas import DataFrame


# Results as tables: columns of equal length by name, a row for every step, or every place at every stored step.


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


# The tables of a history as CSV files, for spreadsheets and scripts; flags are 1 and 0.


FILES = {name: f"{name}.csv" for name in (STEPS, CONTACT, PROBES)}


def write_tables(history: Results, folder: Path, points: ArrayLike | None) -> list[str]:
    """Write those that have rows; the names of the files."""
    wanted = {STEPS: True, CONTACT: len(history.contact.nodes) > 0, PROBES: points is not None}
    names = [name for name, has_rows in wanted.items() if has_rows]
    for name in names:
        columns = table(history, name, points if name == PROBES else None)
        plain = [(values.astype(int) if values.dtype == bool else values).tolist() for values in columns.values()]
        text = csv_text(list(columns), zip(*plain, strict=True))
        (folder / FILES[name]).write_text(text, encoding="utf-8")
    return [FILES[name] for name in names]


# A run in a few lines of words.


def in_words(history: Results) -> Outline:
    """The summary in words: effects, certificates, cost."""
    run, touch = history.trajectory, history.contact
    sticks, slips, opened = (int(count[-1]) for count in (touch.stick_count, touch.slip_count, touch.open_count))
    gone = f", {opened} are open" if opened else ""
    title = (
        f"{history.mesh.n_cells} cells, {history.mesh.n_nodes} nodes, {run.state.shape[1]} unknowns, "
        f"{len(touch.nodes)} contact nodes, {history.steps} steps"
    )
    certified = (
        f"{run.certificate.max():.1e} relative energy error a step (floor {run.certificate_floor.max():.1e}), "
        f"{run.certificate_total[-1]:.1e} accumulated"
    )
    iterations = (
        f"{int(np.median(run.iterations[1:])) if history.steps else 0} a step at the median, at most "
        f"{run.iterations.max()}; {run.safeguards.sum()} of them safeguards"
    )
    energy = f"stored {run.energy[-1]:.6g}, dissipated {run.dissipated[-1]:.6g}, work {run.work[-1]:.6g}"
    lines = [
        *(("left out", words) for words in history.inactive),
        ("solver", history.solver),
        ("certified", certified),
        *_kind(history),
        *_errors(history.errors),
        ("iterations", iterations),
        ("energy", energy),
        ("contact", f"{sticks} nodes stick, {slips} slip{gone} in the last step"),
        ("seconds", ", ".join(f"{name} {value:.3g}" for name, value in history.seconds.items())),
    ]
    return Outline(title, lines)


WHY_ESTIMATED = "where what sticks, slips and touches did not settle"
"""What keeps certificates from being bounds; see :mod:`vemcvx.stepping.fixed_point`."""


def _kind(history: Results) -> Lines:
    """A remark on the steps whose certificates are no bounds."""
    estimated = history.trajectory.estimated
    if not estimated.any():
        return []
    at = f"an estimate at {estimated.sum()} of {len(estimated)} instants"
    return [("", f"{at}, {WHY_ESTIMATED}; else a bound")]


def _errors(errors: dict[str, float] | None) -> Lines:
    if errors is None:
        return []
    parts = ", ".join(f"{name} {errors[name]:.2%}" for name in ("algebra", "space", "time"))
    return [("estimated", f"{errors['total']:.2%} energy error ({parts}); {errors['target']:.2%} was asked for")]
