"""Coulomb's law: the bound of friction is the coefficient times the pressure that contact finds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.effects import data
from vemcvx.effects.contribution import ContactSurface, Contribution, Floats, Friction, Given
from vemcvx.effects.data import varies
from vemcvx.effects.effect import Effect, amount, where
from vemcvx.errors import SceneError
from vemcvx.vem import Space


@dataclass(frozen=True)
class CoulombFriction(Effect):
    """|friction| <= coefficient * pressure, and friction against the slip where they are equal.

    Needs UnilateralContact or NormalCompliance on the same boundary. No energy has this law as its optimality
    condition; every step is a fixed point of convex Tresca problems, weights = coefficient * nodal pressure (Necas,
    Jarusek and Haslinger 1980; Licht, Pratt and Raous 1991), found by :mod:`vemcvx.stepping.fixed_point`. What is
    certified is the distance to a solution of the step: for small coefficients there is no other.

    At a node where parts meet each rubs with the share of the nodal force that its own edges bear. Nodes that a
    prescribed displacement drags along rub as those of TrescaFriction, with the pressure that ends the step; where it
    holds the normal, too, no pressure is known, and there is no friction.

    Parameters
    ----------
    coefficient : number or callable f(x, t) -> (m,)
        Coefficient of friction, >= 0, without unit.
    on : str or sequence of str
        Boundary names.
    cap : number or callable f(x, t) -> (m,), optional
        No friction exceeds this, force per length: |friction| <= min(coefficient * pressure, cap), as of a material
        that yields (Tresca's cap on Coulomb, after Orowan).
    """

    coefficient: data.Datum
    on: str | Sequence[str]
    cap: data.Datum | None = None

    def contribute(self, space: Space) -> Contribution:
        subject = f"CoulombFriction on {where(self.on)}"
        part = space.part(self.on, "CoulombFriction")
        rows = part.corners
        points = space.mesh.points[rows.nodes]

        def positive(value: data.Datum, x: Floats, t: float, name: str) -> Floats:
            found = data.scalar(value, x, t, f"{subject}: {name}")
            if (found < 0).any():
                worst = int(np.argmin(found))
                raise SceneError(
                    f"{subject}: found the {name} {found[worst]:.6g} at {x[worst]} and t = {t:.6g}; it must be >= 0."
                )
            return found

        def law(t: float, forces: Floats) -> Floats:
            bound = positive(self.coefficient, points, t, "coefficient") * np.maximum(forces, 0.0)
            return bound if self.cap is None else np.minimum(bound, positive(self.cap, points, t, "cap") * rows.lengths)

        def under(x: Floats, t: float, pressure: Floats) -> Floats:
            bound = positive(self.coefficient, x, t, "coefficient") * np.maximum(pressure, 0.0)
            return (bound if self.cap is None else np.minimum(bound, positive(self.cap, x, t, "cap")))[None]

        def slope(t: float, forces: Floats) -> Floats:
            mu = positive(self.coefficient, points, t, "coefficient")
            if self.cap is None:
                return mu
            return np.where(mu * forces < positive(self.cap, points, t, "cap") * rows.lengths, mu, 0.0)

        none = np.zeros(len(rows.nodes))
        return Contribution(
            frictions=(
                Friction(
                    *(subject, rows.nodes, rows.normals, rows.lengths), lambda t: none, law, ends=rows.ends, slope=slope
                ),
            ),
            surfaces=(ContactSurface(rows.nodes, rows.normals, rows.lengths, rows.ends),),
            given=(Given(subject, "bound", under, part.edges),) if varies(self.coefficient, self.cap) else (),
        )

    def describe(self) -> str:
        cap = "" if self.cap is None else f", at most {amount(self.cap)},"
        return f"CoulombFriction: |friction| <= {amount(self.coefficient)} times the pressure{cap} on {where(self.on)}"
