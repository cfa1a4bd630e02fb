"""Surface forces sigma n = f_2 on a part of the boundary, (3.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vemcvx.effects.contribution import Contribution, Load
from vemcvx.effects.data import Datum
from vemcvx.effects.effect import Effect, amount, where
from vemcvx.vem import Space, edge_load


@dataclass(frozen=True)
class Traction(Effect):
    """A force per unit length (and unit thickness), int f_2 . v ds, exact for affine f_2 on every edge.

    Parameters
    ----------
    force : (2,) constant, or callable f(x, t) -> (m, 2)
        Cartesian components, force per length, evaluated at t_n.
    on : str or sequence of str
        Boundary names.
    """

    force: Datum
    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        points, matrix = edge_load(space, space.part(self.on, "Traction"))
        return Contribution(loads=(Load(f"Traction on {where(self.on)}", points, matrix, self.force),))

    def describe(self) -> str:
        return f"Traction: {amount(self.force)} on {where(self.on)}"
