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
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import SAME, Bools, Floats, Ints, brief
from vemcvx.bound.body_force import BodyForces, alone
from vemcvx.bound.data_oscillation import DataOscillation
from vemcvx.bound.displacement import VALUES, strains_at_stations
from vemcvx.bound.fan import RULE_WEIGHTS, inner, stresses_of
from vemcvx.bound.hypercircle import Hypercircle, Pair, check_bounded, hypercircle, outline_of
from vemcvx.bound.reading import Reading
from vemcvx.bound.skeleton import Instant, Skeleton, at_ends
from vemcvx.bound.surface import Boundary
from vemcvx.effects import Contribution, Effect, Friction, MaterialLaw, Obstacle, Support
from vemcvx.errors import SceneError
from vemcvx.history import History
from vemcvx.linear import choose_linear
from vemcvx.meshes.polygons import positions
from vemcvx.outline import Outline, Outlined
from vemcvx.scene import Scene
from vemcvx.scene.pose import PosedScene, pose_scene, unwarned
from vemcvx.scene.supports import ContactRows, by_precedence, jump_rows, resolve
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
        """How far the value of the run is from the farther end of the interval."""
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


def quantity_bound(
    circle: Hypercircle, history: History, step: int, found: tuple[Pair, Instant], of: Effect | Sequence[Effect]
) -> QuantityBound:
    """The bound of q in a step whose pair, and the instant that it is of, are found.

    Raises
    ------
    SceneError
        `of` is no linear quantity, or one for which there is no bound.
    """
    posed, (pair, now) = circle.posed, found
    dual, primal = _Dual(circle, _Quantity(_checked(of, posed), now.t)), _Fields.of(circle, pair, now.t)
    compliant = bool((posed.obstacles.compliance > 0).any())
    apart = CertainQuantity(circle, dual)
    certain, fields = apart.of_fields(primal), apart.fields
    if compliant and fields is None:
        raise SceneError(
            "error_bound: there is no bound of a quantity, of=, where compliant contact (NormalCompliance) is next to "
            "the support whose force is asked for, or holds the body, alone or with friction."
        )
    own = certain
    # What is compliant neither holds nor is free: there the theorem is all there is.
    if fields is None or not (compliant or len(posed.terms) + len(posed.obstacles) == 0):
        held = _Held.frozen(circle, now, history.trajectory.sticking[history.row(step)])
        fields = dual.frozen(held)
        own = _within(certain, _interval(primal, fields, dual.unknown_work(fields, held, pair)))
    plain = _Fields.of(circle, replace(pair, w=0.0 * pair.w), now.t)
    value = fields.quantity_of(plain) - float(np.sum(history.forces[history.row(step)] * dual.lifted))
    return QuantityBound(
        step=step,
        value=value,
        low=own[0],
        high=own[1],
        guaranteed=own == certain and primal.read.exact and fields.read.exact,
        certain=certain,
        reading=_misread(primal, fields),
    )


def _within(certain: tuple[float, float], estimate: tuple[float, float]) -> tuple[float, float]:
    """The part of an estimate that is certain to be possible; all that is, if there is none."""
    low, high = max(certain[0], estimate[0]), min(certain[1], estimate[1])
    return (low, high) if low <= high else certain


@dataclass(frozen=True, eq=False)
class CertainQuantity:
    """The interval of a quantity that is a theorem in any case; its dual pair serves all steps."""

    circle: Hypercircle
    dual: _Dual

    @classmethod
    def of(cls, circle: Hypercircle, effect: Effect) -> CertainQuantity:
        """That of a quantity which does not depend on time."""
        return cls(circle, _Dual(circle, _Quantity(_checked(effect, circle.posed), 0.0)))

    @cached_property
    def fields(self) -> _Fields | None:
        """The dual pair; None if friction and contact alone hold the body, or z_D presses on an obstacle."""
        held = self.circle.boundary.motions.shape[1] == 0 and not self.dual.presses
        return self.dual.apart() if held else None

    def of_fields(self, primal: _Fields) -> tuple[float, float]:
        """The interval in a step."""
        if self.fields is None:
            return -np.inf, np.inf
        unknown = self.dual.unknown_work(self.fields, _Held.acting(self.circle), primal.pair)
        return _interval(primal, self.fields, unknown)

    def between(self, pair: Pair, t: float) -> tuple[float, float]:
        """The interval in the step of a pair, which ends at t."""
        return self.of_fields(_Fields.of(self.circle, pair, t))


