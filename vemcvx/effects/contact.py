"""Contact: bilateral, with a rigid obstacle, with a compliant one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.effects import data
from vemcvx.effects.effect import ContactSurface, Contribution, Effect, Obstacle, Support, amount, where
from vemcvx.errors import SceneError
from vemcvx.vem import BoundaryRows, Space

# Contact without separation, u . n = 0 on Gamma_C, the first line of (3.6).


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


# Signorini's contact with a rigid obstacle: u . n <= gap, pressure >= 0, and no pressure where there is a gap.


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
        rows = space.part(self.on, "UnilateralContact", contact=True).node_normals
        rigid = np.zeros(len(rows.nodes))
        return obstacle(space, rows, f"UnilateralContact on {where(self.on)}", self.gap, rigid)

    def describe(self) -> str:
        return f"UnilateralContact: u.n <= {amount(self.gap)}, pressure >= 0 on {where(self.on)}"


def obstacle(space: Space, rows: BoundaryRows, subject: str, gap: data.Datum, compliance: Floats) -> Contribution:
    """An obstacle at these rows of nodes and normals, and the surface where contact is looked at."""
    points = space.mesh.points[rows.nodes]

    def apart(t: float) -> Floats:
        return data.scalar(gap, points, t, f"{subject}: gap") / rows.cosines

    own = subject, rows.nodes, rows.normals, rows.lengths
    stops = Obstacle(*own, gap=apart, compliance=compliance, ends=rows.ends, partners=rows.partners)
    curves = (subject,) if rows.curved else ()
    return Contribution(obstacles=(stops,), surfaces=(ContactSurface.of(rows),), curves=curves)


# Contact with a compliant obstacle: pressure = stiffness times penetration.


@dataclass(frozen=True)
class NormalCompliance(Effect):
    """Contact with a compliant obstacle: the pressure on the body is p = stiffness (u . n - gap)_+.

    The energy int stiffness / 2 (u . n - gap)_+^2 ds, lumped at the nodes, is part of `history.energy`. This is the law
    of Martins and Oden, *Existence and uniqueness results for dynamic contact problems with nonlinear normal and
    friction interface laws* (Nonlinear Anal. 11, 1987), with the exponent m_n = 1. As the stiffness grows, the obstacle
    becomes rigid. Clamps and prescribed displacements take precedence at nodes whose normal displacement they hold:
    there is no such spring there.

    Parameters
    ----------
    stiffness : number or callable f(x, t) -> (m,)
        Pressure per penetration, force per length^2 (and unit thickness), > 0; fixed in time (f is evaluated at
        t = 0).
    on : str or sequence of str
        Names of boundaries, or of interfaces between bodies: u is then that of the first body relative to the second,
        and n the outward normal of the first.
    gap : number or callable f(x, t) -> (m,)
        Distance to the obstacle along the outward normal before anything moves. Negative where they overlap: the body
        is then pressed back, either from the start with ``initial="settled"``, or by a gap that falls from zero.
    """

    stiffness: data.Datum
    on: str | Sequence[str]
    gap: data.Datum = 0.0

    def contribute(self, space: Space) -> Contribution:
        subject = f"NormalCompliance on {where(self.on)}"
        rows = space.part(self.on, "NormalCompliance", contact=True).node_normals
        x = space.mesh.points[rows.nodes]
        stiffness = data.scalar(self.stiffness, x, 0.0, f"{subject}: stiffness")
        if (stiffness <= 0).any():
            worst = int(np.argmin(stiffness))
            raise SceneError(
                f"{subject}: found the stiffness {stiffness[worst]:.6g} at {x[worst]}; it must be > 0. "
                "UnilateralContact is the rigid obstacle; leave the effect out for none."
            )
        # On a curve edges that move out by d move the node by d over the cosine, and push with as much less along n.
        return obstacle(space, rows, subject, self.gap, 1.0 / (stiffness * rows.lengths * rows.cosines**2))

    def describe(self) -> str:
        return (
            f"NormalCompliance: pressure = {amount(self.stiffness)} times the depth beyond {amount(self.gap)} on "
            f"{where(self.on)}"
        )
