"""A user-defined friction effect with any law of slip."""

from __future__ import annotations

from dataclasses import dataclass, replace

import vemcvx as vx
from vemcvx.effects import ContactSurface, Contribution, Friction


@dataclass(frozen=True)
class Law(vx.Effect):
    """Friction with any slip law: `bound` returns bounds per length, and `directions` maps normals to directions."""

    bound: object
    softening: float | None = None
    pressed: bool = False
    on: str = "bottom"
    slope: object = None
    directions: object = None

    def contribute(self, space):
        rows = space.part(self.on, "Law", contact=True).node_normals
        lengths = rows.lengths

        def weights(t, forces, before, slip):
            return self.bound(t, forces / lengths if self.pressed else forces, before, slip) * lengths

        softening = None if self.softening is None else self.softening * lengths
        friction = replace(Friction.from_rows(rows, "Law"), law=vx.Law(weights, softening, self.pressed, self.slope))
        if self.directions is not None:
            friction = replace(friction, directions=self.directions(friction.normals))
        return Contribution(frictions=(friction,), surfaces=(ContactSurface.from_rows(rows),))

    def describe(self):
        return f"Law: on {self.on}"
