"""Contact, bilateral, rigid or compliant; and friction, by Tresca's law and by Coulomb's, one way or by direction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from vemcvx.arrays import Floats, choice, flag
from vemcvx.effects import data
from vemcvx.effects.data import varies
from vemcvx.effects.effect import (
    ContactSurface,
    Contribution,
    Effect,
    Ellipse,
    Friction,
    Ground,
    Obstacle,
    Support,
    amount,
    where,
)
from vemcvx.errors import SceneError
from vemcvx.vem import BoundaryRows, Space
from vemcvx.weight_law import Law


@dataclass(frozen=True)
class BilateralContact(Effect):
    """Contact without separation: u . n = 0 at the nodes of `on`, the first line of (3.6).

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
        Names of boundaries or interfaces, as of BilateralContact.
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
    """An obstacle at these rows of nodes and normals."""
    points = space.mesh.points[rows.nodes]

    def apart(t: float) -> Floats:
        return data.scalar(gap, points, t, f"{subject}: gap") / rows.cosines

    own = subject, rows.nodes, rows.normals, rows.lengths
    stops = Obstacle(*own, gap=apart, compliance=compliance, ends=rows.ends, partners=rows.partners)
    curves = (subject,) if rows.curved else ()
    return Contribution(obstacles=(stops,), curves=curves)


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
        Names of boundaries or interfaces, as of BilateralContact.
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


# Tresca's law with a given bound g on Gamma_C, (3.6): j(v) = int_{Gamma_C} g |v_tau| ds.
#
# Where the bounds of the two directions differ, j(v) = int g+ (v_tau)+ + g- (v_tau)- ds: the norm term of their mean,
# and half their difference as a bias that acts along v_tau. The nodal weights are those of the trapezoidal rule, w_i
# = g(x_i) int phi_i ds, or w_i = int g phi_i ds. With linear traces both integrate |v_tau| by its nodal interpolant,
# an upper bound of j on every edge.
#
# The bound is given: beside one-sided contact it acts where the contact is open, too. Friction that needs touch has w
# = g where p > 0 and 0 where p = 0, a jump with which a step need not have a solution (a place that closes without
# friction and opens with it). What then happens is grazing, w between the two at p = 0, and that is what the steep
# ramp
#
#     w(p) = min(STEEP p, g int phi_i)
#
# says: it is g wherever the pressure exceeds g / STEEP, it is continuous, and so every step has a solution (the map
# from bounded weights to weights is continuous: Brouwer), which :mod:`vemcvx.stepping.fixed_point` finds as
# Coulomb's, whose law with the coefficient STEEP and the cap g it is.


QUADRATURES = ("nodes", "integral")
STEEP = 1e6  # Pressures below a millionth of the bound count as grazing.


@dataclass(frozen=True)
class _Bounds:
    """The bounds g+ forward and g- backward, as weights (m,) of nodes; g- = g+ unless it is given."""

    subject: str
    of: TrescaFriction
    rows: BoundaryRows
    points: Floats

    def weights(self, t: float) -> Floats:
        """Weights of the norm terms: (g+ + g-) / 2 as a force of each node."""
        forward, backward = self.integrated(self.of.bound, t, "bound"), self.of.backward
        return forward if backward is None else 0.5 * (forward + self.integrated(backward, t, "backward bound"))

    def bias(self, t: float) -> Floats:
        """(g+ - g-) / 2."""
        return self.integrated(self.of.bound, t, "bound") - self.weights(t)

    def ramp(self, t: float, p: Floats, *slips: Floats) -> Floats:
        """Weights under normal forces (m,) of contact, for friction that needs touch."""
        return np.minimum(STEEP * np.maximum(p, 0.0), self.weights(t))

    def slope(self, t: float, p: Floats, past: Floats) -> Floats:
        """The derivative of the ramp."""
        return np.where(STEEP * p < self.weights(t), STEEP, 0.0)

    def integrated(self, value: data.Datum, t: float, name: str) -> Floats:
        """Weights (m,) of a bound that is called so in messages."""
        nodes, rule = self.of.quadrature == "nodes", "a friction bound is a force per length and must be >= 0"
        x = self.points if nodes else self.rows.points
        found = data.nonnegative(value, x, t, self.subject, name=name, rule=rule)
        return self.rows.lengths * found if nodes else self.rows.matrix @ found


