"""Given displacements u = value on a part of the boundary: all components, or one direction of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats, Ints, as_real_array, brief
from vemcvx.effects import data
from vemcvx.effects.contribution import Contribution, GivenDatum, Support
from vemcvx.effects.effect import Effect, amount, where
from vemcvx.errors import SceneError
from vemcvx.vem import Part, Space


@dataclass(frozen=True)
class PrescribedDisplacement(Effect):
    """Given displacements of a part of the boundary: all components, or one.

    `history.reaction` is the force that they take.

    Parameters
    ----------
    value : constant or callable
        With ``direction=None`` the whole vector, (dim,) or f(x, t) -> (m, dim), in units of length; otherwise
        the one component u . direction, a number or f(x, t) -> (m,).
    on : str or sequence of str
        Boundary names.
    direction : None, (dim,) vector, "normal" or "tangent"
        "normal" is outward; "tangent" is, in the plane, the normal turned by +90 degrees, so that the body lies on its
        left. A vector is normalised. At a corner of `on` both normals (tangents) are prescribed; sides that turn by
        less than 42.5 degrees are a curve: its nodes move so that all sides go outward by the value.
    """

    value: data.Datum
    on: str | Sequence[str]
    direction: str | Sequence[float] | None = None

    def contribute(self, space: Space) -> Contribution:
        subject = f"PrescribedDisplacement on {where(self.on)}"
        part = space.part(self.on, "PrescribedDisplacement")
        if self.direction is None:
            whole = self._whole(part.nodes, space.mesh.points[part.nodes], subject)
            return Contribution(supports=(whole,), given=self._given(part, data.vector, subject))
        nodes, directions, cosines = self._rows(part, space, subject)
        points = space.mesh.points[nodes]

        def value(t: float) -> Floats:
            return data.scalar(self.value, points, t, subject) / cosines

        support = Support(subject, nodes, directions, points, self._unless_zero(value))
        curved = isinstance(self.direction, str) and part.node_normals.curved
        given = self._given(part, data.scalar, subject)
        return Contribution(supports=(support,), given=given, curves=(subject,) if curved else ())

    def _given(self, part: Part, read: Callable[..., Floats], subject: str) -> tuple[GivenDatum, ...]:
        def at(x: Floats, t: float) -> Floats:
            return read(self.value, x, t, subject)

        return (GivenDatum(subject, "displacement", at, part.sides),) if data.varies(self.value) else ()

    def describe(self) -> str:
        held = "" if self.direction is None else f" along {self.direction}"
        return f"PrescribedDisplacement: u = {amount(self.value)}{held} on {where(self.on)}"

    def _whole(self, nodes: Ints, points: Floats, subject: str) -> Support:
        dim = points.shape[1]

        def value(t: float) -> Floats:
            return data.vector(self.value, points, t, subject).ravel()

        repeated = np.repeat(nodes, dim)
        axes, places = np.tile(np.eye(dim), (len(nodes), 1)), np.repeat(points, dim, axis=0)
        return Support(subject, repeated, axes, places, self._unless_zero(value))

    def _unless_zero(self, value: Callable[[float], Floats]) -> Callable[[float], Floats] | None:
        """None for a constant of zero, which holds its nodes as a clamp or rollers do."""
        return value if data.varies(self.value) or value(0.0).any() else None

    def _rows(self, part: Part, space: Space, subject: str) -> tuple[Ints, Floats, Floats]:
        """Nodes, directions, and by which the values of sides are to be divided."""
        if isinstance(self.direction, str):
            rows = part.node_normals
            if self.direction == "normal":
                return rows.nodes, rows.normals, rows.cosines
            if self.direction == "tangent":
                space.require_plane(f"{subject}: direction 'tangent'", "give a vector along the boundary")
                return rows.nodes, rows.tangents, np.ones(len(rows.nodes))
            raise SceneError(
                f"{subject}: found direction {self.direction!r}; there are 'normal', 'tangent', a vector, "
                "or None (all components)."
            )
        dim = part.normals.shape[1]
        wanted = f"a nonzero vector of {dim} finite components, 'normal', 'tangent', or None (all components)"
        direction = as_real_array(self.direction, f"{subject}: direction", wanted)
        if direction.shape != (dim,) or not np.isfinite(direction).all() or not direction.any():
            raise SceneError(f"{subject}: found direction {brief(self.direction)}; wanted {wanted}.")
        # Its largest component first: the square of 1e200 would overflow.
        direction = direction / np.abs(direction).max()
        directions = np.tile(direction / np.linalg.norm(direction), (len(part.nodes), 1))
        return part.nodes, directions, np.ones(len(part.nodes))
