"""Data of effects: numbers, arrays, functions of x and t, tables over time."""

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
from vemcvx.vem import component_names


class Tabulated:
    """Values at instants, for every datum f(x, t): loads, bounds, gaps, temperatures, prescribed displacements.

    Parameters
    ----------
    times : (k,) array
        At least two instants, increasing.
    values : (k,) or (k, components) array
        A number, or a vector, at each of them; units are those of the datum.

    Raises
    ------
    SceneError
        Times do not increase, values are not as many or not finite; when it is called at an instant that the table
        does not cover.

    Examples
    --------
    >>> import vemcvx as vx
    >>> pull = vx.Traction(vx.Tabulated([0.0, 1.0, 3.0], [[0.0, 0.0], [5.0, 0.0], [-5.0, 0.0]]), on="left")
    """

    def __init__(self, times: ArrayLike, values: ArrayLike):
        self.times = read_only(as_real_array(times, "Tabulated: times", "increasing instants").copy())
        self.values = read_only(as_real_array(values, "Tabulated: values", "one value, or one row, an instant").copy())
        shape = self.times.shape
        if len(shape) != 1 or shape[0] < 2 or not np.isfinite(self.times).all() or (np.diff(self.times) <= 0).any():
            raise SceneError(f"Tabulated: found times = {brief(times)}; wanted at least two instants, increasing.")
        if self.values.ndim not in (1, 2) or len(self.values) != shape[0] or not np.isfinite(self.values).all():
            raise SceneError(
                f"Tabulated: found values = {brief(values)}, {shape_in_words(self.values)}; wanted {shape[0]} finite "
                "values, or rows of them, one an instant."
            )

    def __call__(self, x: Floats, t: float) -> Any:
        """The value at the instant `t`, for all points."""
        first, last = self.times[0], self.times[-1]
        if not first <= t <= last:
            covers = f"which its table from {first:.6g} to {last:.6g} does not cover; add rows"
            raise SceneError(f"Tabulated: asked for t = {t:.6g}, {covers}.")
        if self.values.ndim == 1:
            return float(np.interp(t, self.times, self.values))
        return np.array([np.interp(t, self.times, column) for column in self.values.T])

    @property
    def __name__(self) -> str:
        """The name of the function in descriptions of a scene."""
        return repr(self)

    def __repr__(self) -> str:
        return f"Tabulated({len(self.times)} instants from {self.times[0]:.6g} to {self.times[-1]:.6g})"


# Data that a scene carries. Every value that reaches a matrix passes through here once: a wrong shape, a NaN or a wrong
# signature is one sentence, and no numpy traceback.
Datum = ArrayLike | Callable[[Floats, float], ArrayLike]  # A constant, or f(x, t).
Constant = ArrayLike | Callable[[Floats], ArrayLike]
"""A number, f(x), or of materials a value for each cell or the name of a cell datum (words are ArrayLike)."""


@dataclass(frozen=True)
class Holds:
    """What a field of an effect holds: a number or a vector a place, the sign of numbers, and the rule in words."""

    shape: str = "number"
    sign: str = ""  # "> 0", ">= 0", or none; of vectors "!= 0"
    rule: str = "it must be {sign}"

    def values(self, value: Any, at: At | InCells, subject: str, name: str, label: str | None = None) -> Floats:
        """Return the values of a field of this `name` at places; SceneError for a wrong shape or sign."""
        found = at.read(value, f"{subject}: {name}", self.shape)
        if isinstance(at, InCells) and at.inside is not None:
            found = np.where(at.inside, found, 1.0 if self.sign else 0.0)
        size = np.linalg.norm(found, axis=1) if self.shape == "vector" else found
        lawful = {"> 0": size > 0, ">= 0": size >= 0, "!= 0": size != 0}.get(self.sign, np.ones(len(size), dtype=bool))
        require(lawful, found, at, f"{subject}: found {label or name}", self.rule.format(sign=self.sign))
        return found


def holds(shape: str = "number", sign: str = "", rule: str = "it must be {sign}", **more: Any) -> dict[str, Any]:
    """Return the metadata of a field of an effect that holds data: `field(metadata=data.holds(sign="> 0"))`."""
    return {"holds": Holds(shape, sign, rule), **more}


