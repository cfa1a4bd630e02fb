"""Volume forces -div sigma = f_1, (3.2), by the paper's rule: (Pi_0^0 f_1, average of the vertex values)."""

from __future__ import annotations

from dataclasses import dataclass

from vemcvx.effects.contribution import Contribution, Load
from vemcvx.effects.data import Datum
from vemcvx.effects.effect import Effect, amount
from vemcvx.vem import Space, cell_load


@dataclass(frozen=True)
class BodyForce(Effect):
    """A force per unit area (and unit thickness), in space per volume: <l^h, v> = sum_K int_K Pi_0^0 f_1 . v_hat.

    v_hat is the average of the vertex values of v on K, as in Section 3 of the paper (before (3.14)). The sum of these
    forces is exact for constant ones; their torque is so on cells whose centroid is the mean of their vertices, such as
    boxes and simplices, and else within h times the force.

    Parameters
    ----------
    force : (dim,) constant, or callable f(x, t) -> (m, dim)
        Cartesian components, force per area, evaluated at t_n.
    """

    force: Datum

    def contribute(self, space: Space) -> Contribution:
        points, matrix, cells = cell_load(space)
        load = Load("BodyForce", points, matrix, self.force, cells)
        return Contribution(loads=(load,), given=load.given)

    def describe(self) -> str:
        return f"BodyForce: {amount(self.force)} in the body"
