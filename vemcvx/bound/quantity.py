"""Bounds on a linear quantity, by the parallelogram of two hypercircles.

A quantity is a load: q(u) is the work of tractions, pressures, body forces and prestress on the displacement u, and the
work of the forces of supports on a displacement -z_D that is given on these. Its dual solution z, with a(z, w) = q(w)
for all w that supports admit and z = z_D on supports, has a hypercircle of its own: z_h, and a stress tau_z in
equilibrium with the linear moments q_1 of q. With r, v, tau, b, osc_T and A of :mod:`.hypercircle`, e = u - v, and r_z,
A_z and osc^z_T the same of the dual problem, let T be the work of all forces that tau balances, the tractions of
friction and contact among them. Then

    q(u)  =  q(v) + (tau_z, eps(e)) + (q - q_1)(e)                                      equilibrium of tau_z,
          =  q(v) + (C eps(z_h), eps(e)) + (r_z, eps(e)) + (q - q_1)(e),
    (C eps(z_h), eps(e))  =  T(z_h) - (sigma_0 + C eps(v), eps(z_h))                    equilibrium of sigma,

and what is left of |e|^2 <= (r, eps(e)) + sum osc_T |e|_T + b after the square is completed, d = C eps(e) - r / 2,
has |d|^2 - |osc| |d| <= A^2 / 4 - |osc|^2 / 4 + b, that is

    |d|  <=  R = |osc| / 2 + (A^2 / 4 + b)^{1/2}.

So q(u) differs from the computable

    m  =  q(v) + T(z_h) - (sigma_0 + C eps(v), eps(z_h)) + (r_z, C^-1 r) / 2

by no more than A_z R + sum osc^z_T |r|_T / 2. Without friction, contact and oscillation this is |r| |r_z| / 2: the
least that a(e + s e_z, e + s e_z) and a(e - s e_z, e - s e_z), both bounded by hypercircles, leave for any s (W. Prager
and J. L. Synge, Quart. Appl. Math. 5 (1947); K. Washizu, J. Math. Phys. 32 (1953); M. Ainsworth and J. T. Oden, *A
Posteriori Error Estimation* (2000), chapter 8; P. Ladeveze and J.-P. Pelle, *Mastering Calculations in Linear and
Nonlinear Mechanics* (2005)). Springs to the ground are as triangles are, and the part of their r that m leaves out is
in the bound.

The steps used two things. Tractions of tau_z do no work on e where e need not vanish; and the tractions of sigma do the
work on z_h that T says. Where nothing but supports holds the body both are so, and the interval is a **theorem**. With
friction and contact they are so in two ways:

- z_h vanishes on contact, and tau_z has no traction there (but for normals that are held together). This, too, is a
  theorem, whatever sticks, slips and opens. r_z does not fall with the mesh then, and the interval falls as A does.
- The state is frozen: edges both ends of which stick are held, as are the normals of those both ends of which are
  closed, and on all others z and tau_z are free. The interval falls as A A_z does. It bounds q of the body whose edges
  stick, slip and open as those of the answer do, with the friction and the pressure of tau where they slip. On the
  continuum what sticks ends between nodes: of the exact answer it is an **estimate**. (With h = 1/8, in the scenes of
  tests/bound, the exact one was inside, or outside by less than a quarter of the width; by 1.8 times the width where
  contact closes over a gap.)

For v and z_h one may take v + w and z_h + w_z of :mod:`.hypercircle`, richer inside of the body, the former on contact
the same.

Loads and quantities are known at points. What these may misread moves q(u) by e(z_h) of the load, by e_z(u) of the
quantity, and by A_z eta in what friction and contact may do on z (:mod:`.reading`): an allowance, which is an estimate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Bools, Floats, Ints, brief
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import Outline, Outlined
from vemcvx.bound.body_force import BodyForces, alone, integrals
from vemcvx.bound.data_oscillation import DataOscillation
from vemcvx.bound.displacement import VALUES, strains_at_stations
from vemcvx.bound.fan import inner, stresses_of
from vemcvx.bound.hypercircle import Hypercircle, Pair, check_bounded, hypercircle
from vemcvx.bound.skeleton import Instant, Skeleton, at_ends
from vemcvx.bound.surface import Boundary
from vemcvx.effects import Contribution, Effect, Friction, MaterialLaw, Obstacle, Support
from vemcvx.history import History
from vemcvx.linear import choose_linear
from vemcvx.meshes.polygons import positions
from vemcvx.scene import Scene
from vemcvx.scene.pose import PosedScene, pose_scene, unwarned
from vemcvx.scene.rows import ContactRows, jump_rows
from vemcvx.scene.supports import by_precedence, resolve
from vemcvx.vem import Space, tangents_of


@dataclass(frozen=True, kw_only=True, repr=False)
class QuantityBound(Outlined):
    """An interval for a linear quantity q(u) of the exact displacement u of a step, given the one before it.

    Attributes
    ----------
    step : int
        The step.
    value : float
        q of the run. The interval need not contain it: its middle is corrected by the dual solution.
    low, high : float
        The interval; an estimate is cut where `certain` ends.
    guaranteed : bool
        True if q(u) is between low and high by a theorem: in scenes without friction and one-sided contact, and where
        they are `certain`, if besides the load and the quantity are polynomials as far as points tell (`reading` is
        zero). With friction or one-sided contact low and high are an estimate: what sticks, slips and opens is taken
        to be the same on the continuum, which on coarse meshes may be wrong, with friction as well as where contact
        opens. The width says nothing of that: an interval may have none and be 4 % off, as that of the force of a
        support may where all friction slips.
    certain : (float, float)
        The interval that needs no such assumption (with Coulomb's law it is for the friction that the pressure of the
        run gives): a theorem for data as read at points. With friction and contact it is wider, and infinite where
        nothing else holds the body.
    reading : float
        Of the half width of low and high the allowance for what points may misread of the load and of the quantity: an
        estimate, from a second, finer reading; zero if both agree (:mod:`vemcvx.bound.reading`).
    """

    step: int
    value: float
    low: float
    high: float
    guaranteed: bool
    certain: tuple[float, float]
    reading: float = 0.0

    @property
    def error(self) -> float:
        """The distance of the run's value from the farther end of the interval."""
        return max(self.high - self.value, self.value - self.low)

    def outline(self) -> Outline:
        """The outline for prompts and notebooks: the interval, and whether it is a theorem."""
        frozen = self.certain != (self.low, self.high)
        kind = "estimate: what sticks, slips and opens taken to be that of the run" if frozen else "guaranteed"
        kind += (
            "; its width does not say how far that is off"
            if frozen and self.high - self.low <= SAME * abs(self.value)
            else ""
        )
        kind += (
            f", for loads as read at points, with {self.reading:.2g} for what may be misread" if self.reading else ""
        )
        lines = [
            ("interval", f"{self.low:.8g} ... {self.high:.8g}, {kind}"),
            ("certain", f"{self.certain[0]:.8g} ... {self.certain[1]:.8g}"),
            ("run", f"{self.value:.8g}, off by {self.error:.2g} at most"),
        ]
        return Outline(f"QuantityBound: at step {self.step}", lines)


