"""Data of effects: numbers, arrays, functions of x and t, and tables over time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import (
    Bools,
    Floats,
    Ints,
    as_real_array,
    as_shaped_array,
    brief,
    call_function,
    finite,
    read_only,
    shape_in_words,
)
from vemcvx.base.errors import SceneError
from vemcvx.meshes import Mesh
from vemcvx.vem.tensors import component_names


class Tabulated:
    """A table of values over time, interpolated linearly. It can replace any function f(x, t).

    Parameters
    ----------
    times : (k,) array
        At least two instants, increasing.
    values : (k,) or (k, components) array
        A number or a vector at each instant, in the units of the datum.

    Raises
    ------
    SceneError
        `times` or `values` is invalid, or the table is called at an instant outside `times`.

    Examples
    --------
    >>> pull = vx.Traction(vx.Tabulated([0.0, 1.0, 3.0], [[0.0, 0.0], [5.0, 0.0], [-5.0, 0.0]]), on="left")
    """

    def __init__(self, times: ArrayLike, values: ArrayLike):
        self.times = read_only(as_real_array(times, "Tabulated: times", "increasing instants").copy())
        self.values = read_only(as_real_array(values, "Tabulated: values", "one value, or one row, per instant").copy())
        shape = self.times.shape
        if len(shape) != 1 or shape[0] < 2 or not np.isfinite(self.times).all() or (np.diff(self.times) <= 0).any():
            raise SceneError(f"Tabulated: found times = {brief(times)}; wanted at least two instants, increasing.")
        if self.values.ndim not in (1, 2) or len(self.values) != shape[0] or not np.isfinite(self.values).all():
            raise SceneError(
                f"Tabulated: found values = {brief(values)}, {shape_in_words(self.values)}; wanted {shape[0]} finite "
                f"numbers, or {shape[0]} rows of them, one per instant."
            )

    def __call__(self, x: Floats, t: float) -> Any:
        """Return the value at time t, for all points."""
        first, last = self.times[0], self.times[-1]
        if not first <= t <= last:
            raise SceneError(
                f"Tabulated: found t = {t:.6g}; the table covers times from {first:.6g} to {last:.6g}. Add rows to it."
            )
        if self.values.ndim == 1:
            return float(np.interp(t, self.times, self.values))
        return np.array([np.interp(t, self.times, column) for column in self.values.T])

    @property
    def __name__(self) -> str:
        """The name of the table in descriptions of a scene."""
        return repr(self)

    def __repr__(self) -> str:
        return f"Tabulated({len(self.times)} instants from {self.times[0]:.6g} to {self.times[-1]:.6g})"


Datum = ArrayLike | Callable[[Floats, float], ArrayLike]  # A constant, or f(x, t).
Constant = ArrayLike | Callable[[Floats], ArrayLike]
"""A number or a function f(x); in materials, also one value per cell or the name of a cell datum."""


def holds(sign: str = "", rule: str = "it must be {sign}") -> dict[str, Any]:
    """Return the metadata of a field; `sign` is "> 0", ">= 0" or empty."""
    return {"sign": sign, "rule": rule.format(sign=sign)}


def require(lawful: Bools, values: Floats, at: At | InCells, found: str, rule: str) -> None:
    """Raise SceneError if a value is not lawful."""
    if not lawful.all():
        row = int(np.argmin(np.where(lawful, np.inf, values)))
        raise SceneError(f"{found} = {values[row]:.6g} {at.place(row)}; {rule}.")


@dataclass(frozen=True, eq=False)
class At:
    """Points x (m, dim) and a time t at which data are evaluated."""

    x: Floats
    t: float | None = None

    def read(self, value: Any, subject: str, shape: str = "number") -> Floats:
        """Return one number, vector or tensor per point, according to `shape`."""
        m, dim = self.x.shape
        names = component_names(dim)
        count, words = (dim, "") if shape == "vector" else (len(names), f" ({', '.join(names)})")
        row = () if shape == "number" else (count,)
        wanted = f"{count} components{words}, or an array {(m, *row)}, one row per point"
        wanted = wanted if row else f"a number, or one per point, shape ({m},)"
        return _check_values(_call(value, (self.x, self.t), subject), (m, *row), subject, wanted, self.place)

    def place(self, row: int) -> str:
        return f"at {self.x[row]}" + ("" if self.t is None else f" and t = {self.t:.6g}")


def scalar(value: Datum | Constant, x: Floats, t: float | None, subject: str) -> Floats:
    """Return the values (m,) of a scalar datum at m points."""
    return At(x, t).read(value, subject)


def vector(value: Datum | Constant, x: Floats, t: float | None, subject: str) -> Floats:
    """Return the values (m, dim) of a vector datum at m points."""
    return At(x, t).read(value, subject, "vector")


def tensor(value: Datum, x: Floats, t: float, subject: str) -> Floats:
    """Return the values (m, components) of a symmetric tensor at m points."""
    return At(x, t).read(value, subject, "tensor")


def coefficient(value: Constant, x: Floats, subject: str) -> Floats:
    """Return the values (m,) of a number or a function f(x) at m points."""
    return At(x).read(value, subject)


def read_numbers(raw: object, m: int, subject: str) -> Floats:
    """Return one number for each of m rows."""
    return np.full(m, as_shaped_array(raw, subject, f"a number, or one per row, shape ({m},)", (), (m,)))


def read_finite(raw: object, m: int, subject: str) -> Floats:
    """Return one finite number for each of m rows."""
    return finite(read_numbers(raw, m, subject), subject)


def read_weights(raw: object, m: int, subject: str) -> Floats:
    """Return one friction weight, finite or infinite, for each of m rows."""
    found = read_numbers(raw, m, subject)
    finite(np.where(found == np.inf, 0.0, found), subject)
    return found


def varies(*values: object) -> bool:
    """Return True if some value is a function."""
    return any(callable(value) for value in values)


@dataclass(frozen=True, eq=False)
class InCells:
    """Points at which material constants are evaluated, by default all centroids."""

    mesh: Mesh
    x: Floats | None = None
    cells: Ints | None = None
    inside: Bools | None = None  # mask of the cells of the material

    def read(self, value: Constant, subject: str) -> Floats:
        """Return the values (k,) of a constant at k points."""
        mesh, raw, count = self.mesh, value, self.mesh.n_cells
        if isinstance(value, str):
            if value not in mesh.cell_data:
                known = ", ".join(repr(name) for name in mesh.cell_data) or "none"
                add = "Add one with mesh.with_cell_data(name, values)"
                raise SceneError(f"{subject}: the mesh has no cell datum named {value!r}; it has {known}. {add}.")
            raw = mesh.cell_data[value]
        elif callable(value):
            x = mesh.centroids if self.x is None else self.x
            count, raw = len(x), _call(value, (x, None), subject)
        found = _check_values(raw, (count,), subject, f"a number, or one per cell, shape ({count},)", self.place)
        return found if callable(value) or self.cells is None else found[self.cells]

    def place(self, row: int) -> str:
        return f"in cell {row}"


def _call(value: Any, at: tuple[Floats, float | None], subject: str) -> Any:
    if not callable(value):
        return value
    x, t = at
    failed = f"{subject}: its function failed when called as f(x{', t' * (t is not None)}) with x of shape {x.shape}"
    wanted = "take all points at once and return one value per point"
    return call_function(value, (x,) if t is None else (x, t), failed, wanted)


def _check_values(raw: Any, shape: tuple[int, ...], subject: str, wanted: str, place: Callable[[int], str]) -> Floats:
    array = as_real_array(raw, subject, wanted)
    # A single value holds at all points.
    if array.shape not in (shape, shape[1:]):
        raise SceneError(f"{subject}: found {shape_in_words(array)}; wanted {wanted}.")
    whole = array if array.shape == shape else np.array(np.broadcast_to(array, shape))
    bad = ~np.isfinite(whole)
    if bad.any():
        first = int(np.argwhere(bad)[0, 0])
        raise SceneError(
            f"{subject}: found NaN or infinity in {np.count_nonzero(bad)} of {bad.size} values, first {place(first)}; "
            "all must be finite."
        )
    return whole