def require(lawful: Bools, values: Floats, at: At | InCells, found: str, rule: str) -> None:
    """Raise SceneError at the place of the least value that is not lawful; of vectors at the first."""
    if not lawful.all():
        bad = np.flatnonzero(~lawful)
        row = int(bad[0] if values.ndim > 1 else bad[np.argmin(values[bad])])
        value = values[row] if values.ndim > 1 else f"{values[row]:.6g}"
        raise SceneError(f"{found} = {value} {at.place(row)}; {rule}.")


@dataclass(frozen=True, eq=False)
class At:
    """Points x (m, dim), and the instant t at which data are read; None for what does not change in time."""

    x: Floats
    t: float | None = None

    def read(self, value: Any, subject: str, shape: str = "number") -> Floats:
        """Return a number, a vector or a symmetric tensor for each point."""
        m, dim = self.x.shape
        names = component_names(dim)
        count, words = (dim, "") if shape == "vector" else (len(names), f" ({', '.join(names)})")
        row = () if shape == "number" else (count,)
        wanted = f"{count} components{words}, or an array {(m, *row)}, one row a point"
        wanted = wanted if row else f"a number, or ({m},) values, one a point"
        return _shaped(_call(value, (self.x, self.t), subject), (m, *row), subject, wanted, self.place)

    def place(self, row: int) -> str:
        """Return the place of a row in words."""
        return f"at {self.x[row]}" + ("" if self.t is None else f" and t = {self.t:.6g}")


def scalar(value: Datum | Constant, x: Floats, t: float | None, subject: str) -> Floats:
    """Return the values (m,) of a scalar datum at points `x` (m, dim) and the instant `t`, None if it is constant."""
    return At(x, t).read(value, subject)


def vector(value: Datum | Constant, x: Floats, t: float | None, subject: str) -> Floats:
    """Return the values (m, dim) of a vector datum, likewise."""
    return At(x, t).read(value, subject, "vector")


def tensor(value: Datum, x: Floats, t: float, subject: str) -> Floats:
    """Return the values (m, components) of a symmetric tensor, likewise."""
    return At(x, t).read(value, subject, "tensor")


def coefficient(value: Constant, x: Floats, subject: str) -> Floats:
    """Return the values (m,) of a scalar that does not change in time, a number or f(x), at the points `x` (m, dim)."""
    return At(x).read(value, subject)


def number_a_row(raw: object, m: int, subject: str) -> Floats:
    """Return a number for each of the m rows of a part."""
    return np.full(m, as_shaped_array(raw, subject, f"one number, or ({m},), one a row", (), (m,)))


def finite_a_row(raw: object, m: int, subject: str) -> Floats:
    """Return a finite number for each of the m rows of a part."""
    return finite(number_a_row(raw, m, subject), subject)


def weight_a_row(raw: object, m: int, subject: str) -> Floats:
    """Return the weight of friction of each of the m rows of a part: a number, or infinite where it always sticks."""
    found = number_a_row(raw, m, subject)
    finite(np.where(found == np.inf, 0.0, found), subject)
    return found


def varies(*values: object) -> bool:
    """Return True if one of the data is a function, of place or of time."""
    return any(callable(value) for value in values)


@dataclass(frozen=True, eq=False)
class InCells:
    """Points x (k, dim) of cells (k,) at which material constants are read; by default the centroids of all cells."""

    mesh: Mesh
    x: Floats | None = None
    cells: Ints | None = None
    inside: Bools | None = None  # of the places, those that count; elsewhere constants with a sign are 1, others 0

    def read(self, value: Constant, subject: str, shape: str = "number") -> Floats:
        """Values (k,) of a material constant: a number, a value a cell, f(x), or the name of a cell datum."""
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
        found = _shaped(raw, (count,), subject, f"a number, or ({count},) values, one a cell", self.place)
        return found if callable(value) or self.cells is None else found[self.cells]

    def place(self, row: int) -> str:
        """Return the place of a row in words."""
        return f"in cell {row}"


def _call(value: Any, at: tuple[Floats, float | None], subject: str) -> Any:
    if not callable(value):
        return value
    x, t = at
    failed = f"{subject}: its function failed when called as f(x{', t' * (t is not None)}) with x of shape {x.shape}"
    wanted = "take all points at once and return one value a point"
    return call_function(value, (x,) if t is None else (x, t), failed, wanted)


def _shaped(raw: Any, shape: tuple[int, ...], subject: str, wanted: str, place: Callable[[int], str]) -> Floats:
    array = as_real_array(raw, subject, wanted)
    # Only whole values broadcast: a vector over m points, a scalar over m points.
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
