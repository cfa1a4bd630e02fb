"""Friction by direction on a surface in space: an ellipse of forces, and the norm of slip that is dual to it.

With the bound g along a unit vector e of the surface and h across it, along c = n x e, friction q obeys

    (q_e / g)^2 + (q_c / h)^2 <= 1.

What it dissipates in the slip s is the largest work of such forces, by Cauchy and Schwarz on (q_e / g, q_c / h),

    max -q . s = |(g s_e, h s_c)| = g |(s_e, r s_c)|,   r = h / g,

and is attained where s is along the normal (q_e / g^2, q_c / h^2) of the ellipse: slip follows the force where that
acts along an axis only. (Michalowski and Mroz, *Associated and non-associated sliding rules in contact friction
problems*, Arch. Mech. 30, 1978.) It is the term of a disc with the weight g that reads slip by the vectors e and r c in
place of two orthonormal tangents: the same second-order cone, certificate and active sets. These vectors are rows of a
matrix that does not change in time; r must not, either.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.effects import data
from vemcvx.errors import SceneError
from vemcvx.vem import Space

UPRIGHT = 1e-6
"""Directions with so little of them along the surface, relative to their length, have none there."""
STEADY = 1e-9
"""Ratios that differ by rounding are one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ellipse:
    """The ellipses of friction at m rows of nodes and normals."""

    subject: str
    points: Floats
    """(m, 3)"""
    direction: Floats
    """(m, 3) vectors of any length, of which what is along the surface counts"""
    bounds: Callable[[float], tuple[Floats, Floats]]
    """t -> (m,) bounds along the direction and across it, in any unit"""
    names: tuple[str, str]
    """what they are called in messages"""
    steady: bool
    """True if they do not change in time"""

    @classmethod
    def of(
        cls,
        space: Space,
        subject: str,
        points: Floats,
        *,
        sides: tuple[data.Constant | None, data.Datum | None],
        along: tuple[str, data.Datum],
        read: Callable[[data.Datum, float, str], Floats],
    ) -> Ellipse | None:
        """The ellipses of an effect at points (m, 3); None if it has none.

        `sides` are the direction and the bound across it. The bound `along` the direction has a name; a datum is read
        at an instant, under a name, by `read` -> (m,).

        Raises
        ------
        SceneError
            One of the sides is missing, the body is plane, or the direction is no vector.
        """
        direction, across = sides
        if direction is None and across is None:
            return None
        if direction is None or across is None:
            missing, given = ("direction", "across") if direction is None else ("across", "direction")
            raise SceneError(f"{subject}: found {given}= without {missing}=; friction by direction takes both.")
        if space.in_plane:
            raise SceneError(
                f"{subject}: found direction= and across=, which belong to bodies in space; in the plane backward= of "
                "TrescaFriction tells the two ways of slip apart."
            )
        name, datum = along
        return cls(
            subject=subject,
            points=points,
            direction=data.vector_field(direction, points, f"{subject}: direction"),
            bounds=lambda t: (read(datum, t, name), read(across, t, f"{name} across")),
            names=(name, "across"),
            steady=not data.varies(datum, across),
        )

    def vectors(self, normals: Floats, times: Sequence[float]) -> Floats:
        """The vectors e and r c (m, 2, 3) of each row.

        Raises
        ------
        SceneError
            The direction is along the normal somewhere; r is infinite, or changes between any two of `times`.
        """
        size = np.linalg.norm(self.direction, axis=1)
        first = self.direction - np.einsum("mi,mi->m", self.direction, normals)[:, None] * normals
        length = np.linalg.norm(first, axis=1)
        upright = length <= UPRIGHT * size
        if upright.any():
            worst = int(np.argmax(upright))
            raise SceneError(
                f"{self.subject}: found direction = {self.direction[worst]} at {self.points[worst]}, where the normal "
                f"is {normals[worst]}; give a vector that is not across the surface."
            )
        first = first / length[:, None]
        return np.stack([first, self._ratio(times)[:, None] * np.cross(normals, first)], axis=1) + 0.0

    def _ratio(self, times: Sequence[float]) -> Floats:
        """r (m,), read at the first instant at which there is friction; 1 where there never is."""
        ratio = np.full(len(self.points), np.nan)
        for t in (0.0,) if self.steady or len(times) == 0 else times:
            along, across = self.bounds(float(t))
            new = np.isnan(ratio) & (along > 0)
            ratio[new] = across[new] / along[new]
            wanted = np.where(np.isnan(ratio), 0.0, ratio) * along
            apart = np.abs(across - wanted) > STEADY * np.maximum(across, wanted)
            if apart.any():
                self._refuse(int(np.argmax(apart)), float(t), along, across)
        return np.where(np.isnan(ratio), 1.0, ratio)

    def _refuse(self, row: int, t: float, along: Floats, across: Floats) -> None:
        one, other = self.names
        what = f"{one} = {along[row]:.6g} and {other} = {across[row]:.6g} at {self.points[row]} and t = {t:.6g}"
        why = f"{one} must be > 0 where {other} is" if along[row] == 0 else "their ratio must not change in time"
        raise SceneError(f"{self.subject}: found {what}; {why}.")