def quantity_bound(history: History, step: int, pair: Pair, of: Effect | Sequence[Effect]) -> QuantityBound:
    """The bound of q in a step whose pair this is.

    Raises
    ------
    SceneError
        `of` is no linear quantity, or one for which there is no bound.
    """
    circle, posed, row = pair.circle, pair.circle.posed, history.row(step)
    dual, primal = Dual.of(circle, of, pair.t), Fields(pair)
    compliant = bool((posed.obstacles.compliance > 0).any())
    certain, fields = dual.certain(primal), dual.apart
    if compliant and fields is None:
        raise SceneError(
            "error_bound: there is no bound of a quantity, of=, where compliant contact (NormalCompliance) is next to "
            "the support whose force is asked for, or holds the body, alone or with friction."
        )
    own = certain
    # What is compliant neither holds nor is free: there the theorem is all there is.
    if fields is None or not (compliant or len(posed.terms) + len(posed.obstacles) == 0):
        edges = circle.boundary.edges
        sticking = _everywhere(edges, posed.terms, history.trajectory.sticking[row])
        held = sticking, _everywhere(edges, posed.obstacles, history.trajectory.pressures[row] > 0.0)
        fields = dual.frozen(held)
        estimate = _interval(primal, fields, dual.unknown_work(fields, held, pair))
        # The part of the estimate that is certain to be possible; all that is, if there is none.
        low, high = max(certain[0], estimate[0]), min(certain[1], estimate[1])
        own = (low, high) if low <= high else certain
    plain = Fields(replace(pair, w=0.0 * pair.w))
    value = fields.quantity_of(plain) - float(np.sum(history.forces[row] * dual.lifted))
    return QuantityBound(
        step=step,
        value=value,
        low=own[0],
        high=own[1],
        guaranteed=own == certain and pair.reading.exact and fields.pair.reading.exact,
        certain=certain,
        reading=_misread(primal, fields),
    )


