"""Bounds on a linear quantity, by two hypercircles.

The quantity q(u) is the work of a load on the displacement u. If the load includes a prescribed displacement u_D, q(u)
includes the work of the support forces on u_D. As in :mod:`vemcvx.bound`, u and sigma are exact, and v and tau are
admissible. With the elastic tensor C and the prestress sigma_0, r = tau - sigma_0 - C eps(v) has the norm A. Let b be
the defect of v and tau in the laws of friction and contact, and e = u - v.

The dual pair is a displacement z_h with z_h = z_D := -u_D on the supports, and a stress tau_z in equilibrium with the
load of q. Let r_z = tau_z - C eps(z_h) have the norm A_z. The loads, friction and pressure in equilibrium with
tau do the work T(z) on a displacement z. Then

    q(u)  =  q(v) + (tau_z, eps(e))                                              equilibrium of tau_z,
          =  q(v) + (C eps(z_h), eps(e)) + (r_z, eps(e)),
    (C eps(z_h), eps(e))  =  T(z_h) - (sigma_0 + C eps(v), eps(z_h))             equilibrium of sigma.

Let d = C eps(e) - r / 2. The proof of Theorem 1 (:mod:`vemcvx.bound`) shows |e|^2 <= (r, eps(e)) + b. So
|d|^2 <= A^2 / 4 + b, and q(u) differs from

    m  =  q(v) + T(z_h) - (sigma_0 + C eps(v), eps(z_h)) + (r_z, C^-1 r) / 2

by at most A_z (A^2 / 4 + b)^{1/2}, the half width of the interval. Without friction and contact, the half width is
|r| |r_z| / 2 (K. Washizu, J. Math. Phys. 32 (1953)).

The proof assumes that z_h and the traction of tau_z are zero where friction and obstacles act. Where contact cannot
open, tau_z may have a normal traction. If z_D moves an end of an edge with friction, the frictions of sigma and tau can
do different work on z_h. The half width then includes a bound on the difference. The bounds also hold for v + w and z_h
+ w_z, with the corrections w and w_z of :mod:`.hypercircle`.

Let l_0 be the load minus a linear fit, and eta the norm of l_0. Let q_0 be the quantity minus a linear fit
(:mod:`.reading`). The half width includes an estimate of |l_0(z_h) + q_0(u)| + A_z eta.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Bools, Floats, Ints, brief
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import Outline, Outlined
from vemcvx.bound.hypercircle import Hypercircle, Pair
from vemcvx.bound.reading import Reader
from vemcvx.bound.skeleton import Instant
from vemcvx.bound.surface import Surface, along
from vemcvx.effects import Contribution, Effect, Support
from vemcvx.history import History
from vemcvx.linear import choose_linear
from vemcvx.scene import initial_stresses, jump_rows
from vemcvx.scene.supports import by_precedence, resolve
from vemcvx.vem import Space


@dataclass(frozen=True, kw_only=True, repr=False)
class QuantityBound(Outlined):
    """An interval for a linear quantity q(u), where u is the exact solution of a step from the computed state.

    Attributes
    ----------
    step : int
        The step.
    value : float
        The quantity q of the computed displacement, possibly outside the interval.
    low, high : float
        Ends of the interval. With Coulomb's law, friction bounds follow from the computed pressure.
    reading : float
        The estimated part of the half width; zero if loads and quantity are linear on edges and in cells
        (:mod:`vemcvx.bound.reading`).

    Examples
    --------
    >>> interval = vx.QuantityBound(step=1, value=1.0, low=0.9, high=1.2)
    >>> interval.guaranteed, round(interval.error, 9)
    (True, 0.2)
    """

    step: int
    value: float
    low: float
    high: float
    reading: float = 0.0

    @property
    def guaranteed(self) -> bool:
        """True if `reading` is zero."""
        return self.reading == 0.0

    @property
    def error(self) -> float:
        """The distance from the value of the run to the farther end of the interval."""
        return max(self.high - self.value, self.value - self.low)

    def outline(self) -> Outline:
        """Return the outline for prompts and notebooks."""
        rest = f"for data as read at points; the half width includes the estimate {self.reading:.2g}"
        lines = [
            ("interval", f"{self.low:.8g} ... {self.high:.8g}, {'guaranteed' if self.guaranteed else rest}"),
            ("run", f"{self.value:.8g}, off by {self.error:.2g} at most"),
        ]
        return Outline(f"QuantityBound: at step {self.step}", lines)


def quantity_bound(history: History, step: int, pair: Pair, of: Effect | Sequence[Effect]) -> QuantityBound:
    """Return the bounds on a quantity in a step, or raise SceneError."""
    dual = Dual.from_effects(pair.circle, of, pair.t)
    low, high = dual.interval(pair)
    plain = replace(pair, w=0.0 * pair.w)
    value = plain.work_of(dual.pair) - float(np.sum(history.forces[history.row(step)] * dual.lifted))
    return QuantityBound(step=step, value=value, low=low, high=high, reading=_allowance(pair, dual.pair))


@dataclass(frozen=True, eq=False)
class Dual:
    """The dual problem of a quantity at the instant t."""

    primal: Hypercircle
    effects: tuple[Effect, ...]
    t: float

    @classmethod
    def from_effects(cls, circle: Hypercircle, of: Effect | Sequence[Effect], t: float = 0.0) -> Dual:
        """Return the dual problem of a quantity, or raise SceneError."""
        effects = tuple(of) if isinstance(of, (list, tuple)) and of else (of,)
        for effect in effects:
            parts = effect.contribute(circle.posed.space) if isinstance(effect, Effect) else Contribution()
            moved = any(support.value is not None for support in parts.supports)
            linear = replace(parts, loads=(), supports=(), initial_stresses=()) == Contribution()
            if not linear or not (parts.loads or moved or parts.initial_stresses):
                raise SceneError(
                    f"error_bound: found of={brief(effect)}; wanted a load whose work is the quantity. "
                    "Traction((1.0 / length, 0.0), on='top') gives the mean displacement of a side along x. BodyForce "
                    "and Prestress give means over the body. PrescribedDisplacement((1.0, 0.0), on='left') gives the "
                    "force along x of a support on the left. A list of loads gives the sum."
                )
            for load in parts.loads:
                if load.cells is None and load.edges is None:
                    raise SceneError(
                        f"error_bound: found of={brief(effect)}; {load.subject} at a point has no bound, because the "
                        "response to a point force has infinite energy. Give the mean over a part, by Traction."
                    )
        return cls(circle, effects, t)

    def motion(self, space: Space) -> Floats:
        """Return z_D = -u_D (n_nodes, 2)."""
        supports = by_precedence([s for effect in self.effects for s in effect.contribute(space).supports])
        points = space.mesh.points
        if not supports:
            return np.zeros_like(points)
        return np.asarray(-resolve(supports, (), points).motion(self.t).reshape(points.shape))

    @cached_property
    def lifted(self) -> Floats:
        """The motion z_D (n_nodes, 2), checked against the supports of the scene."""
        supports, lifted = self.primal.posed.supports, self.motion(self.primal.posed.space)
        if np.abs(supports.gather(lifted.ravel())).max(initial=0.0) > SAME * np.abs(lifted).max(initial=0.0):
            raise SceneError(
                "error_bound: of= prescribes a displacement in a direction in which no support holds the body. "
                "To bound the force of a support, displace its boundary: "
                "of=PrescribedDisplacement((1.0, 0.0), on='left') gives the force along x of Clamp(on='left')."
            )
        return lifted

    @cached_property
    def pair(self) -> Pair:
        """The dual pair (z_h, tau_z)."""
        circle, posed, lifted = self.primal, self.primal.posed, self.lifted
        edges, (_, normal) = circle.boundary.edges, circle.boundary.acting
        if circle.boundary.motions.shape[1]:
            raise SceneError(
                "error_bound: of= has no bound if only friction or one-sided contact holds the body; add a support."
            )
        if (normal & self._moves_along(edges.units)).any():
            raise SceneError(
                "error_bound: of= displaces a support that ends next to one-sided contact in the same direction. The "
                "forces of support and contact cannot be separated there."
            )
        parts = [effect.contribute(posed.space) for effect in self.effects]
        prestress = initial_stresses(parts, posed.material, posed.space)
        u, free = lifted.ravel(), self._find_untouched()
        if len(free):
            K, P = sp.csr_matrix(posed.system.K[free][:, free]), posed.supports.P[:, free]
            force = (np.zeros(len(u)) if prestress is None else prestress.vector(self.t)) - posed.A @ u
            for load in (load for part in parts for load in part.loads):
                force += load.vector(self.t)
            u = u + P @ choose_linear(len(free)).factorise(K).solve(np.asarray(P.T @ force))
        none, z = np.zeros(0), u.reshape(lifted.shape)
        self._check_supports(z)
        reader = Reader(posed, edges, circle.boundary.reader.fans, self.effects)
        read = reader.at(Instant(t=self.t, u=z, lam=np.zeros((0, 1)), p=none, weights=none, worn=none))
        surface = Surface.from_loads(circle.boundary.forces_of(read.tractions))
        return circle.make_pair((self.t, z), surface, read, prestress)

    def _moves_along(self, ways: Floats) -> Bools:
        """Return a mask (b,) of edges that z_D moves in the given directions."""
        return np.asarray(along(self.lifted[self.primal.boundary.edges.outer_edges], ways).any(axis=1))

    def _find_untouched(self) -> Ints:
        """Return free unknowns (k,) on which friction and obstacles do no work."""
        posed, boundary, rows = self.primal.posed, self.primal.boundary, []
        for acts, ways in zip(boundary.acting, (boundary.edges.tangents, boundary.edges.units), strict=True):
            ends, across = boundary.edges.outer_edges[acts].ravel(), boundary.edges.joints.across[acts].ravel()
            directions = np.repeat(ways[acts], 2, axis=0)[:, None]
            rows.append(jump_rows(ends, across, directions, posed.space.mesh.points))
        touched = abs(sp.vstack(rows) @ posed.supports.P).sum(axis=0)
        return np.flatnonzero(np.asarray(touched).ravel() < SAME)

    def _check_supports(self, z: Floats) -> None:
        """Raise SceneError if z differs from z_D on the edges of supports."""
        moved = self.motion(Space(self.primal.boundary.reader.fine.mesh))

        def components_of(support: Support) -> Floats:
            jumps = moved[support.nodes]
            if support.partners is not None:
                jumps = jumps - np.where(support.partners[:, None] >= 0, moved[support.partners], 0.0)
            return np.asarray(np.einsum("md,md->m", support.directions, jumps))

        if self.primal.boundary.off_supports(z, components_of)[0] is not None:
            raise SceneError(
                "error_bound: of= displaces a support that has a node in common with another support of the same "
                "direction. The force of one support alone has no bound. Displace both supports, or displace one in a "
                "direction that the other leaves free."
            )

    def interval(self, pair: Pair) -> tuple[float, float]:
        """Return the bounds on q(u), given the primal pair."""
        if self.lifted.any() and pair.read.eta > 0.0:
            raise SceneError(
                "error_bound: there is no bound of the force of a support if a load or a friction bound is not linear "
                "on edges and in cells; bound a mean displacement, or give linear data."
            )
        circle, dual = self.primal, self.pair
        energies, defects = circle.products(pair.richer, dual.richer)
        middle = pair.work_of(dual) + dual.work(pair.surface.forces, pair.read.body)
        middle += float(0.5 * defects.sum() - energies.sum()) - circle.work_of_stress(pair.prestress, dual.richer)
        width = self._unknown_work(pair) + float(np.sqrt(dual.richer_A2 * (0.25 * pair.richer_A2 + pair.law_defect)))
        width += _allowance(pair, dual)
        return middle - width, middle + width

    def _unknown_work(self, pair: Pair) -> float:
        """Return a bound on the work of the friction difference on z_h."""
        boundary, edges, (bound, friction) = self.primal.boundary, self.primal.boundary.edges, pair.surface.laws
        most = np.max(bound + np.abs(friction), axis=1)
        # On an edge, z_h + w_z is quadratic.
        numbered, values = self.primal.equilibrium.edges, self.pair.richer.outline.reshape(-1, 2)
        ends = values[edges.outer_edges]
        middles = values[len(values) - numbered.count + numbered.outer[:, 0, 0] // 4]
        bent = middles - 0.5 * ends.sum(axis=1)
        size = np.abs(along(ends, edges.tangents)).sum(axis=1)
        work = most * edges.lengths * (0.5 * size + 2.0 / 3.0 * np.abs(np.sum(bent * edges.tangents, axis=1)))
        return float(np.sum(work[boundary.acting[0] & self._moves_along(edges.tangents)]))


def _allowance(primal: Pair, dual: Pair) -> float:
    """Return an estimate of |l_0(z_h) + q_0(u)| + A_z eta."""
    # |v + w| <= |v| + |w|, and the attribute `lower` is |w|.
    load, quantity = primal.read.eta, dual.read.eta
    works = load * (dual.norm + dual.lower) + quantity * (primal.norm + primal.lower)
    return works + float(np.sqrt(dual.richer_A2)) * load + quantity * (primal.upper + load)