def _checked(of: Effect | Sequence[Effect], posed: PosedScene) -> tuple[Effect, ...]:
    """The effects of a quantity."""
    effects = tuple(of) if isinstance(of, (list, tuple)) and of else (of,)
    for effect in effects:
        parts = effect.contribute(posed.space) if isinstance(effect, Effect) else Contribution()
        moved = [support for support in parts.supports if support.value is not None]
        others = vars(replace(parts, loads=(), supports=(), initial_stresses=())).values()
        linear = not any(part is not None and (not isinstance(part, tuple) or part) for part in others)
        if not linear or not (parts.loads or moved or parts.initial_stresses):
            raise SceneError(
                f"error_bound: found of={brief(effect)}; a linear quantity is given as a load that does its work: "
                "Traction((1.0 / length, 0.0), on='top') for the mean displacement along x of a side, BodyForce or "
                "Prestress for means over the body, PrescribedDisplacement((1.0, 0.0), on='left') on a support for its "
                "force on the body along x; or a list of these, for their sum."
            )
    return effects


@dataclass(frozen=True, repr=False)
class _Quantity:
    """The effects of a quantity at the instant t."""

    effects: tuple[Effect, ...]
    t: float

    @property
    def loads(self) -> list[Effect]:
        """Those that are loads: a support's contribution is its motion."""
        return [_AsLoad(place, effect) for place, effect in enumerate(self.effects)]

    def motion(self, space: Space) -> Floats:
        """z_D (n_nodes, 2): minus the displacement that the effects give on supports."""
        supports = by_precedence([s for effect in self.effects for s in effect.contribute(space).supports])
        points = space.mesh.points
        if not supports:
            return np.zeros_like(points)
        moved: Floats = -resolve(supports, (), points).motion(self.t).reshape(points.shape)
        return moved


@dataclass(frozen=True)
class _AsLoad(Effect):
    """The loads of an effect; its place orders scenes."""

    place: int
    effect: Effect

    def contribute(self, space: Space) -> Contribution:
        return replace(self.effect.contribute(space), supports=())

    def describe(self) -> str:
        return self.effect.describe()


@dataclass(frozen=True, eq=False, repr=False)
class _Held:
    """The boundary edges (b,) on which slip, and motion towards obstacles, are held in a dual problem."""

    boundary: Boundary
    slip: Bools
    normal: Bools

    @classmethod
    def nothing(cls, circle: Hypercircle) -> _Held:
        """Supports alone hold."""
        none = np.zeros(len(circle.boundary.edges.outer), dtype=bool)
        return cls(circle.boundary, none, none)

    @classmethod
    def acting(cls, circle: Hypercircle) -> _Held:
        """Friction and obstacles hold wherever they may act."""
        return cls(circle.boundary, *circle.boundary.acting)

    @classmethod
    def frozen(cls, circle: Hypercircle, now: Instant, sticking: Bools) -> _Held:
        """What sticks, and is closed, at both ends."""
        edges, terms, obstacles = circle.boundary.edges, circle.posed.terms, circle.posed.obstacles
        return cls(circle.boundary, _everywhere(edges, terms, sticking), _everywhere(edges, obstacles, now.p > 0.0))

    def moved(self, lifted: Floats) -> tuple[Bools, Bools]:
        """(b,) which edges displacements (n_nodes, 2) of supports move at an end, along them and outward."""
        edges = self.boundary.edges
        along, outward = (
            np.einsum("bed,bd->be", lifted[edges.outer_edges], way) for way in (edges.tangents, edges.units)
        )
        return np.asarray(along.any(axis=1)), np.asarray(outward.any(axis=1))

    def released(self, lifted: Floats) -> _Held:
        """Without the edges that these displacements move."""
        along, outward = self.moved(lifted)
        return replace(self, slip=self.slip & ~along, normal=self.normal & ~outward)

    def rows(self, part: Friction | Obstacle, space: Space) -> Bools:
        """(m,) the rows of an effect, on the mesh or on that with finer edges, that own the end of a held edge."""
        assert part.ends is not None  # Others are refused before: check_estimable.
        names = np.column_stack([part.nodes[part.ends.row], part.ends.beyond])
        fine, edges = self.boundary.fine, self.boundary.edges
        if space.mesh.n_nodes == fine.mesh.n_nodes:
            edge = fine.piece_owner[positions(names, fine.pieces, fine.mesh.n_nodes)]
        else:
            edge = positions(names, edges.outer_edges, space.mesh.n_nodes)
        held = np.zeros(len(part.nodes), dtype=bool)
        of_edges = self.normal if isinstance(part, Obstacle) else self.slip
        held[part.ends.row[np.flatnonzero(of_edges[edge])]] = True
        return held


