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
    """Surface force per length (and unit thickness), in space per area: the load int f_2 . v ds, exact for affine f_2.

    Parameters
    ----------
    force : (dim,) constant, or callable f(x, t) -> (m, dim)
        Cartesian components, force per length (area), evaluated at t_n.
    on : str or sequence of str
        Boundary names.
    """

    force: Datum
    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        part = space.part(self.on, "Traction")
        points, matrix, sides = edge_load(space, part)
        load = Load(f"Traction on {where(self.on)}", points, matrix, self.force, edges=part.sides[sides])
        return Contribution(loads=(load,), given=load.given)

    def describe(self) -> str:
        return f"Traction: {amount(self.force)} on {where(self.on)}"