@dataclass(frozen=True)
class TrescaFriction(Effect):
    """Friction with a given bound: |sigma_tau| <= g. Below the bound it sticks, at the bound it acts against the slip.

    The bound does not depend on pressure. With UnilateralContact or NormalCompliance, friction therefore also acts
    where contact is open, and a warning says so if that happens; `while_closed=True` restricts friction to closed
    contact.

    Where two parts of the boundary meet at a node, each has friction with the bound of its own edges; bounds of parts
    that overlap add up. Nodes that a prescribed displacement moves along the obstacle have friction, too, equal to g
    and against the slip. That support bears it, and its reaction and work include it. It is taken to be 0 in a step in
    which the support stands still, when any value up to g would be admissible.

    Parameters
    ----------
    bound : number, or callable f(x, t) -> (m,)
        g >= 0, force per length (and unit thickness), in space per area, evaluated at t_n.
    on : str or sequence of str
        Names of boundaries or interfaces, as of BilateralContact.
    quadrature : {"nodes", "integral"}
        w_i = g(x_i) int phi_i, or w_i = int g phi_i (for bounds that vary within an edge).
    backward : number, or callable f(x, t) -> (m,), optional
        The bound against slip in the other direction, if it differs (scales, ratchets, brushed fibres); >= 0, force per
        length. `bound` then limits friction against slip forward, along the boundary with the body on the left (on a
        floor, to the right), and `backward` against slip the other way. In the plane only.
    while_closed : bool, optional
        True: the bound is g where contact is closed and 0 where it is open. Every step is then a fixed point, as with
        CoulombFriction, and certified likewise. This needs UnilateralContact or NormalCompliance, and excludes
        `backward`. The bound jumps as contact opens: a step in which a place opens under friction, and closes
        without, has no answer, and is refused. False: g everywhere. None (default): g everywhere, with a warning if
        it acts where contact is open.
    ground : callable f(x, t) -> (m, dim) or (dim,), optional
        How far the obstacle has moved, if it slides under the body (a belt, a roll, a table that shakes), in units of
        length: friction acts against the slip of the body relative to it, and its motion does work. What counts is how
        it changes in time, along the boundary; an obstacle that moves along the normal is a `gap` that changes.
    direction : (3,), or callable f(x) -> (m, 3), optional
        Friction by direction, in space: `bound` is that against slip along this vector (what of it is along the
        surface), `across` the one across it; between them forces are bounded by the ellipse with these axes, and slip
        is normal to it (:mod:`vemcvx.effects.effect`).
    across : number, or callable f(x, t) -> (m,), optional
        The bound across `direction`, >= 0, force per area; its ratio to `bound` must not change in time.
    """

    bound: data.Datum
    on: str | Sequence[str]
    quadrature: str = "nodes"
    backward: data.Datum | None = field(default=None, metadata={"in the plane": True})
    while_closed: bool | None = None
    ground: data.Datum | None = None
    direction: data.Constant | None = field(default=None, metadata={"in space": True})
    across: data.Datum | None = field(default=None, metadata={"in space": True})

    def contribute(self, space: Space) -> Contribution:
        subject = f"TrescaFriction on {where(self.on)}"
        choice(self.quadrature, subject, "quadrature", QUADRATURES)
        closed = self.while_closed is not None and flag(self.while_closed, f"{subject}: while_closed")
        if self.backward is not None:
            if closed:
                but = "which takes one bound for both ways"
                raise SceneError(f"{subject}: found backward= beside while_closed=True, {but}.")
            instead = "tangents in space have no two directions; give direction= and across= instead"
            space.require_plane(f"{subject}: backward=", instead)
        rows = space.part(self.on, "TrescaFriction", contact=True).node_normals
        bounds = _Bounds(subject, self, rows, space.mesh.points[rows.nodes])
        if closed:
            acts: dict[str, Any] = {"law": Law(bounds.ramp, pressed=True, slope=bounds.slope, slips=False)}
        else:
            bias, steady = None if self.backward is None else bounds.bias, not varies(self.bound, self.backward)
            in_the_air = self.while_closed is None
            acts = {"weights": bounds.weights, "steady": steady, "bias": bias, "in_the_air": in_the_air}

        def mean(value: data.Datum, t: float, name: str) -> Floats:
            return bounds.integrated(value, t, name) / rows.lengths

        return _rubbing(self, space, rows, subject, along=("bound", self.bound), read=mean, **acts)

    def describe(self) -> str:
        back = "" if self.backward is None else f" forward, {amount(self.backward)} backward,"
        back += _by_direction(self.direction, self.across)
        closed = " where it is closed" if self.while_closed else ""
        moved = "" if self.ground is None else f", ground moved by {amount(self.ground)}"
        return f"TrescaFriction: |friction| <= {amount(self.bound)}{back} on {where(self.on)}{closed}{moved}"