def _everywhere(edges: Skeleton, rows: ContactRows, holds: Bools) -> Bools:
    """(b,) on which edges there is a row, and all rows there hold (m,)."""
    some = np.ones(len(rows.nodes))
    ends = at_ends(edges, rows, np.column_stack([some, some - holds]))
    held: Bools = np.asarray(ends[..., 0].any(axis=1)) & ~np.asarray(ends[..., 1].any(axis=1))
    return held


@dataclass(frozen=True)
class _AtRest(Effect):
    """An effect of the scene in a dual problem: it bears no load, and holds what it held, or moves it by z_D."""

    place: int
    effect: Effect
    held: _Held
    quantity: _Quantity

    def contribute(self, space: Space) -> Contribution:
        part, moved = self.effect.contribute(space), self.quantity.motion(space)
        acting: tuple[Friction | Obstacle, ...] = (*part.frictions, *part.obstacles)
        holding = tuple(self._holding(one, space) for one in acting)
        supports = tuple(replace(s, value=_motion_of(s, moved)) for s in (*part.supports, *holding))
        return Contribution(stiffness=part.stiffness, material=part.material, supports=supports, curves=part.curves)

    def _holding(self, part: Friction | Obstacle, space: Space) -> Support:
        rows = np.flatnonzero(self.held.rows(part, space))
        nodes, normals = part.nodes[rows], part.normals[rows]
        return Support(
            subject=part.subject,
            nodes=nodes,
            directions=normals if isinstance(part, Obstacle) else tangents_of(normals)[:, 0],
            points=space.mesh.points[nodes],
            contact=True,
            partners=None if part.partners is None else part.partners[rows],
        )

    def describe(self) -> str:
        return self.effect.describe()


def _motion_of(support: Support, moved: Floats) -> Callable[[float], Floats] | None:
    """The components that a support prescribes of given displacements (n_nodes, 2)."""
    jumps = moved[support.nodes]
    if support.partners is not None:
        jumps = jumps - np.where(support.partners[:, None] >= 0, moved[support.partners], 0.0)
    components = np.einsum("md,md->m", support.directions, jumps)
    return (lambda t: components) if components.any() else None


@dataclass(frozen=True, eq=False)
class _Fields:
    """A pair with its richer displacement v + w inside of cells."""

    circle: Hypercircle
    pair: Pair
    prestress: Floats
    """sigma_0 (n_cells, 3)"""
    t: float
    v: tuple[Floats, ...]
    """(c, n, 20) of each chunk of cells the values of v + w at the nodes of triangles"""
    defects: tuple[Floats, ...]
    """r of v + w (c, n, 18, 3)"""
    squares: Floats
    """(corners,) |r|_T^2 of it"""

    @classmethod
    def of(cls, circle: Hypercircle, pair: Pair, t: float) -> _Fields:
        """Those of a pair at the instant t."""
        values, defects = [], circle.fields(pair.richer)
        for k, (fans, displacement) in enumerate(zip(circle.fans, circle.displacements, strict=True)):
            of_body = alone(fans, pair.densities[k])[0] if pair.densities else 0.0
            values.append(displacement.nodal(outline_of(fans, pair.u) + pair.w[circle.outlines[k]]) + of_body)
        squares = circle.squares(defects)
        return cls(circle, pair, circle.prestress(t), t, v=tuple(values), defects=defects, squares=squares)

    @cached_property
    def read(self) -> Reading:
        """How well the load of the pair is read."""
        return self.circle.reading(self.pair, self.t)

    @property
    def on_edges(self) -> tuple[Floats, Floats]:
        """v + w on boundary edges: (b, 2, 2) at their ends, and (b, 2) the parabola."""
        w = self.pair.w.reshape(-1, 2)
        of_ends = w[self.circle.boundary.edges.outer_edges]
        return self.ends + of_ends, w[self.circle.middles] - 0.5 * of_ends.sum(axis=1)

    @property
    def A2(self) -> float:
        """A^2 of v + w."""
        parts = (np.sqrt(self.squares) + self.pair.oscillation) ** 2
        return float(parts.sum() + self.pair.springs.sum())

    def strains(self) -> list[Floats]:
        """eps(v + w) of each chunk."""
        return [strains_at_stations(fans, v) for fans, v in zip(self.circle.fans, self.v, strict=True)]

    @property
    def ends(self) -> Floats:
        """(b, 2, 2) v at the ends of boundary edges."""
        return self.pair.u[self.circle.boundary.edges.outer_edges]

    def work(self, moments: Floats, densities: Sequence[Floats]) -> float:
        """The work of tractions, by their moments (b, 3, 2), and of body forces (c, n, 21, 2) on v + w."""
        total = float(np.sum(moments[:, :2] * self.ends) + self.circle.of_tractions(moments) @ self.pair.w)
        for fans, v, f in zip(self.circle.fans, self.v, densities, strict=False):
            weighed = RULE_WEIGHTS[:, None] * fans.doubled_areas[..., None, None] * f
            total += float(np.sum(np.matmul(VALUES.T, weighed).reshape(v.shape) * v))
        return total

    def quantity_of(self, other: _Fields) -> float:
        """The load of this pair as a quantity of the displacement of another one."""
        work = other.work(self.pair.surface.loads, self.pair.densities)
        for fans, strain in zip(self.circle.fans, other.strains(), strict=True):
            stress = self.prestress[fans.cells][:, None, None] + np.zeros_like(strain)
            work -= float(inner(fans, stress, strain).sum())
        return work


