"""Contact without separation, u . n = 0 on Gamma_C, the first line of (3.6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vemcvx.effects.contribution import ContactSurface, Contribution, Support
from vemcvx.effects.effect import Effect, where
from vemcvx.vem import Space


@dataclass(frozen=True)
class BilateralContact(Effect):
    """Contact without separation: u . n = 0 at the nodes of `on`.

    The contact boundary Gamma_C may be inclined. At a corner u . n = 0 for both normals, which fixes the node; sides
    that turn by less than 42.5 degrees are a curve, along which nodes slide. Clamps and prescribed displacements take
    precedence at nodes that they share with contact.

    Parameters
    ----------
    on : str or sequence of str
        Names of boundaries, or of interfaces between bodies: u is then that of the first body relative to the second,
        and n the outward normal of the first.
    """

    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        rows = space.part(self.on, "BilateralContact", contact=True).node_normals
        support = Support(
            subject="BilateralContact",
            nodes=rows.nodes,
            directions=rows.normals,
            points=space.mesh.points[rows.nodes],
            contact=True,
            partners=rows.partners,
        )
        curves = (f"BilateralContact on {where(self.on)}",) if rows.curved else ()
        return Contribution(supports=(support,), surfaces=(ContactSurface.of(rows),), curves=curves)

    def describe(self) -> str:
        return f"BilateralContact: u.n = 0 on {where(self.on)}"
