"""Numbers to quote from a run: extreme values, and quantities with estimated errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.base.arrays import Floats


@dataclass(frozen=True)
class Extreme:
    """An extreme value of a field over all stored steps."""

    key: str  # "displacement", "von_mises", "largest_principal_stress", ..., "slip", "friction", "pressure_recovered"
    name: str  # the key in words, such as "largest von Mises stress"
    value: float
    unit: str  # in words, such as "force/length²"
    place: Floats  # the node, or the centroid of the cell
    time: float
    step: int  # the first step at which the value is reached
    unbounded: str = ""
    """Why the value may grow as the mesh is refined (:mod:`vemcvx.results.corners`); empty if no reason is known."""


ON_CONTACT = "friction", "pressure", "pressure_recovered"  # keys of contact forces
SINGULAR = "von_mises", "largest_principal_stress", "smallest_principal_stress", *ON_CONTACT
"""Keys of extremes that may grow without limit as the mesh is refined."""


def growth(sizes: Sequence[float], values: Sequence[float]) -> str:
    """Return a sentence if values grow as meshes are refined, or else an empty string.

    Let n be the last mesh, and i the last mesh with the cell size h_i >= 1.5 h_n. The values v grow if
    |v_n| > |v_i| (h_i / h_n)^.05.
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
    """A quantity of a whole run, and its estimated error.

    Attributes
    ----------
    value : float
        Of second order in the time step; of first order with dashpots, or if the slip of a body in space turns.
    steps, mesh : float
        The estimated errors of the value due to time steps and mesh; `mesh` is NaN if the mesh cannot be refined.
    unit : str
        In words, such as "energy".
    unbounded : str
        Why the largest wear may grow as the mesh is refined; empty if no reason is known.

    Examples
    --------
    >>> vx.Quantity(value=2.0, steps=0.01, mesh=0.03, unit="energy").words
    '2, estimated error 0.04, 2.00% (steps 0.01, mesh 0.03)'
    """

    value: float
    steps: float
    mesh: float
    unit: str
    unbounded: str = ""

    @property
    def error(self) -> float:
        """The sum of the errors of steps and mesh; an unknown error of the mesh counts as zero."""
        return self.steps if np.isnan(self.mesh) else self.steps + self.mesh

    @property
    def relative(self) -> float:
        """The quotient error / |value|, with 0 / 0 = 0. If only the value is 0, the quotient is 1."""
        return self.error / (abs(self.value) or self.error or 1.0)

    @property
    def words(self) -> str:
        """The value and the errors in words."""
        but = f"; {self.unbounded}" if self.unbounded else ""
        if np.isnan(self.mesh):
            return f"{self.value:.6g}, estimated error of steps {self.steps:.2g}, error of the mesh unknown{but}"
        parts = f"(steps {self.steps:.2g}, mesh {self.mesh:.2g}){but}"
        return f"{self.value:.6g}, estimated error {self.error:.2g}, {self.relative:.2%} {parts}"
