"""A line of symmetry, or a row of rollers: u . n = 0 and sigma_tau = 0.

Under symmetric loads a body moves along its line of symmetry, without shear stress on it: half of the body is enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vemcvx.effects.contribution import Contribution, Support
from vemcvx.effects.effect import Effect, where
from vemcvx.vem import Space


@dataclass(frozen=True)
class Symmetry(Effect):
    """Line of symmetry, or rollers: u . n = 0 on a part of the boundary, which is free to slide.

    The condition is that of BilateralContact, but this is a support and not contact: its force is in `reaction`, it is
    not in `history.contact` (unless BilateralContact is there, too), and it does not yield to other supports. A
    prescribed displacement that contradicts it at a shared node is an error. At a corner u . n = 0 for both normals,
    which fixes the node; along sides that turn by less than 42.5 degrees, a curve, nodes slide. Contact on a curve that
    ends on a line of symmetry has the normals and pressures of the whole body there.

    Parameters
    ----------
    on : str or sequence of str
        Boundary names.
    """

    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        rows = space.part(self.on, "Symmetry").node_normals
        subject = f"Symmetry on {where(self.on)}"
        support = Support(subject, rows.nodes, rows.normals, space.mesh.points[rows.nodes])
        return Contribution(supports=(support,), curves=(subject,) if rows.curved else ())

    def describe(self) -> str:
        return f"Symmetry: u.n = 0, free along {where(self.on)}"
