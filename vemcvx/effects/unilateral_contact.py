"""Signorini's contact with a rigid obstacle: u . n <= gap, pressure >= 0, and no pressure where there is a gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.effects import data
from vemcvx.effects.contribution import ContactSurface, Contribution, GivenDatum, Obstacle
from vemcvx.effects.effect import Effect, amount, where
from vemcvx.vem import BoundaryRows, Space


@dataclass(frozen=True)
class UnilateralContact(Effect):
    """Contact with a rigid obstacle, which the body may leave but not penetrate (Signorini's conditions).

    At the nodes of `on`  u . n <= gap,  p >= 0,  p (gap - u . n) = 0,  with n the outward normal of the undeformed
    boundary and p the pressure, the multiplier of the bound over the nodal length. Kikuchi and Oden, *Contact Problems
    in Elasticity* (1988), chapter 2. Clamps and prescribed displacements take precedence at nodes that they share with
    contact; a node that is free along n only, on the axis of a half model, is in contact. Where obstacles with the same
    normal meet at a node, the smaller gap counts. An obstacle whose gap changes does work, which `history.work`
    includes.

    Parameters
    ----------
    on : str or sequence of str
        Names of boundaries, or of interfaces between bodies: u is then that of the first body relative to the second,
        and n the outward normal of the first.
    gap : number or callable f(x, t) -> (m,)
        Distance to the obstacle along n in the undeformed state, in units of length; it may change in time. Negative
        where they overlap (interference, press fits): the body is then pressed back by so much, either from the start
        with ``initial="settled"``, or by a gap that falls from zero.
    """

    on: str | Sequence[str]
    gap: data.Datum = 0.0

    def contribute(self, space: Space) -> Contribution:
        part = space.part(self.on, "UnilateralContact", contact=True)
        rows, subject = part.node_normals, f"UnilateralContact on {where(self.on)}"
        made = obstacle(space, rows, subject, self.gap, np.zeros(len(rows.nodes)))
        given = GivenDatum(subject, "gap", partial(distance, self.gap, subject), part.sides)
        return replace(made, given=(given,) if data.varies(self.gap) else ())

    def describe(self) -> str:
        return f"UnilateralContact: u.n <= {amount(self.gap)}, pressure >= 0 on {where(self.on)}"


def obstacle(space: Space, rows: BoundaryRows, subject: str, gap: data.Datum, compliance: Floats) -> Contribution:
    """An obstacle at these rows of nodes and normals, and the surface where contact is looked at."""
    points = space.mesh.points[rows.nodes]

    def apart(t: float) -> Floats:
        return distance(gap, subject, points, t) / rows.cosines

    return Contribution(
        obstacles=(
            Obstacle(
                subject=subject,
                nodes=rows.nodes,
                normals=rows.normals,
                lengths=rows.lengths,
                gap=apart,
                compliance=compliance,
                ends=rows.ends,
                partners=rows.partners,
            ),
        ),
        surfaces=(ContactSurface.of(rows),),
        curves=(subject,) if rows.curved else (),
    )


def distance(gap: data.Datum, subject: str, x: Floats, t: float) -> Floats:
    """The gap (k,) at points x (k, dim) and the instant `t`."""
    return data.scalar(gap, x, t, f"{subject}: gap")
