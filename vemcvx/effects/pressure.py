"""A pressure p on a part of the boundary: sigma n = -p n, the traction f_2 = -p n of (3.4).

n is the outward normal of the undeformed edge or face: the pressure does not follow the body (small displacements).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.effects.contribution import Contribution, Load
from vemcvx.effects.data import Datum
from vemcvx.effects.effect import Effect, amount, where
from vemcvx.vem import Space, edge_load


@dataclass(frozen=True)
class Pressure(Effect):
    """Pressure on a part of the boundary: the load -int p n . v ds, exact for affine p, as of Traction.

    Parameters
    ----------
    value : number, or callable f(x, t) -> (m,)
        p, force per length (and unit thickness), in space per area, evaluated at t_n; compression positive, suction
        negative.
    on : str or sequence of str
        Boundary names; at a corner the pressure acts on each side along its own normal.
    """

    value: Datum
    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        part = space.part(self.on, "Pressure")
        points, matrix, sides = edge_load(space, part)
        (q, dim), normals = points.shape, part.normals[sides]
        inward = sp.csr_matrix((-normals.ravel(), (np.arange(q * dim), np.repeat(np.arange(q), dim))))
        subject = f"Pressure on {where(self.on)}"
        load = Load(subject, points, matrix @ inward, self.value, edges=part.sides[sides])
        return Contribution(loads=(load,), given=load.given)

    def describe(self) -> str:
        return f"Pressure: {amount(self.value)} on {where(self.on)}"
