"""Coulomb's law: the friction bound is the coefficient times the contact pressure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.effects import data
from vemcvx.effects.contribution import ContactSurface, Contribution, Friction, GivenDatum, Ground
from vemcvx.effects.data import varies
from vemcvx.effects.effect import Effect, amount, where
from vemcvx.vem import Space


@dataclass(frozen=True)
class CoulombFriction(Effect):
    """Friction with a bound proportional to the contact pressure: |friction| <= coefficient * pressure.

    Friction below the bound sticks; at the bound it acts against the slip. The effect needs UnilateralContact or
    NormalCompliance on the same boundary.

    A step with Coulomb's law minimises no energy. It is a fixed point of convex Tresca problems with the weights
    coefficient * nodal pressure (Necas, Jarusek and Haslinger 1980; Licht, Pratt and Raous 1991), found by
    :mod:`vemcvx.stepping.fixed_point`. The certificate bounds the distance to a solution of the step, which is unique
    for small coefficients.

    Where two parts of the boundary meet at a node, each has friction according to the share of the nodal force on its
    own edges. Nodes that a prescribed displacement moves along the obstacle have friction as with TrescaFriction, for
    the pressure at the end of the step; if that displacement prescribes the normal component, too, the pressure is
    unknown and there is no friction.

    Parameters
    ----------
    coefficient : number or callable f(x, t) -> (m,)
        Coefficient of friction, >= 0, without unit.
    on : str or sequence of str
        Names of boundaries, or of interfaces between bodies: u is then that of the first body relative to the second,
        and n the outward normal of the first.
    cap : number or callable f(x, t) -> (m,), optional
        Largest friction, force per length: |friction| <= min(coefficient * pressure, cap), such as the shear strength
        of a material that yields (after Orowan).
    ground : callable f(x, t) -> (m, dim) or (dim,), optional
        How far the obstacle has moved, if it slides under the body: as of TrescaFriction.
    """

    coefficient: data.Datum
    on: str | Sequence[str]
    cap: data.Datum | None = None
    ground: data.Datum | None = None

    def contribute(self, space: Space) -> Contribution:
        subject = f"CoulombFriction on {where(self.on)}"
        part = space.part(self.on, "CoulombFriction", contact=True)
        rows = part.node_normals
        points = space.mesh.points[rows.nodes]

        def read(x: Floats, t: float) -> tuple[Floats, Floats]:
            mu = data.nonnegative(self.coefficient, x, t, subject, name="coefficient")
            if self.cap is None:
                return mu, np.full(len(x), np.inf)
            return mu, data.nonnegative(self.cap, x, t, subject, name="cap")

        def law(t: float, forces: Floats) -> Floats:
            mu, cap = read(points, t)
            return np.minimum(mu * np.maximum(forces, 0.0), cap * rows.lengths)

        def under(x: Floats, t: float, pressure: Floats) -> Floats:
            mu, cap = read(x, t)
            return np.minimum(mu * np.maximum(pressure, 0.0), cap)[None]

        def slope(t: float, forces: Floats) -> Floats:
            mu, cap = read(points, t)
            return np.where(mu * forces < cap * rows.lengths, mu, 0.0)

        ground = Ground.of(self.ground, subject, points, rows.partners)
        friction = replace(Friction.of(rows, subject), law=law, slope=slope, ground=ground)
        return Contribution(
            frictions=(friction,),
            surfaces=(ContactSurface.of(rows),),
            given=(
                *((GivenDatum(subject, "bound", under, part.sides),) if varies(self.coefficient, self.cap) else ()),
                *(() if ground is None else (ground.given(part.sides),)),
            ),
        )

    def describe(self) -> str:
        cap = "" if self.cap is None else f", at most {amount(self.cap)},"
        moved = "" if self.ground is None else f", ground moved by {amount(self.ground)}"
        bound = f"{amount(self.coefficient)} times the pressure{cap}"
        return f"CoulombFriction: |friction| <= {bound} on {where(self.on)}{moved}"
