"""The hypercircle: a displacement and a stress that are admissible, and the exact ones no farther away than a bound.

The theorems are 1 and 2 of :mod:`vemcvx.bound` (W. Prager and J. L. Synge, Quart. Appl. Math. 5 (1947)), for a step
with

    j(v) = int g |v_t - d| + c (v_t - d) + phi(v_n - gap),

phi being zero up to the gap of a rigid obstacle and infinite beyond it, k z_+^2 / 2 of a compliant one; :mod:`.surface`
has b. osc_K^2 = sum_T osc_T^2 over the triangles T of a cell K, by what linear moments miss of loads
(:mod:`.body_force`), and so counts in A^2 = sum_T (|r|_T + osc_T)^2.

Springs to the ground, k u, are as triangles are: |m - v|_k beside |r|_T, if tau has the tractions -k m on them, and the
energy norm has theirs.

w, by which the error is bounded from below, is quadratic on edges, and inside cells what its values there make least
energy of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.bound.body_force import Body, BodyForces, alone, oscillation_constants
from vemcvx.bound.data_oscillation import DataOscillation
from vemcvx.bound.displacement import (
    FanDisplacement,
    OutlineValues,
    edge_forces,
    edge_motions,
    fan_displacement,
    outline_forces,
    strains_at_stations,
    without_slopes,
)
from vemcvx.bound.equilibrium import Equilibrium, edges_of, equilibrium, gathered
from vemcvx.bound.fan import Fans, fans_of, in_triangles, stresses_of
from vemcvx.bound.reading import Reading, reading
from vemcvx.bound.richer import Richer, richer
from vemcvx.bound.skeleton import Instant, check_estimable, skeleton
from vemcvx.bound.stress import fan_stress, lifted, of_edge
from vemcvx.bound.surface import Boundary, Surface, free_alone
from vemcvx.meshes import plane_mesh
from vemcvx.scene.pose import PosedScene
from vemcvx.vem import elastic_matrix

IN_SPACE = (
    "in space a displacement inside polyhedra that does not lock and a constant for loads that are not linear are "
    "missing (the docstring of vemcvx.bound says how far it goes); vemcvx.error_budget estimates the error"
)


@dataclass(frozen=True, eq=False)
class Defect:
    """r of a displacement and a stress, by what makes it; linear in all three.

    With x the motions of edges that belong to tau, less those of v, and u what :class:`OutlineValues` says of v,

        |r|_K^2  =  x . G x  +  u . S u  -  L u . G L u  +  |r_f|^2  -  2 (b_f . L u + f(u)),

    G and S being the stiffness of stresses and of displacements in K, L u the motions of edges by u, r_f the defect and
    b_f the forces of edges under the body force alone, f(u) its work on u.
    """

    motion: Floats
    """x (4 E,)"""
    outline: Floats
    """(2 nodes + 2 E,) v at vertices and at middles of edges"""
    densities: tuple[Floats, ...]
    """f (c, n, 21, 2) of each chunk of cells, at the points of the rule; none without body forces"""

    def __sub__(self, other: Defect) -> Defect:
        densities = tuple(a - b for a, b in zip(self.densities, other.densities, strict=True))
        return Defect(self.motion - other.motion, self.outline - other.outline, densities)


@dataclass(frozen=True, eq=False)
class Pair:
    """A displacement and a stress at an instant, admissible both, and what separates them."""

    circle: Hypercircle
    t: float
    u: Floats
    """(n_nodes, 2) of the displacement v"""
    surface: Surface
    defect: Defect
    w: Floats
    """of vertices and of middles of edges"""
    squares: Floats
    """(n_cells,) |r|_K^2"""
    springs: Floats
    """(b,) int k |v - m|^2 of springs on edges, m being the motion of the edges that belongs to tau"""
    oscillation: Floats
    """(corners,) osc_T"""
    cells: Floats
    """(n_cells,) (|r|_K + osc_K)^2"""
    potential: float
    """J(v)"""
    norm: float
    """|v|_a"""
    lowered: float
    """the bound of |u - v|_a from below"""

    @property
    def densities(self) -> tuple[Floats, ...]:
        """f (c, n, 21, 2) of each chunk of cells, at the points of the rule; none without body forces."""
        return self.defect.densities

    @property
    def richer(self) -> Defect:
        """r of v + w."""
        motion = self.defect.motion - self.circle.equilibrium.edges.motions(self.w)
        return replace(self.defect, motion=motion, outline=self.defect.outline + self.w)

    @cached_property
    def reading(self) -> Reading:
        """The difference of two readings of the loads, in which they are as large as they are."""
        return reading(self.circle.boundary, self.circle.fans, self.densities, self.t)

    def allowances(self) -> tuple[float, float]:
        """For what may be misread of the loads: eta, and |e(u)| of the exact u.

        Both are zero where two readings agree (:mod:`vemcvx.bound.reading`).
        """
        # The readings of a copy, so that a run does not keep those of all its steps.
        read, circle = replace(self).reading, self.circle
        if read.exact:
            return 0.0, 0.0
        eta, ends = read.energy, self.u[circle.boundary.edges.outer_edges]
        return eta, read.work(circle.nodal(self.defect.outline), ends) + eta * self.upper

    @property
    def A2(self) -> float:
        """A^2."""
        return float(self.cells.sum() + self.springs.sum())

    @property
    def lacking(self) -> float:
        """b."""
        return float(self.surface.gap.sum())

    @property
    def upper(self) -> float:
        """The bound of |u - v|_a from above."""
        return float(0.5 * np.sqrt(self.A2) + np.sqrt(0.25 * self.A2 + self.lacking))


@dataclass(frozen=True, eq=False)
class _Inside:
    """A displacement in a chunk of cells, and the forces of edges and outlines that it and its body force make."""

    v: OutlineValues
    stress: Floats
    """(c, 3) of its linear part"""
    edges: Floats
    """(c, 4 n) G L u + b_f"""
    outline: Floats
    """(c, 4 n) S u"""
    squares: Floats
    """(c,) |r|_K^2 less x . G x"""


@dataclass(frozen=True, eq=False)
class Hypercircle:
    """The parts of a posed scene that pairs are made of, at any instant."""

    posed: PosedScene
    boundary: Boundary
    fans: tuple[Fans, ...]
    displacements: tuple[FanDisplacement, ...]
    equilibrium: Equilibrium
    inside: Richer
    body_forces: BodyForces

    @property
    def outlines(self) -> tuple[Ints, ...]:
        """(c, 4 n) of each chunk the places of vertices and of middles of edges among those of all."""
        return self.inside.outlines

    def pair(self, now: Instant, before: Instant) -> Pair:
        """The pair of a displacement that obstacles admit, at the end of a step.

        Raises
        ------
        SceneError
            Something in the scene has no bound.
        """
        boundary, edges, numbered = self.boundary, self.boundary.edges, self.equilibrium.edges
        boundary.check_supports(now)
        if boundary.oscillation.varies_inside_cells(now.t):
            raise SceneError(
                "error_bound: moduli, eigenstrains or prestress vary inside cells, and there is no bound for that; "
                "give one value a cell, as an array (n_cells,) or by on=."
            )
        densities, prestress, ends = self.densities_at(now.t), self.prestress(now.t), now.u[edges.outer_edges]
        body, outline = self.body_forces.of(densities), numbered.outline(now.u)
        surface = self.surface(now, before, body)
        inside = [self._inside(k, outline, body[k : k + 1]) for k in range(len(self.fans))]
        # The linear part of v and the prestress are constant stresses, that of tau less these what x strains.
        still = [prestress[fans.cells] for fans in self.fans]
        constant = [edge_forces(fans, one.stress + b) for fans, one, b in zip(self.fans, inside, still, strict=True)]
        tractions = [a + one.edges for a, one in zip(constant, inside, strict=True)]
        given = -gathered(numbered.places, tractions, 4 * numbered.count)
        pull = np.einsum("bij,bj->bi", boundary.springs, ends.reshape(-1, 4)).reshape(ends.shape)
        np.add.at(given, numbered.outer, surface.forces - pull)
        largest = max(float(np.abs(one).max(initial=0.0)) for one in (*tractions, surface.forces))
        motion, squares = self.equilibrium.solve(given, largest)
        work = [-outline_forces(a) - one.outline for a, one in zip(constant, inside, strict=True)]
        springs, potential = float(boundary.spring_energies(ends).sum()), float(surface.cost.sum())
        for fans, one, b in zip(self.fans, inside, still, strict=True):
            potential += float(fans.areas @ np.einsum("ck,ck->c", b, one.v.strain))
            squares[fans.cells] += one.squares
        squares = np.maximum(squares, 0.0)
        energy, of_body = self._inner(inside, body, outline)
        for k, f in enumerate(body):
            work[k] = work[k] + f.outline
        residual = gathered(self.outlines, work, self.inside.size) + self.of_tractions(surface.loads)
        w, lowered = self.inside.best(residual, motion)
        defect = Defect(motion, outline, densities)
        oscillation = self.oscillation(surface.acting, body)
        return Pair(
            circle=self,
            t=now.t,
            u=now.u,
            surface=surface,
            defect=defect,
            w=w,
            squares=squares,
            springs=boundary.spring_energies(motion[numbered.outer]),
            oscillation=oscillation,
            cells=self.enlarged(squares, defect, oscillation),
            potential=potential + 0.5 * (energy + springs) - of_body - float(np.sum(surface.loads[:, :2] * ends)),
            norm=float(np.sqrt(max(energy + springs, 0.0))),
            lowered=lowered,
        )

    def surface(self, now: Instant, before: Instant, body: Sequence[Body] | None = None) -> Surface:
        """The surface at the end of a step, under the body forces of its end, if these are not given."""
        if body is None:
            body = self.body_forces.of(self.densities_at(now.t)) if self.boundary.motions.shape[1] else ()
        modes = [self.equilibrium.edges.outline(mode.reshape(-1, 2)) for mode in self.boundary.motions.T]
        parts = [[np.vdot(f.outline, mode[at]) for mode in modes] for f, at in zip(body, self.outlines, strict=False)]
        return self.boundary.at(now, before, np.sum(parts, axis=0) if parts else np.zeros(len(modes)))

    def prestress(self, t: float) -> Floats:
        """sigma_0 (n_cells, 3)."""
        stresses = self.posed.prestress
        return np.zeros((len(self.boundary.edges.areas), 3)) if stresses is None else stresses.stress(t)

    def _inside(self, k: int, outline: Floats, body: Sequence[Body]) -> _Inside:
        """The displacement with these values in the k-th chunk of cells, under its body force, if there is one."""
        fans, displacement, stress = self.fans[k], self.displacements[k], self.equilibrium.stresses[k]
        v = without_slopes(fans, outline[self.outlines[k]])
        motions = edge_motions(v.bent)
        edges, on_outline = fans.apply(stress.stiffness, motions), fans.apply(displacement.stiffness, v.bent)
        squares = np.einsum("ci,ci->c", v.bent, on_outline) - np.einsum("ci,ci->c", motions, edges)
        for f in body:
            squares += f.squares - 2.0 * np.einsum("ci,ci->c", f.mixed, v.bent)
            edges = edges + f.edges
        return _Inside(v, np.matmul(fans.C, v.strain[:, :, None])[:, :, 0], edges, on_outline, squares)

    def inner(self, u: Floats, t: float) -> tuple[float, float]:
        """|v|^2 in cells of the displacement with nodal values (n_nodes, 2), and the work of body forces on it."""
        body, outline = self.body_forces.of(self.densities_at(t)), self.equilibrium.edges.outline(u)
        return self._inner([self._inside(k, outline, body[k : k + 1]) for k in range(len(self.fans))], body, outline)

    def _inner(self, inside: Sequence[_Inside], body: Sequence[Body], outline: Floats) -> tuple[float, float]:
        energy, work = sum(f.energy for f in body), sum(f.work for f in body)
        for fans, one in zip(self.fans, inside, strict=True):
            energy += float(fans.areas @ np.einsum("ck,ck->c", one.stress, one.v.strain))
            energy += float(np.vdot(one.v.bent, one.outline))
        for f, place in zip(body, self.outlines, strict=False):
            work += float(np.sum(f.outline * outline[place]))
        return energy, work

    def nodal(self, outline: Floats) -> list[Floats]:
        """(c, n, 20) of each chunk a displacement at the nodes of triangles, by its outline (2 nodes + 2 E,)."""
        return [one.nodal(outline[place]) for one, place in zip(self.displacements, self.outlines, strict=True)]

    def fields(self, defect: Defect) -> tuple[Floats, ...]:
        """r (c, n, 18, 3) of each chunk of cells, at its stations."""
        return tuple(self.at_stations(k, defect) for k in range(len(self.fans)))

    def at_stations(self, k: int, defect: Defect) -> Floats:
        """r (c, n, 18, 3) in the k-th chunk of cells, at its stations, under the defect's body forces."""
        fans, motion = self.fans[k], defect.motion[self.equilibrium.edges.places[k]]
        bent = without_slopes(fans, defect.outline[self.outlines[k]]).bent
        tau = self.equilibrium.stresses[k].at_stations(motion + edge_motions(bent))
        r = tau - stresses_of(fans, strains_at_stations(fans, self.displacements[k].nodal(bent)))
        return r + alone(fans, defect.densities[k])[1] if defect.densities else r

    def enlarged(self, squares: Floats, defect: Defect, oscillation: Floats) -> Floats:
        """(n_cells,) sums of (|r|_T + osc_T)^2, from |r|_K^2 and osc_T (corners,).

        On 6 x 6 hexagons (|r|_K + osc_K)^2 would make bounds larger by 5 %; these take a third more time.
        """
        larger = squares + totals(self.boundary.edges.owner, oscillation**2, len(squares))
        for k, fans in enumerate(self.fans):
            missed = oscillation[self._corners(fans)]
            if missed.any():
                r = np.sqrt(in_triangles(fans, self.at_stations(k, defect)))
                larger[fans.cells] += 2.0 * np.sum(missed * r, axis=1)
        return np.asarray(larger)

    def squares_of(self, defect: Defect, body: Sequence[Body]) -> Floats:
        """(n_cells,) |r|_K^2."""
        found = np.zeros(len(self.boundary.edges.areas))
        for k, stress in enumerate(self.equilibrium.stresses):
            x = defect.motion[self.equilibrium.edges.places[k]]
            own = np.einsum("ci,ci->c", x, stress.fans.apply(stress.stiffness, x))
            found[stress.fans.cells] = own + self._inside(k, defect.outline, body[k : k + 1]).squares
        return np.maximum(found, 0.0)

    def squares_of_change(self, before: Pair, now: Pair) -> Floats:
        """(n_cells,) squares of what r of v + w changes by from one pair to another, larger by what is missed of it."""
        defect = now.richer - before.richer
        body = self.body_forces.of(defect.densities)
        missed = self.oscillation(now.surface.acting - before.surface.acting, body)
        return self.enlarged(self.squares_of(defect, body), defect, missed)

    def squares(self, stresses: Sequence[Floats]) -> Floats:
        """(corners,) squares in C^-1 of stresses (c, n, 18, 3) on the triangles of each chunk of cells."""
        found = np.zeros(len(self.boundary.edges.sides))
        for fans, r in zip(self.fans, stresses, strict=True):
            found[self._corners(fans)] = in_triangles(fans, r)
        return found

    def oscillation(self, tractions: Floats, body: Sequence[Body]) -> Floats:
        """osc_T (corners,) of tractions (k, 3, 2) and body forces."""
        edges = self.boundary.edges
        found, missed, bent = np.zeros(len(edges.sides)), np.zeros(len(edges.sides)), np.zeros((len(edges.sides), 1, 2))
        squares, on_edges = self.boundary.missed(tractions)
        missed[edges.outer_corners], bent[edges.outer_corners, 0] = np.sqrt(squares), on_edges
        loaded = np.zeros(len(edges.areas), dtype=bool)
        loaded[edges.outer[(squares != 0.0) | on_edges.any(axis=1)]] = True
        for fans in self.fans:
            rows = np.flatnonzero(loaded[fans.cells])
            if len(rows):
                part = fans.part(rows)
                at = self._corners(part)
                found[at] = oscillation_constants(part)[1] * missed[at] + lifted(part, of_edge(), bent[at])
        for fans, f in zip(self.fans, body, strict=False):
            found[self._corners(fans)] += f.missed
        return found

    def distance(self, one: Floats, other: Floats) -> float:
        """|v - w|_a of the displacements with these nodal values (n_nodes, 2), under the same body forces."""
        apart = one - other
        squared = float(self.boundary.spring_energies(apart[self.boundary.edges.outer_edges]).sum())
        for made in self.displacements:
            outline = outline_of(made.fans, apart)
            squared += float(np.vdot(outline, made.fans.apply(made.stiffness, outline)))
        return float(np.sqrt(max(squared, 0.0)))

    def _corners(self, fans: Fans) -> Ints:
        """(c, n) the corners of the mesh at which the edges of these cells begin."""
        return plane_mesh(self.posed.space.mesh, "error_bound").offsets[fans.cells][:, None] + np.arange(fans.n)

    @property
    def middles(self) -> Ints:
        """(b,) the places of the middles of boundary edges among those of vertices and middles."""
        return self.posed.space.n_unknowns // 2 + self.equilibrium.edges.outer[:, 0, 0] // 4

    def of_tractions(self, loads: Floats) -> Floats:
        """The work of loads (b, 3, 2) on boundary edges on vertices and middles, whose functions are quadratic."""
        edges = self.boundary.edges
        nodes = 2 * edges.outer_edges[:, :, None] + np.arange(2)
        middles = 2 * self.middles[:, None] + np.arange(2)
        place = np.concatenate([nodes.ravel(), middles.ravel()])
        work = np.concatenate([(loads[:, :2] - 0.5 * loads[:, 2:]).ravel(), loads[:, 2].ravel()])
        return totals(place, work, self.inside.size)

    def densities_at(self, t: float) -> tuple[Floats, ...]:
        """Body forces (c, n, 21, 2) of each chunk of cells at the points of the rule; none if there are none."""
        loads = self.boundary.oscillation.body_loads
        if not loads:
            return ()
        return tuple(
            np.sum([load.at(x.reshape(-1, 2), t).reshape(x.shape) for load in loads], axis=0) for x in self._points
        )

    @cached_property
    def _points(self) -> tuple[Floats, ...]:
        """(c, n, 21, 2) of each chunk of cells: 1.3 kB a square, a twelfth of the body forces' part of a step."""
        return tuple(fans.points() for fans in self.fans)


