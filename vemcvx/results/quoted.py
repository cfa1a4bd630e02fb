"""Numbers that one quotes of a run: extremes over its history, and energies with their estimated errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats


@dataclass(frozen=True)
class Extreme:
    """An extreme value of a field over all stored steps.

    Attributes
    ----------
    key : str
        "displacement", "von_mises", "largest_principal_stress", "smallest_principal_stress", "slip", "friction" or
        "pressure".
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
    """

    key: str
    name: str
    value: float
    unit: str
    place: Floats
    time: float
    step: int


@dataclass(frozen=True)
class Quantity:
    """A quantity over a whole run with its estimated error.

    Attributes
    ----------
    value : float
        Of second order in the steps.
    steps, mesh : float
        The estimated errors that time steps and mesh make in it; `mesh` is NaN in space, where no mesh is refined.
    unit : str
        In words.
    """

    value: float
    steps: float
    mesh: float
    unit: str

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
        mesh = "mesh not estimated" if np.isnan(self.mesh) else f"mesh {self.mesh:.2g}"
        return (
            f"{self.value:.6g}, error estimated {self.error:.2g}, {self.relative:.2%} (steps {self.steps:.2g}, {mesh})"
        )
