"""Numbers that one quotes of a run: extremes over its history, and energies with their estimated errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.base.arrays import Floats


@dataclass(frozen=True)
class Extreme:
    """An extreme value of a field over all stored steps.

    Attributes
    ----------
    key : str
        "displacement", "von_mises", "largest_principal_stress", "smallest_principal_stress", "slip", "friction",
        "pressure" or "pressure_recovered".
    name : str
        The same in words, such as "largest von Mises stress".
    value : float
    unit : str
        In words, such as "force/length²".
    place : (dim,)
        The node, or the centroid of the cell, where it was reached first.
    time : float
        The instant.
    step : int
        The step that ends there.
    unbounded : str
        Why the value may mean nothing but on this mesh: it sits at a corner or a point load
        (:mod:`vemcvx.results.corners`), or grew from mesh to mesh; empty if nothing is known against it.
    """

    key: str
    name: str
    value: float
    unit: str
    place: Floats
    time: float
    step: int
    unbounded: str = ""


ON_CONTACT = "friction", "pressure", "pressure_recovered"  # Keys of the extremes of forces on nodes of contact.
SINGULAR = "von_mises", "largest_principal_stress", "smallest_principal_stress", *ON_CONTACT
"""Keys of the extremes that may have no limit."""


def growth(sizes: Sequence[float], values: Sequence[float]) -> str:
    """The sentence that the value on the last mesh has grown since cells were larger; empty where it has not.

    `sizes` are of the cells where the values stand, from the coarsest mesh on. The last value is compared with that of
    the last mesh whose cells were at least half as large again, and told if it grew faster than h^-.05.
    """
    finer = [(h, abs(v)) for h, v in zip(sizes, values, strict=True) if v]
    if not finer:
        return ""
    (h, value), before = finer[-1], [(g, w) for g, w in finer if g >= 1.5 * finer[-1][0]]
    if not before or value <= before[-1][1] * (before[-1][0] / h) ** 0.05:
        return ""
    return f"grew by a factor {value / before[-1][1]:.3g} from h = {before[-1][0]:.3g} to {h:.3g}"


@dataclass(frozen=True)
class Quantity:
    """A quantity over a whole run with its estimated error.

    Attributes
    ----------
    value : float
        Of second order in the steps, of first where slip turns in space (:mod:`vemcvx.estimate.quantities`).
    steps, mesh : float
        The estimated errors that time steps and mesh make in it; `mesh` is NaN in space where a
        cell is not star-shaped about its centroid, so that no mesh is refined.
    unit : str
        In words.
    unbounded : str
        Why the largest wear may be a number of this mesh alone, which grows as the mesh is refined; empty where no
        reason is known.
    """

    value: float
    steps: float
    mesh: float
    unit: str
    unbounded: str = ""

    @property
    def error(self) -> float:
        """The sum of the two; that of the steps alone where nothing is known of the mesh."""
        return self.steps if np.isnan(self.mesh) else self.steps + self.mesh

    @property
    def relative(self) -> float:
        """The error as a part of the value; 0 where both are zero, 1 where the value alone is."""
        return self.error / (abs(self.value) or self.error or 1.0)

    @property
    def words(self) -> str:
        """The value with its error and the parts of that."""
        but = f"; {self.unbounded}" if self.unbounded else ""
        if np.isnan(self.mesh):
            return f"{self.value:.6g}, error of steps estimated {self.steps:.2g}, that of the mesh is not known{but}"
        parts = f"(steps {self.steps:.2g}, mesh {self.mesh:.2g}){but}"
        return f"{self.value:.6g}, error estimated {self.error:.2g}, {self.relative:.2%} {parts}"
