"""Initial stress: sigma = C eps(u) + sigma_0.

It enters the principle of virtual work as the load -int sigma_0 : eps(v), on cells -sum_K |K| sigma_0 : eps(Pi v).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from vemcvx.arrays import Floats
from vemcvx.effects import data
from vemcvx.effects.contribution import Contribution, GivenDatum, InitialStress
from vemcvx.effects.effect import Effect, amount
from vemcvx.vem import Space


@dataclass(frozen=True)
class Prestress(Effect):
    """Initial stress: a stress at zero strain, such as that of tendons or growth.

    `history.stress` includes it. A body that is fixed everywhere keeps it; a free body relaxes from a uniform one
    completely. `history.energy` remains 1/2 a^h(u, u), and `history.work` includes the work of the initial stress, as
    of a load. If the stress is nonzero at times[0], u = 0 is in equilibrium only if supports bear it: begin with
    ``initial="settled"`` or "equilibrium".

    Parameters
    ----------
    stress : (3,) constant, or callable f(x, t) -> (m, 3)
        xx, yy, xy, in space (6,): xx, yy, zz, xy, yz, xz; force per area, tension positive, at centroids and t_n.
    """

    stress: data.Datum

    def contribute(self, space: Space) -> Contribution:
        centroids = space.mesh.centroids

        def at(x: Floats, t: float) -> Floats:
            return data.tensor(self.stress, x, t, "Prestress")

        given = (GivenDatum("Prestress", "stress", at),) if data.varies(self.stress) else ()
        return Contribution(initial_stresses=(InitialStress("Prestress", partial(at, centroids)),), given=given)

    def describe(self) -> str:
        return f"Prestress: {amount(self.stress)} in the body"
