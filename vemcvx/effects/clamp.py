"""u = 0 on a part of the boundary, (3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.effects.contribution import Contribution, Support
from vemcvx.effects.effect import Effect, where
from vemcvx.vem import Space


@dataclass(frozen=True)
class Clamp(Effect):
    """Fixed boundary: u = 0 at every node of the edges `on`, end points included, (3.3).

    Parameters
    ----------
    on : str or sequence of str
        Boundary names.
    """

    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        nodes = space.part(self.on, "Clamp").nodes
        dim = space.mesh.points.shape[1]
        repeated = np.repeat(nodes, dim)
        axes = np.tile(np.eye(dim), (len(nodes), 1))
        return Contribution(supports=(Support("Clamp", repeated, axes, space.mesh.points[repeated]),))

    def describe(self) -> str:
        return f"Clamp: u = 0 on {where(self.on)}"
