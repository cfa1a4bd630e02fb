"""A line of symmetry, or a row of rollers: u . n = 0 and sigma_tau = 0.

A body that is loaded symmetrically about a straight side of its half moves along that side only and shears it not;
the half then stands for the whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vemcvx.effects.contribution import Contribution, Support
from vemcvx.effects.effect import Effect, where
from vemcvx.vem import Space


@dataclass(frozen=True)
class Symmetry(Effect):
    """Keep a piecewise straight part of the boundary on itself: u . n = 0, free to slide along.

    As a condition it is that of BilateralContact, but this is a support, no contact: it appears in `reaction`, never
    in `history.contact`, and gives way to nothing. A prescribed displacement that leaves the line at a shared node
    contradicts it. At a corner of `on` both normals hold, so the node is held altogether.

    Parameters
    ----------
    on : str or sequence of str
        Boundary names.
    """

    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        rows = space.part(self.on, "Symmetry").corners
        subject = f"Symmetry on {where(self.on)}"
        return Contribution(supports=(Support(subject, rows.nodes, rows.normals, space.mesh.points[rows.nodes]),))

    def describe(self) -> str:
        return f"Symmetry: u.n = 0, free along {where(self.on)}"
