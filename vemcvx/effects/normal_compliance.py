"""Contact with an obstacle that gives way: pressure = stiffness times depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.effects import data
from vemcvx.effects.contribution import Contribution
from vemcvx.effects.effect import Effect, amount, where
from vemcvx.effects.unilateral_contact import obstacle
from vemcvx.errors import SceneError
from vemcvx.vem import Space


@dataclass(frozen=True)
class NormalCompliance(Effect):
    """The obstacle's asperities are springs: the pressure on the body is p = stiffness (u . n - gap)_+.

    The energy int stiffness / 2 (u . n - gap)_+^2 ds, lumped at the nodes, is part of the history's energy. Martins and
    Oden, *Existence and uniqueness results for dynamic contact problems with nonlinear normal and friction interface
    laws* (Nonlinear Anal. 11, 1987), with their exponent m_n = 1; the rigid obstacle is the limit of large stiffness.

    Parameters
    ----------
    stiffness : number or callable f(x, t) -> (m,)
        Pressure per depth, force per length^3 (unit thickness: force per length^2 per length), > 0; fixed in time (f
        is evaluated at t = 0).
    on : str or sequence of str
        Boundary names.
    gap : number or callable f(x, t) -> (m,)
        Distance to the obstacle along the outward normal before anything moves, >= 0.
    """

    stiffness: data.Datum
    on: str | Sequence[str]
    gap: data.Datum = 0.0

    def contribute(self, space: Space) -> Contribution:
        subject = f"NormalCompliance on {where(self.on)}"
        rows = space.part(self.on, "NormalCompliance").corners
        points = space.mesh.points[rows.nodes]
        stiffness = data.scalar(self.stiffness, points, 0.0, f"{subject}: stiffness")
        if (stiffness <= 0).any():
            worst = int(np.argmin(stiffness))
            raise SceneError(
                f"{subject}: found the stiffness {stiffness[worst]:.6g} at {points[worst]}; it must be > 0. "
                "UnilateralContact is the rigid obstacle; leave the effect out for none."
            )
        return obstacle(space, rows, subject, self.gap, 1.0 / (stiffness * rows.lengths))

    def describe(self) -> str:
        return (
            f"NormalCompliance: pressure = {amount(self.stiffness)} times the depth beyond {amount(self.gap)} on "
            f"{where(self.on)}"
        )