def _everywhere(edges: Skeleton, rows: ContactRows, holds: Bools) -> Bools:
    """(b,) on which edges there is a row, and all rows there hold (m,)."""
    some = np.ones(len(rows.nodes))
    ends = at_ends(edges, rows, np.column_stack([some, some - holds]))
    held: Bools = np.asarray(ends[..., 0].any(axis=1)) & ~np.asarray(ends[..., 1].any(axis=1))
    return held


@dataclass(frozen=True)
class _InDual(Effect):
    """An effect of the scene or of the quantity, by what of it is in a dual problem; its place orders scenes."""

    place: int
    effect: Effect
    part: Callable[[Contribution, Space], Contribution]

    def contribute(self, space: Space) -> Contribution:
        return self.part(self.effect.contribute(space), space)

    def describe(self) -> str:
        return self.effect.describe()


def _loads(part: Contribution, space: Space) -> Contribution:
    """The loads among a quantity's effects: a support's contribution is its motion."""
    return replace(part, supports=())


@dataclass(frozen=True, eq=False)
class Dual:
    """The dual problems of a quantity at the instant t, by the boundary edges on which contact is held.

    These are two arrays (b,): edges on which slip, and motion towards obstacles, are held. The pair that is a theorem
    in any case serves all steps of a quantity that does not depend on time.
    """

    primal: Hypercircle
    effects: tuple[Effect, ...]
    t: float

    @classmethod
    def of(cls, circle: Hypercircle, of: Effect | Sequence[Effect], t: float = 0.0) -> Dual:
        """The dual problems of the quantity that these effects are."""
        effects = tuple(of) if isinstance(of, (list, tuple)) and of else (of,)
        for effect in effects:
            parts = effect.contribute(circle.posed.space) if isinstance(effect, Effect) else Contribution()
            moved = [support for support in parts.supports if support.value is not None]
            others = vars(replace(parts, loads=(), supports=(), initial_stresses=())).values()
            linear = not any(part is not None and (not isinstance(part, tuple) or part) for part in others)
            if not linear or not (parts.loads or moved or parts.initial_stresses):
                raise SceneError(
                    f"error_bound: found of={brief(effect)}; a linear quantity is given as a load that does its work: "
                    "Traction((1.0 / length, 0.0), on='top') for the mean displacement along x of a side, BodyForce or "
                    "Prestress for means over the body, PrescribedDisplacement((1.0, 0.0), on='left') on a support for "
                    "its force on the body along x; or a list of these, for their sum."
                )
        return cls(circle, effects, t)

    def motion(self, space: Space) -> Floats:
        """z_D (n_nodes, 2): minus the displacement that the effects give on supports."""
        supports = by_precedence([s for effect in self.effects for s in effect.contribute(space).supports])
        points = space.mesh.points
        if not supports:
            return np.zeros_like(points)
        moved: Floats = -resolve(supports, (), points).motion(self.t).reshape(points.shape)
        return moved

    @cached_property
    def lifted(self) -> Floats:
        """z_D (n_nodes, 2)."""
        supports, lifted = self.primal.posed.supports, self.motion(self.primal.posed.space)
        if np.abs(supports.gather(lifted.ravel())).max(initial=0.0) > SAME * np.abs(lifted).max(initial=0.0):
            raise SceneError(
                "error_bound: found of= a displacement where no support of the scene holds the body in that direction; "
                "it asks for the force of a support, such as of=PrescribedDisplacement((1.0, 0.0), on='left') for that "
                "along x of Clamp(on='left')."
            )
        return lifted

    @cached_property
    def moved(self) -> tuple[Bools, Bools]:
        """(b,) which edges z_D moves at an end, along them and outward."""
        edges = self.primal.boundary.edges
        along, outward = (
            np.einsum("bed,bd->be", self.lifted[edges.outer_edges], way) for way in (edges.tangents, edges.units)
        )
        return np.asarray(along.any(axis=1)), np.asarray(outward.any(axis=1))

    def posed(self, held: tuple[Bools, Bools]) -> PosedScene:
        """The problem in which these edges are held."""
        effects, at_rest = self.primal.posed.scene.canonical, partial(self._at_rest, held)
        laws = [effect for effect in effects if isinstance(effect, MaterialLaw)]
        others = [_InDual(k, one, at_rest) for k, one in enumerate(effects) if not isinstance(one, MaterialLaw)]
        loads = [_InDual(len(effects) + k, effect, _loads) for k, effect in enumerate(self.effects)]
        with unwarned():
            return pose_scene(Scene(*laws, *others, *loads), self.primal.posed.space.mesh, [self.t])

    def _at_rest(self, held: tuple[Bools, Bools], part: Contribution, space: Space) -> Contribution:
        """An effect of the scene, which bears no load, and holds what it held, or moves it by z_D."""
        moved, supports = self.motion(space), list(part.supports)
        acting: tuple[Friction | Obstacle, ...] = (*part.frictions, *part.obstacles)
        for one in acting:
            rows = np.flatnonzero(self._held_rows(held[isinstance(one, Obstacle)], one, space))
            nodes, normals = one.nodes[rows], one.normals[rows]
            supports.append(
                Support(
                    subject=one.subject,
                    nodes=nodes,
                    directions=normals if isinstance(one, Obstacle) else tangents_of(normals)[:, 0],
                    points=space.mesh.points[nodes],
                    contact=True,
                    partners=None if one.partners is None else one.partners[rows],
                )
            )
        resting = tuple(replace(s, value=_motion_of(s, moved)) for s in supports)
        return Contribution(stiffness=part.stiffness, material=part.material, supports=resting, curves=part.curves)

    def _held_rows(self, held: Bools, part: Friction | Obstacle, space: Space) -> Bools:
        """(m,) the rows of an effect, on the mesh or on that with finer edges, that own the end of a held edge."""
        assert part.ends is not None  # Others are refused before: check_estimable.
        names = np.column_stack([part.nodes[part.ends.row], part.ends.beyond])
        fine, edges = self.primal.boundary.fine, self.primal.boundary.edges
        if space.mesh.n_nodes == fine.mesh.n_nodes:
            edge = fine.piece_owner[positions(names, fine.pieces, fine.mesh.n_nodes)]
        else:
            edge = positions(names, edges.outer_edges, space.mesh.n_nodes)
        rows = np.zeros(len(part.nodes), dtype=bool)
        rows[part.ends.row[held[edge]]] = True
        return rows

    @cached_property
    def apart(self) -> Fields | None:
        """z that vanishes on contact, and the stress that has no tractions there.

        None if friction and contact alone hold the body, or z_D moves an end of an edge towards an obstacle: what that
        does there is not known. This holds as the primal problem does: all that is made once a mesh serves both.
        """
        primal, edges = self.primal, self.primal.boundary.edges
        if primal.boundary.motions.shape[1] or (primal.boundary.acting[1] & self.moved[1]).any():
            return None
        none = np.zeros(len(edges.outer), dtype=bool)
        posed = self.posed((none, none))
        check_bounded(posed)
        boundary = Boundary(posed, edges, DataOscillation(posed, edges))
        circle = replace(primal, posed=posed, boundary=boundary, body_forces=BodyForces(primal.fans))
        points, rows = primal.posed.space.mesh.points, []
        for acts, ways in zip(primal.boundary.acting, (edges.tangents, edges.units), strict=True):
            ends, across = edges.outer_edges[acts].ravel(), edges.joints.across[acts].ravel()
            rows.append(jump_rows(ends, across, np.repeat(ways[acts], 2, axis=0)[:, None], points))
        touched = abs(sp.vstack(rows) @ primal.posed.supports.P).sum(axis=0)
        return self._fields(circle, np.flatnonzero(np.asarray(touched).ravel() < SAME))

    def certain(self, primal: Fields) -> tuple[float, float]:
        """The interval in a step that is a theorem in any case."""
        if self.apart is None:
            return -np.inf, np.inf
        return _interval(primal, self.apart, self.unknown_work(self.apart, self.primal.boundary.acting, primal.pair))

    def frozen(self, held: tuple[Bools, Bools]) -> Fields:
        """z and stress of the problem in which these edges are held, as far as z_D does not move them."""
        slip, normal = (edges & ~moved for edges, moved in zip(held, self.moved, strict=True))
        circle = hypercircle(self.posed((slip, normal)))
        return self._fields(circle, np.arange(circle.posed.system.n))

    def _fields(self, circle: Hypercircle, free: Ints) -> Fields:
        """The fields of z_h, which virtual elements find among these free unknowns."""
        posed = circle.posed
        own = posed if posed.system.n == len(free) else self.primal.posed
        K, P = sp.csr_matrix(own.system.K[free][:, free]), own.supports.P[:, free]
        u = self.lifted.ravel()
        force = P.T @ (posed.force(self.t) - own.A @ u)
        if len(free):
            u = u + P @ choose_linear(len(free)).factorise(K).solve(np.asarray(force))
        none = np.zeros(0)
        z = Instant(t=self.t, u=u.reshape(-1, 2), lam=np.zeros((0, 1)), p=none, weights=none, worn=none)
        try:
            circle.boundary.check_supports(z)
        except SceneError as error:
            raise SceneError(
                "error_bound: found of= a displacement of a support that ends beside another one, which holds the same "
                "direction: the force of one of two supports that meet has no limit. Ask for that of both, or for a "
                "component that the other one leaves free."
            ) from error
        return Fields(circle.pair(z, z))

    def unknown_work(self, fields: Fields, held: tuple[Bools, Bools], pair: Pair) -> float:
        """A bound on friction's work on z_h beyond that of T, on edges that are held but moved at an end by z_D."""
        boundary, edges, (along, outward) = self.primal.boundary, self.primal.boundary.edges, self.moved
        if (held[1] & outward).any():
            raise SceneError(
                "error_bound: found of= a displacement of a support that ends beside one-sided contact in the "
                "same direction; their forces cannot be told apart."
            )
        bound, friction = pair.surface.laws
        most = np.zeros(len(edges.outer))
        np.maximum.at(most, boundary.fine.piece_owner, np.max(bound + np.abs(friction), axis=1))
        size = [np.abs(np.einsum("b...d,bd->b...", one, edges.tangents)) for one in fields.on_edges]
        work = most * edges.lengths * (0.5 * size[0].sum(axis=1) + 2.0 / 3.0 * size[1])
        return float(np.sum(work[held[0] & along]))