@dataclass(frozen=True, eq=False)
class _Dual:
    """The dual problems of a quantity, by what they hold on contact."""

    primal: Hypercircle
    quantity: _Quantity

    @cached_property
    def lifted(self) -> Floats:
        """z_D (n_nodes, 2)."""
        supports, lifted = self.primal.posed.supports, self.quantity.motion(self.primal.posed.space)
        if np.abs(supports.gather(lifted.ravel())).max(initial=0.0) > SAME * np.abs(lifted).max(initial=0.0):
            raise SceneError(
                "error_bound: found of= a displacement where no support of the scene holds the body in that direction; "
                "it asks for the force of a support, such as of=PrescribedDisplacement((1.0, 0.0), on='left') for that "
                "along x of Clamp(on='left')."
            )
        return lifted

    @property
    def presses(self) -> bool:
        """True where z_D moves an end of an edge towards an obstacle: what it does there is not known."""
        acting = _Held.acting(self.primal)
        return bool((acting.normal & acting.moved(self.lifted)[1]).any())

    def posed(self, held: _Held) -> PosedScene:
        """The problem in which these edges are held."""
        effects = self.primal.posed.scene.canonical
        laws = [effect for effect in effects if isinstance(effect, MaterialLaw)]
        others = [
            _AtRest(place, effect, held, self.quantity)
            for place, effect in enumerate(effects)
            if not isinstance(effect, MaterialLaw)
        ]
        scene, mesh = Scene(*laws, *others, *self.quantity.loads), self.primal.posed.space.mesh
        with unwarned():
            return pose_scene(scene, mesh, [self.quantity.t])

    def apart(self) -> _Fields:
        """z that vanishes on contact, and the stress that has no tractions there.

        This holds as the primal problem does: all that is made once a mesh serves both.
        """
        primal, posed = self.primal, self.posed(_Held.nothing(self.primal))
        check_bounded(posed)
        edges, forces = primal.boundary.edges, BodyForces(primal.fans)
        boundary = Boundary(posed, edges, DataOscillation(posed, edges))
        circle = replace(primal, posed=posed, boundary=boundary, body_forces=forces)
        points, rows = primal.posed.space.mesh.points, []
        for acts, ways in zip(primal.boundary.acting, (edges.tangents, edges.units), strict=True):
            ends, across = edges.outer_edges[acts].ravel(), edges.joints.across[acts].ravel()
            rows.append(jump_rows(ends, across, np.repeat(ways[acts], 2, axis=0)[:, None], points))
        touched = abs(sp.vstack(rows) @ primal.posed.supports.P).sum(axis=0)
        return self._fields(circle, np.flatnonzero(np.asarray(touched).ravel() < SAME))

    def frozen(self, held: _Held) -> _Fields:
        """z and stress of the problem in which these edges are held, as far as z_D does not move them."""
        circle = hypercircle(self.posed(held.released(self.lifted)))
        return self._fields(circle, np.arange(circle.posed.system.n))

    def _fields(self, circle: Hypercircle, free: Ints) -> _Fields:
        """The fields of z_h, which virtual elements find among these free unknowns."""
        posed, t = circle.posed, self.quantity.t
        own = posed if posed.system.n == len(free) else self.primal.posed
        K, P = sp.csr_matrix(own.system.K[free][:, free]), own.supports.P[:, free]
        u = self.lifted.ravel()
        force = P.T @ (posed.force(t) - own.A @ u)
        if len(free):
            u = u + P @ choose_linear(len(free)).factorise(K).solve(np.asarray(force))
        none = np.zeros(0)
        z = Instant(t=t, u=u.reshape(-1, 2), lam=np.zeros((0, 1)), p=none, weights=none, worn=none)
        try:
            circle.boundary.check_supports(z)
        except SceneError as error:
            raise SceneError(
                "error_bound: found of= a displacement of a support that ends beside another one, which holds the same "
                "direction: the force of one of two supports that meet has no limit. Ask for that of both, or for a "
                "component that the other one leaves free."
            ) from error
        return _Fields.of(circle, circle.pair(z, z), t)

    def unknown_work(self, fields: _Fields, held: _Held, pair: Pair) -> float:
        """What friction may do on z_h more than T says, on edges that are held but that z_D moves at an end."""
        boundary, edges = self.primal.boundary, self.primal.boundary.edges
        along, outward = held.moved(self.lifted)
        if (held.normal & outward).any():
            raise SceneError(
                "error_bound: found of= a displacement of a support that ends beside one-sided contact in the "
                "same direction; their forces cannot be told apart."
            )
        bound, bias, friction = pair.surface.laws
        most = np.zeros(len(edges.outer))
        np.maximum.at(most, boundary.fine.piece_owner, np.max(bound + np.abs(friction - bias), axis=1))
        size = [np.abs(np.einsum("b...d,bd->b...", one, edges.tangents)) for one in fields.on_edges]
        work = most * edges.lengths * (0.5 * size[0].sum(axis=1) + 2.0 / 3.0 * size[1])
        return float(np.sum(work[held.slip & along]))