def _rubbing(
    effect: TrescaFriction | CoulombFriction,
    space: Space,
    rows: BoundaryRows,
    subject: str,
    *,
    along: tuple[str, data.Datum],
    read: Callable[[data.Datum, float, str], Floats],
    **acts: Any,
) -> Contribution:
    """Friction that `acts` so on rows, over the ground and by the direction of an effect."""
    points = space.mesh.points[rows.nodes]
    ground = None if effect.ground is None else Ground.of(effect.ground, subject, points, rows.partners)
    given: dict[str, Any] = {"direction": effect.direction, "across": effect.across}
    ellipse = Ellipse.of(space, subject, points, along=along, read=read, **given)
    friction = replace(Friction.of(rows, subject), ground=ground, ellipse=ellipse, **acts)
    return Contribution(frictions=(friction,))


def _by_direction(direction: data.Constant | None, across: data.Datum | None) -> str:
    return "" if direction is None else f" along {amount(direction, 'x')}, {amount(across)} across it,"


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
        Names of boundaries or interfaces, as of BilateralContact.
    cap : number or callable f(x, t) -> (m,), optional
        Largest friction, force per length: |friction| <= min(coefficient * pressure, cap), such as the shear strength
        of a material that yields (after Orowan).
    ground : callable f(x, t) -> (m, dim) or (dim,), optional
        How far the obstacle has moved, if it slides under the body: as of TrescaFriction.
    direction : (3,), or callable f(x) -> (m, 3), optional
        Friction by direction, in space, as of TrescaFriction: `coefficient` is that against slip along this vector.
    across : number, or callable f(x, t) -> (m,), optional
        The coefficient across `direction`, >= 0; its ratio to `coefficient` must not change in time. A `cap` is one
        along the direction; across it is as many times smaller or larger.
    """

    coefficient: data.Datum
    on: str | Sequence[str]
    cap: data.Datum | None = None
    ground: data.Datum | None = None
    direction: data.Constant | None = field(default=None, metadata={"in space": True})
    across: data.Datum | None = field(default=None, metadata={"in space": True})

    def contribute(self, space: Space) -> Contribution:
        subject = f"CoulombFriction on {where(self.on)}"
        rows = space.part(self.on, "CoulombFriction", contact=True).node_normals
        points = space.mesh.points[rows.nodes]

        @lru_cache(maxsize=1)  # Of a step it is asked some ten times.
        def read(t: float) -> tuple[Floats, Floats]:
            mu = data.nonnegative(self.coefficient, points, t, subject, name="coefficient")
            if self.cap is None:
                return mu, np.full(len(points), np.inf)
            return mu, rows.lengths * data.nonnegative(self.cap, points, t, subject, name="cap")

        def weights(t: float, p: Floats, *slips: Floats) -> Floats:
            mu, cap = read(t)
            return np.minimum(mu * np.maximum(p, 0.0), cap)

        def slope(t: float, p: Floats, past: Floats) -> Floats:
            mu, cap = read(t)
            return np.where(mu * p < cap, mu, 0.0)

        def value(datum: data.Datum, t: float, name: str) -> Floats:
            return data.nonnegative(datum, points, t, subject, name=name)

        law = Law(weights, pressed=True, slope=slope, slips=False)
        return _rubbing(self, space, rows, subject, along=("coefficient", self.coefficient), read=value, law=law)

    def describe(self) -> str:
        cap = "" if self.cap is None else f", at most {amount(self.cap)},"
        moved = "" if self.ground is None else f", ground moved by {amount(self.ground)}"
        bound = f"{amount(self.coefficient)} times the pressure{_by_direction(self.direction, self.across)}{cap}"
        return f"CoulombFriction: |friction| <= {bound} on {where(self.on)}{moved}"