def _motion_of(support: Support, moved: Floats) -> Callable[[float], Floats] | None:
    """The components that a support prescribes of given displacements (n_nodes, 2)."""
    jumps = moved[support.nodes]
    if support.partners is not None:
        jumps = jumps - np.where(support.partners[:, None] >= 0, moved[support.partners], 0.0)
    components = np.einsum("md,md->m", support.directions, jumps)
    return (lambda t: components) if components.any() else None


@dataclass(frozen=True, eq=False)
class Fields:
    """A pair with its richer displacement v + w inside of cells."""

    pair: Pair

    @property
    def circle(self) -> Hypercircle:
        """The parts of the scene that the pair is made of."""
        return self.pair.circle

    @cached_property
    def prestress(self) -> Floats:
        """sigma_0 (n_cells, 3)."""
        return self.circle.prestress(self.pair.t)

    @cached_property
    def v(self) -> list[Floats]:
        """(c, n, 20) of each chunk of cells the values of v + w at the nodes of triangles."""
        v, densities = self.circle.nodal(self.pair.richer.outline), self.pair.densities
        return [one + alone(fans, f)[0] for one, fans, f in zip(v, self.circle.fans, densities, strict=False)] or v

    @cached_property
    def strains(self) -> list[Floats]:
        """eps(v + w) (c, n, 18, 3)."""
        return [strains_at_stations(fans, v) for fans, v in zip(self.circle.fans, self.v, strict=True)]

    @cached_property
    def defects(self) -> tuple[Floats, ...]:
        """r of v + w (c, n, 18, 3)."""
        return self.circle.fields(self.pair.richer)

    @cached_property
    def squares(self) -> Floats:
        """(corners,) |r|_T^2 of it."""
        return self.circle.squares(self.defects)

    @property
    def on_edges(self) -> tuple[Floats, Floats]:
        """v + w on boundary edges: (b, 2, 2) at their ends, and (b, 2) the parabola."""
        values = self.pair.richer.outline.reshape(-1, 2)
        ends = values[self.circle.boundary.edges.outer_edges]
        return ends, values[self.circle.middles] - 0.5 * ends.sum(axis=1)

    @property
    def A2(self) -> float:
        """A^2 of v + w."""
        parts = (np.sqrt(self.squares) + self.pair.oscillation) ** 2
        return float(parts.sum() + self.pair.springs.sum())

    def work(self, moments: Floats, densities: Sequence[Floats]) -> float:
        """The work of tractions, by their moments (b, 3, 2), and of body forces (c, n, 21, 2) on v + w."""
        total = float(self.circle.of_tractions(moments) @ self.pair.richer.outline)
        for fans, v, f in zip(self.circle.fans, self.v, densities, strict=False):
            total += float(np.vdot(integrals(fans, VALUES, f), v))
        return total

    def quantity_of(self, other: Fields) -> float:
        """The load of this pair as a quantity of the displacement of another one."""
        work = other.work(self.pair.surface.loads, self.pair.densities)
        for fans, strain in zip(self.circle.fans, other.strains, strict=True):
            stress = self.prestress[fans.cells][:, None, None] + np.zeros_like(strain)
            work -= float(inner(fans, stress, strain).sum())
        return work


