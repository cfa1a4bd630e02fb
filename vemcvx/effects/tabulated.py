"""A datum given by a table: values at instants, linear in time between them and the same everywhere in the body."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, as_real_array, brief, read_only, shape_in_words
from vemcvx.errors import SceneError


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
            raise SceneError(
                f"Tabulated: asked for t = {t:.6g}, which its table from {first:.6g} to {last:.6g} does not cover; add "
                "rows, or choose times within it."
            )
        if self.values.ndim == 1:
            return float(np.interp(t, self.times, self.values))
        return np.array([np.interp(t, self.times, column) for column in self.values.T])

    @property
    def __name__(self) -> str:
        """What words on a scene call it."""
        return repr(self)

    def __repr__(self) -> str:
        return f"Tabulated({len(self.times)} instants from {self.times[0]:.6g} to {self.times[-1]:.6g})"
