"""Numbers that one quotes of a run: extremes over its history, and energies with their estimated errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

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
        Why the value means nothing but on this mesh, as it grows when the mesh is refined: it sits at a corner or a
        jump of data (:mod:`vemcvx.results.corners`), or grew from mesh to mesh; empty if nothing is known against it.
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
    """The sentence where the values on ever finer meshes grow at a rate that hardly falls; empty where they do not.

    `sizes` are of the cells where the values stand, from the coarsest mesh on. Towards a limit the rates
    log(v_k+1 / v_k) / log(h_k / h_k+1) fall by half, or by 2^.5, where cells are halved; where stress grows like r^-a
    they come near a. Two rates tell: the last is at least .05, and .75 of the one before. Meshes on which the size h is
    that of the one before say nothing new.
    """
    finer = [(h, abs(v)) for h, v in zip(sizes, values, strict=True) if v]
    kept: list[tuple[float, float]] = []
    for h, v in finer:
        if kept and h > 0.75 * kept[-1][0]:
            kept = kept[:-1]
        kept.append((h, v))
    rates = [np.log(w / v) / np.log(g / h) for (g, v), (h, w) in pairwise(kept) if g > h]
    if len(rates) < 2 or rates[-1] < 0.05 or rates[-1] < 0.75 * rates[-2]:
        return ""
    listed = ", ".join(f"{v:.3g}" for _, v in kept[-4:])
    return f"grew from mesh to mesh at a rate that hardly falls: {listed}"


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
        Why the largest wear is a number of this mesh alone, which grows as the mesh is refined; empty where no reason
        is known.
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
        mesh = "mesh not estimated" if np.isnan(self.mesh) else f"mesh {self.mesh:.2g}"
        but = f"; {self.unbounded}" if self.unbounded else ""
        return (
            f"{self.value:.6g}, error estimated {self.error:.2g}, {self.relative:.2%} (steps {self.steps:.2g}, {mesh})"
            f"{but}"
        )
