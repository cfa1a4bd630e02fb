"""Contact with a compliant obstacle: pressure = stiffness times penetration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.effects import data
from vemcvx.effects.contribution import Contribution, GivenDatum
from vemcvx.effects.effect import Effect, amount, where
from vemcvx.effects.unilateral_contact import distance, obstacle
from vemcvx.errors import SceneError
from vemcvx.vem import Space


@dataclass(frozen=True)
class NormalCompliance(Effect):
    """Contact with a compliant obstacle: the pressure on the body is p = stiffness (u . n - gap)_+.

    The energy int stiffness / 2 (u . n - gap)_+^2 ds, lumped at the nodes, is part of `history.energy`. This is the law
    of Martins and Oden, *Existence and uniqueness results for dynamic contact problems with nonlinear normal and
    friction interface laws* (Nonlinear Anal. 11, 1987), with the exponent m_n = 1. As the stiffness grows, the obstacle
    becomes rigid. Clamps and prescribed displacements take precedence at nodes whose normal displacement they hold:
    there is no such spring there.

    Parameters
    ----------
    stiffness : number or callable f(x, t) -> (m,)
        Pressure per penetration, force per length^2 (and unit thickness), > 0; fixed in time (f is evaluated at
        t = 0).
    on : str or sequence of str
        Names of boundaries, or of interfaces between bodies: u is then that of the first body relative to the second,
        and n the outward normal of the first.
    gap : number or callable f(x, t) -> (m,)
        Distance to the obstacle along the outward normal before anything moves. Negative where they overlap: the body
        is then pressed back, either from the start with ``initial="settled"``, or by a gap that falls from zero.
    """

    stiffness: data.Datum
    on: str | Sequence[str]
    gap: data.Datum = 0.0

    def contribute(self, space: Space) -> Contribution:
        subject = f"NormalCompliance on {where(self.on)}"
        part = space.part(self.on, "NormalCompliance", contact=True)
        rows = part.node_normals

        def stiffness(x: Floats) -> Floats:
            found = data.scalar(self.stiffness, x, 0.0, f"{subject}: stiffness")
            if (found <= 0).any():
                worst = int(np.argmin(found))
                raise SceneError(
                    f"{subject}: found the stiffness {found[worst]:.6g} at {x[worst]}; it must be > 0. "
                    "UnilateralContact is the rigid obstacle; leave the effect out for none."
                )
            return found

        def spring(x: Floats, t: float, outward: Floats) -> Floats:
            k = stiffness(x)
            return np.stack([k * np.maximum(outward - distance(self.gap, subject, x, t), 0.0), k])

        # On a curve edges that move out by d move the node by d over the cosine, and push with as much less along n.
        compliance = 1.0 / (stiffness(space.mesh.points[rows.nodes]) * rows.lengths * rows.cosines**2)
        made = obstacle(space, rows, subject, self.gap, compliance)
        given = GivenDatum(subject, "spring", spring, part.sides)
        return replace(made, given=(given,) if data.varies(self.stiffness, self.gap) else ())

    def describe(self) -> str:
        return (
            f"NormalCompliance: pressure = {amount(self.stiffness)} times the depth beyond {amount(self.gap)} on "
            f"{where(self.on)}"
        )