def _interval(primal: Fields, dual: Fields, unknown: float) -> tuple[float, float]:
    """The bounds of q(u), some work on z_h being unknown."""
    pair, boundary = primal.pair, primal.circle.boundary
    middle = dual.quantity_of(primal) + dual.work(boundary.moments(pair.surface.acting), pair.densities)
    motions = [one.pair.u[boundary.edges.outer_edges].reshape(-1, 4) for one in (primal, dual)]
    middle -= float(np.einsum("bi,bij,bj->", motions[0], boundary.springs, motions[1]))
    for fans, one, other, strain, of_dual in zip(
        primal.circle.fans, primal.defects, dual.defects, primal.strains, dual.strains, strict=True
    ):
        still = primal.prestress[fans.cells][:, None, None]
        middle -= float(inner(fans, still + stresses_of(fans, strain), of_dual).sum())
        middle += 0.5 * float(inner(fans, other, np.matmul(one, fans.D[:, None])).sum())
    radius = 0.5 * float(np.linalg.norm(pair.oscillation)) + float(np.sqrt(0.25 * primal.A2 + pair.lacking))
    width = unknown + float(np.sqrt(dual.A2)) * radius
    width += 0.5 * float(np.sum(dual.pair.oscillation * np.sqrt(primal.squares)))
    width += 0.5 * float(np.sum(np.sqrt(dual.pair.springs * pair.springs))) + _misread(primal, dual)
    return middle - width, middle + width


def _misread(primal: Fields, dual: Fields) -> float:
    """The allowance for what may be misread of the load, on z_h, and of the quantity, on u."""
    of_load, of_quantity = primal.pair.reading, dual.pair.reading
    if of_load.exact and of_quantity.exact:
        return 0.0
    works = of_load.work(dual.v, *dual.on_edges) + of_quantity.work(primal.v, *primal.on_edges)
    eta = of_load.energy
    return works + float(np.sqrt(dual.A2)) * eta + of_quantity.energy * (primal.pair.upper + eta)