def _interval(primal: _Fields, dual: _Fields, unknown: float) -> tuple[float, float]:
    """The bounds of q(u), some work on z_h being unknown."""
    circle, pair = primal.circle, primal.pair
    middle = dual.quantity_of(primal)
    middle += dual.work(circle.boundary.moments(pair.surface.acting), pair.densities)
    motions, of_dual_motions = (one.ends.reshape(-1, 4) for one in (primal, dual))
    middle -= float(np.einsum("bi,bij,bj->", motions, circle.boundary.springs, of_dual_motions))
    for fans, one, other, strain, of_dual in zip(
        circle.fans, primal.defects, dual.defects, primal.strains(), dual.strains(), strict=True
    ):
        still = primal.prestress[fans.cells][:, None, None]
        middle -= float(inner(fans, still + stresses_of(fans, strain), of_dual).sum())
        middle += 0.5 * float(inner(fans, other, np.matmul(one, fans.D[:, None])).sum())
    missed = pair.oscillation
    radius = 0.5 * float(np.linalg.norm(missed)) + float(np.sqrt(0.25 * primal.A2 + pair.lacking))
    width = (
        unknown
        + float(np.sqrt(dual.A2)) * radius
        + 0.5 * float(np.sum(dual.pair.oscillation * np.sqrt(primal.squares)))
    )
    width += 0.5 * float(np.sum(np.sqrt(dual.pair.springs * pair.springs))) + _misread(primal, dual)
    return middle - width, middle + width


def _misread(primal: _Fields, dual: _Fields) -> float:
    """The allowance for what may be misread of the load, on z_h, and of the quantity, on u."""
    if primal.read.exact and dual.read.exact:
        return 0.0
    eta, eta_z = primal.read.energy, dual.read.energy
    works = primal.read.work(dual.v, *dual.on_edges) + dual.read.work(primal.v, *primal.on_edges)
    return works + float(np.sqrt(dual.A2)) * eta + eta_z * (primal.pair.upper + eta)
