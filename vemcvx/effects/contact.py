"""Effects of contact and friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import Floats, call_function, choice, flag, function
from vemcvx.base.errors import SceneError
from vemcvx.base.weight_law import Law
from vemcvx.effects import data
from vemcvx.effects.data import varies
from vemcvx.effects.effect import (
    ContactSurface,
    Contribution,
    Effect,
    Friction,
    Ground,
    Obstacle,
    Support,
    amount,
    where,
)
from vemcvx.vem import BoundaryRows, Space
from vemcvx.vem.projection import tangents_of


@dataclass(frozen=True)
class BilateralContact(Effect):
    """Contact without separation: u . n = 0, with the outward normal n (Feng, Han and Huang, (3.6)).

    At a corner, u . n = 0 holds for both normals, which fixes the node. If normals differ by less than 42.5 degrees,
    the sides form a curve, along which nodes slide. Clamps and prescribed displacements take precedence.

    Parameters
    ----------
    on : str or sequence of str
        Names of boundaries or interfaces. At an interface, u is the displacement of the first body relative to the
        second body, and n is the outward normal of the first body.

    Examples
    --------
    >>> print(vx.BilateralContact(on=["bottom", "top"]).describe())
    BilateralContact: u.n = 0 on bottom, top
    """

    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        rows = space.part(self.on, "BilateralContact", contact=True).node_normals
        points = space.mesh.points[rows.nodes]
        support = Support("BilateralContact", rows.nodes, rows.normals, points, contact=True, partners=rows.partners)
        surface, curves = ContactSurface.from_rows(rows, self._subject), (self._subject,) if rows.curved else ()
        return Contribution(supports=(support,), surfaces=(surface,), curves=curves)

    def describe(self) -> str:
        return f"BilateralContact: u.n = 0 on {where(self.on)}"


@dataclass(frozen=True)
class PrescribedSlip(Effect):
    """A closed fault: the jump of u is `value` along an interface, and 0 across the interface.

    `history.reaction(on)` is the force along the fault, which causes the slip. `history.force(on)` is the force across
    the fault. On the same interface, TrescaFriction acts against the slip, and CoulombFriction is refused.

    Parameters
    ----------
    value : number, or callable f(x, t) -> (m,)
        Slip along the tangent, length. The tangent is the outward normal of the first body, rotated by +90 degrees.
        Positive slip is right-lateral. In space, `value` is a vector (m, 3); normal components have no effect.
    on : str or sequence of str
        Names of interfaces or boundaries, as for BilateralContact.

    Examples
    --------
    >>> print(vx.PrescribedSlip(0.1, on="low|up").describe())
    PrescribedSlip: slip = 0.1, u.n = 0 on low|up
    """

    value: data.Datum
    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        rows, subject = space.part(self.on, "PrescribedSlip", contact=True).node_normals, self._subject
        apart = rows.nodes != rows.partners
        nodes, normals, partners = rows.nodes[apart], rows.normals[apart], rows.partners[apart]
        points, tangents = space.mesh.points[nodes], tangents_of(normals)
        per = tangents.shape[1]

        def slip(t: float) -> Floats:
            if space.in_plane:
                return data.scalar(self.value, points, t, f"{subject}: value")
            vectors = data.vector(self.value, points, t, f"{subject}: value")
            return np.einsum("mbd,md->mb", tangents, vectors).ravel()

        moves = varies(self.value) or slip(0.0).any()
        across = Support(subject, nodes, normals, points, contact=True, partners=partners)
        along = Support(
            subject,
            nodes.repeat(per),
            tangents.reshape(-1, space.dim),
            points.repeat(per, axis=0),
            slip if moves else None,
            partners=partners.repeat(per),
        )
        surface, curves = ContactSurface.from_rows(rows, subject), (subject,) if rows.curved else ()
        return Contribution(supports=(across, along), surfaces=(surface,), curves=curves)

    def describe(self) -> str:
        return f"PrescribedSlip: slip = {amount(self.value)}, u.n = 0 on {where(self.on)}"


@dataclass(frozen=True)
class UnilateralContact(Effect):
    """Contact with a rigid obstacle, which the body may leave but not penetrate (Signorini's conditions).

    The conditions u . n <= gap, p >= 0 and p (gap - u . n) = 0 hold at nodes, with the outward normal n of the
    undeformed boundary and the pressure p (Kikuchi and Oden, *Contact Problems in Elasticity*, 1988).

    Parameters
    ----------
    on : str or sequence of str
        Names of boundaries or interfaces, as for BilateralContact.
    gap : number or callable f(x, t) -> (m,)
        Distance to the obstacle along n in the undeformed state, length. At nodes with two gaps, the smaller gap acts.
        For a negative gap (press fit), use ``initial="settled"``, or let the gap fall from zero.

    Examples
    --------
    >>> print(vx.UnilateralContact(on="bottom", gap=0.01).describe())
    UnilateralContact: u.n <= 0.01, pressure >= 0 on bottom
    """

    on: str | Sequence[str]
    gap: data.Datum = 0.0

    def contribute(self, space: Space) -> Contribution:
        rows = space.part(self.on, "UnilateralContact", contact=True).node_normals
        return obstacle(space, rows, self._subject, self.gap, np.zeros(len(rows.nodes)))

    def describe(self) -> str:
        return f"UnilateralContact: u.n <= {amount(self.gap)}, pressure >= 0 on {where(self.on)}"


def obstacle(
    space: Space, rows: BoundaryRows, subject: str, gap: data.Datum, compliance: Floats, rates: bool = False
) -> Contribution:
    """Return the contribution of an obstacle."""
    points = space.mesh.points[rows.nodes]

    def distance(t: float) -> Floats:
        return data.scalar(gap, points, t, f"{subject}: gap") / rows.cosines

    stops = Obstacle.from_rows(rows, subject, gap=distance, compliance=compliance, rates=rates)
    return Contribution(obstacles=(stops,), curves=(subject,) if rows.curved else ())


STIFFNESS_RULE = "it must be > 0. For a rigid obstacle, use UnilateralContact; for no obstacle, leave the effect out"


@dataclass(frozen=True)
class NormalCompliance(Effect):
    """Contact with a compliant obstacle: the pressure on the body is p = stiffness (u . n - gap)_+.

    The energy int stiffness / 2 (u . n - gap)_+^2 ds, lumped at the nodes, is part of `history.energy` (Martins and
    Oden, Nonlinear Anal. 11, 1987).

    Parameters
    ----------
    stiffness : number or callable f(x, t) -> (m,)
        Pressure per penetration, > 0, force per length^2 (in space force per length^3), evaluated at t = 0.
    on : str or sequence of str
        Names of boundaries or interfaces, as for BilateralContact.
    gap : number or callable f(x, t) -> (m,)
        Distance to the obstacle, as for UnilateralContact.

    Examples
    --------
    >>> print(vx.NormalCompliance(stiffness=1e3, on="bottom").describe())
    NormalCompliance: pressure = 1000.0 times the depth beyond 0.0 on bottom
    """

    stiffness: data.Datum = field(metadata=data.holds(sign="> 0", rule=STIFFNESS_RULE))
    on: str | Sequence[str]
    gap: data.Datum = 0.0

    def contribute(self, space: Space) -> Contribution:
        rows = space.part(self.on, "NormalCompliance", contact=True).node_normals
        stiffness = self._read("stiffness", data.At(space.mesh.points[rows.nodes], 0.0))
        # A node that moves by z along its normal moves the edges by z * cosines.
        return obstacle(space, rows, self._subject, self.gap, 1.0 / (stiffness * rows.lengths * rows.cosines**2))

    def describe(self) -> str:
        beyond = f"the depth beyond {amount(self.gap)} on {where(self.on)}"
        return f"NormalCompliance: pressure = {amount(self.stiffness)} times {beyond}"


@dataclass(frozen=True)
class VelocityContact(Effect):
    """Contact in velocities: the body does not approach the obstacle, or a dashpot resists the approach.

    Without `damping`, Signorini's condition holds in velocities: u'.n <= 0, p >= 0, p u'.n = 0. With `damping`, the
    pressure is p = damping (u'.n)_+, and the work of p is part of `history.dissipated`. In a step of length k, u' is
    (u - u_prev) / k (docs/theory/coulomb.md).

    Parameters
    ----------
    on : str or sequence of str
        Names of boundaries or interfaces, as for BilateralContact.
    damping : number or callable f(x) -> (m,), optional
        Pressure per velocity, > 0, in units of pressure times time per length. By default the body cannot approach.

    Examples
    --------
    >>> print(vx.VelocityContact(on="bottom", damping=5.0).describe())
    VelocityContact: pressure = 5.0 times the velocity into the obstacle on bottom
    """

    on: str | Sequence[str]
    damping: data.Constant | None = field(
        default=None, metadata=data.holds(sign="> 0", rule="leave it out if the body cannot approach")
    )

    def contribute(self, space: Space) -> Contribution:
        rows = space.part(self.on, "VelocityContact", contact=True).node_normals
        compliance = np.zeros(len(rows.nodes))
        if self.damping is not None:
            damping = self._read("damping", data.At(space.mesh.points[rows.nodes]))
            compliance = 1.0 / (damping * rows.lengths * rows.cosines**2)
        return obstacle(space, rows, self._subject, 0.0, compliance, rates=True)

    def describe(self) -> str:
        if self.damping is None:
            return f"VelocityContact: u'.n <= 0, pressure >= 0 on {where(self.on)}"
        velocity = f"the velocity into the obstacle on {where(self.on)}"
        return f"VelocityContact: pressure = {amount(self.damping, 'x')} times {velocity}"


BOUND_RULE = "a friction bound is a force per length and must be >= 0"
# The weight min(STEEPNESS p, bound) is continuous in the pressure p, so a step has a solution (Brouwer).
STEEPNESS = 1e6


class _Friction(Effect):
    on: str | Sequence[str]
    ground: data.Datum | None = None

    def _rub(self, space: Space, rows: BoundaryRows, **acts: Any) -> Contribution:
        subject, ground = self._subject, None
        if self.ground is not None:
            if (rows.partners >= 0).any():
                raise SceneError(
                    f"{subject}: found ground= on an interface, where the body rubs on another body; prescribe the "
                    "motion of that body instead."
                )
            ground = Ground(f"{subject}: ground", space.mesh.points[rows.nodes], self.ground)
        return Contribution(frictions=(Friction.from_rows(rows, subject, ground=ground, **acts),))

    def _describe(self, bound: str, rest: str = "") -> str:
        moved = "" if self.ground is None else f", ground moved by {amount(self.ground)}"
        return f"{type(self).__name__}: |friction| <= {bound} on {where(self.on)}{rest}{moved}"


@dataclass(frozen=True)
class TrescaFriction(_Friction):
    """Friction with a given bound g on the tangential stress: |sigma_tau| <= g.

    Nodes stick below the bound, and may slip at the bound. By default, friction also acts where one-sided contact is
    open. The bounds of overlapping parts are added.

    Parameters
    ----------
    bound : number, or callable f(x, t) -> (m,)
        g >= 0, force per length (in space force per area), evaluated at the end of each step.
    on : str or sequence of str
        Names of boundaries or interfaces, as for BilateralContact.
    quadrature : {"nodes", "integral"}
        Weight of node i, with the basis function phi_i: g(x_i) int phi_i for "nodes", int g phi_i for "integral".
    while_closed : bool, optional
        True: the bound is g where one-sided contact is closed, and 0 elsewhere. False: the bound is g everywhere. None
        (default): the bound is g everywhere, with a warning where friction acts without contact.
    ground : callable f(x, t) -> (m, dim) or (dim,), optional
        Displacement of an obstacle that slides under the body, such as a belt; length. The normal component is ignored
        (use `gap` of UnilateralContact).

    Examples
    --------
    >>> print(vx.TrescaFriction(bound=4.0, on="bottom").describe())
    TrescaFriction: |friction| <= 4.0 on bottom
    """

    bound: data.Datum = field(metadata=data.holds(sign=">= 0", rule=BOUND_RULE))
    on: str | Sequence[str]
    quadrature: str = "nodes"
    while_closed: bool | None = None
    ground: data.Datum | None = None

    def contribute(self, space: Space) -> Contribution:
        subject = self._subject
        choice(self.quadrature, subject, "quadrature", ("nodes", "integral"))
        closed = self.while_closed is not None and flag(self.while_closed, f"{subject}: while_closed")
        rows = space.part(self.on, "TrescaFriction", contact=True).node_normals
        points = space.mesh.points[rows.nodes]

        def integrate(t: float) -> Floats:
            nodes = self.quadrature == "nodes"
            found = self._read("bound", data.At(points if nodes else rows.points, t))
            return rows.lengths * found if nodes else rows.matrix @ found

        acts: dict[str, Any] = {"law": _limit_by_pressure(lambda t: STEEPNESS, integrate)}
        if not closed:
            acts = {"weights": integrate, "in_the_air": self.while_closed is None}
        return self._rub(space, rows, **acts)

    def describe(self) -> str:
        return self._describe(amount(self.bound), " where it is closed" if self.while_closed else "")


def _limit_by_pressure(coefficient: Callable[[float], Floats | float], cap: Callable[[float], Floats]) -> Law:
    def weights(t: float, p: Floats, *slips: Floats) -> Floats:
        return np.minimum(coefficient(t) * np.maximum(p, 0.0), cap(t))

    def slope(t: float, p: Floats, past: Floats) -> Floats:
        mu = coefficient(t)
        return np.where(mu * p < cap(t), mu, 0.0)

    return Law(weights, pressed=True, slope=slope, slips=False)


@dataclass(frozen=True)
class CoulombFriction(_Friction):
    """Friction with a bound proportional to the contact pressure: |friction| <= coefficient * pressure.

    The effect needs UnilateralContact or NormalCompliance on the same boundary. Friction is zero where supports fix
    the gap. The certificate holds for the friction bounds of the computed pressure (docs/theory/coulomb.md).

    Parameters
    ----------
    coefficient : number or callable f(x, t) -> (m,)
        Coefficient of friction, >= 0, dimensionless.
    on : str or sequence of str
        Names of boundaries or interfaces, as for BilateralContact.
    cap : number or callable f(x, t) -> (m,), optional
        Largest friction, force per length: |friction| <= min(coefficient * pressure, cap) (Orowan).
    ground : callable f(x, t) -> (m, dim) or (dim,), optional
        The displacement of an obstacle that slides under the body, as for TrescaFriction.

    Examples
    --------
    >>> print(vx.CoulombFriction(coefficient=0.3, on="bottom").describe())
    CoulombFriction: |friction| <= 0.3 times the pressure on bottom
    """

    coefficient: data.Datum = field(metadata=data.holds(sign=">= 0"))
    on: str | Sequence[str]
    cap: data.Datum | None = field(default=None, metadata=data.holds(sign=">= 0"))
    ground: data.Datum | None = None

    def contribute(self, space: Space) -> Contribution:
        rows = space.part(self.on, "CoulombFriction", contact=True).node_normals

        @lru_cache(maxsize=3)  # A step reads the same data about ten times.
        def read(name: str, t: float) -> Floats:
            return self._read(name, data.At(space.mesh.points[rows.nodes], t))

        def cap(t: float) -> Floats:
            return np.full(len(rows.nodes), np.inf) if self.cap is None else rows.lengths * read("cap", t)

        law = _limit_by_pressure(partial(read, "coefficient"), cap)
        return self._rub(space, rows, law=law)

    def describe(self) -> str:
        cap = "" if self.cap is None else f", at most {amount(self.cap)}"
        return self._describe(f"{amount(self.coefficient)} times the pressure", cap)


@dataclass(frozen=True)
class SpeedFriction(_Friction):
    """Friction whose bound depends on the speed: |friction| <= bound(|s| / k), with the slip s in a step of length k.

    If `bound` falls with the speed, a step may have several solutions. The certificate then holds for the friction
    bounds of the computed speed (docs/theory/coulomb.md).

    Parameters
    ----------
    bound : callable f(speed) -> (m,)
        Friction bound, >= 0, force per length, in space force per area. Speeds are >= 0, length per time.
    on : str or sequence of str
        Names of boundaries or interfaces, as for BilateralContact.
    softening : number, optional
        The largest decrease of the bound per unit of speed; 0 (the default) if the bound does not fall.
    ground : callable f(x, t) -> (m, dim) or (dim,), optional
        The displacement of an obstacle that slides under the body, as for TrescaFriction.

    Examples
    --------
    >>> print(vx.SpeedFriction(lambda speed: 1.0 + 0.2 * speed, on="bottom").describe())
    SpeedFriction: |friction| <= <lambda>(speed) on bottom
    """

    bound: Callable[[Floats], ArrayLike]
    on: str | Sequence[str]
    softening: float = field(default=0.0, metadata=data.holds(sign=">= 0"))
    ground: data.Datum | None = None

    def contribute(self, space: Space) -> Contribution:
        rows, subject = space.part(self.on, "SpeedFriction", contact=True).node_normals, self._subject
        function(self.bound, f"{subject}: found bound", "a function of the speed")
        falls = self._read("softening", data.At(space.mesh.points[rows.nodes]))

        def weights(t: float, p: Floats, past: Floats, rate: Floats) -> Floats:
            asked = "take the speeds of all rows at once and return one bound for each"
            found = call_function(self.bound, (rate,), f"{subject}: its bound failed when called as f(speed)", asked)
            return rows.lengths * data.read_numbers(found, len(rate), f"{subject}: bound")

        law = Law(weights, softening=falls * rows.lengths, rates=True)
        return self._rub(space, rows, law=law, in_the_air=True)

    def describe(self) -> str:
        return self._describe(amount(self.bound, "speed"))