def outline_of(fans: Fans, u: Floats) -> Floats:
    """(c, 4 n) the values of a displacement (n_nodes, 2) at vertices and middles of edges."""
    ends = u[fans.nodes]
    return np.concatenate([ends, 0.5 * (ends + np.roll(ends, -1, axis=1))], axis=1).reshape(len(ends), -1)


def hypercircle(posed: PosedScene) -> Hypercircle:
    """The Hypercircle of a posed scene.

    Raises
    ------
    SceneError
        Something in the scene has no bound.
    """
    check_bounded(posed)
    mesh = plane_mesh(posed.space.mesh, "error_bound")
    edges = skeleton(posed)
    boundary = Boundary(posed, edges, DataOscillation(posed, edges))
    fans = fans_of(posed.space, elastic_matrix(posed.material.moduli))
    displacements = tuple(fan_displacement(one, False) for one in fans)
    numbered = edges_of(mesh, edges, fans)
    balance = equilibrium(numbered, tuple(fan_stress(one, False) for one in fans), boundary)
    outlines = tuple(
        _outline(one, place, posed.space.n_unknowns) for one, place in zip(fans, numbered.places, strict=True)
    )
    free = _free_outlines(posed, boundary, numbered.outer[:, 0, 0] // 4, numbered.count)
    return Hypercircle(
        posed=posed,
        boundary=boundary,
        fans=fans,
        displacements=displacements,
        equilibrium=balance,
        inside=richer(balance, displacements, outlines, free),
        body_forces=BodyForces(fans),
    )


def _outline(fans: Fans, motions: Ints, first: int) -> Ints:
    """(c, 4 n) the places of vertices and middles of a chunk of cells, from those of motions; middles are the last."""
    edge = motions.reshape(len(fans.cells), fans.n, 4)[:, :, 0] // 4
    nodes = np.concatenate([fans.nodes, first // 2 + edge], axis=1)
    found: Ints = (2 * nodes[:, :, None] + np.arange(2)).reshape(len(nodes), -1)
    return found


def _free_outlines(posed: PosedScene, boundary: Boundary, outer: Ints, count: int) -> Floats:
    """(nodes + E, 2, 2) projectors on what supports leave free of vertices and of middles that touch nothing."""
    edges, P = boundary.edges, sp.csc_matrix(posed.supports.P)
    touched = np.zeros(P.shape[0])
    nodes = np.unique(edges.outer_edges[boundary.touching])
    touched[(2 * nodes[:, None] + np.arange(2)).ravel()] = 1.0
    middles = np.tile(np.eye(2), (count, 1, 1))
    middles[outer] = np.where(boundary.touching[:, None, None], 0.0, boundary.free)
    vertices = free_alone(P[:, np.flatnonzero(abs(P).T @ touched == 0.0)])
    return np.concatenate([vertices, middles])


def check_bounded(posed: PosedScene) -> None:
    """Raise SceneError where there is no bound."""
    plane_mesh(posed.space.mesh, "error_bound", IN_SPACE)
    check_estimable(posed, "error_bound")
    if posed.curves:
        raise SceneError(
            f"error_bound: there is no bound for {', '.join(posed.curves)} along a curve: a polygon, over whose "
            "corners nothing slides, is another body; vemcvx.error_budget estimates the error."
        )
