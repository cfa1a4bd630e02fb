"""The hypercircle: a displacement and a stress that are admissible, and the exact ones no farther away than a bound.

One step of a scene minimises

    J(v) = a(v, v) / 2 + (sigma_0, eps(v)) - l(v) + j(v),    j(v) = int g |v_t - d| + c (v_t - d) + phi(v_n - gap)

over displacements that supports admit, phi being zero up to the gap of a rigid obstacle and infinite beyond it, k z_+^2
/ 2 of a compliant one. Let u minimise it, v be admissible, and tau a stress in equilibrium with f_1 and t_1, linear
moments of the loads f and t, whose tractions -q t - p n on contact are admissible. With r = tau - sigma_0 - C eps(v),
e = u - v and

    b = j(v) - int q (v_t - d) - p v_n  +  the least that j - q - p can be  >= 0       (:mod:`.surface`)

the variational inequality (sigma, eps(e)) >= l(e) + j(u) - j(v), Green's formula for tau, and the definition of b give

    |e|^2  <=  (r, eps(e)) + (l - l_1)(e) + b  <=  sum_T (|r|_T + osc_T) |e|_T + b,

    |e|  <=  A / 2 + (A^2 / 4 + b)^{1/2},     A^2 = sum_T (|r|_T + osc_T)^2,        J(v) - A^2 / 2 - b  <=  J(u),

norms of stresses being in C^-1 (W. Prager and J. L. Synge, Quart. Appl. Math. 5 (1947); no constant but one). The loads
less their linear moments do no work on rigid motions of a triangle T, so that

    osc_T = h_T (K_T / s)^{1/2} ( |f - f_1|_T / pi + (1 / pi^2 + 1 / pi)^{1/2} (|e| / |T|)^{1/2} |t - t_1|_e ),

h_T the diameter, s the least shear modulus (2 mu): Payne and Weinberger's inequality on convex T, the divergence of
(x - a) w^2, a being the apex over the edge e, and Korn's |grad w|^2 <= K |eps(w)|^2 without mean rotation. K = 1 + 2 /
beta^2: the rotation p of w, of mean zero, is div phi of some phi that vanishes on the boundary, beta |grad phi| <= |p|,
and int p^2 = int eps(w) : M with |M| <= |grad phi|. A domain between concentric discs of the radii rho and R that is
star-shaped for the smaller one has (M. Costabel and M. Dauge, Arch. Ration. Mech. Anal. 217 (2015), arXiv 1303.6141)

    beta >= rho / (2^{1/2} R) (1 + (1 - rho^2 / R^2)^{1/2})^{-1/2},            of a disc exactly 2^{-1/2}.

What is quadratic in f - f_1 and t - t_1 counts by the norm of a stress that balances it, and only the rest like that.

Springs to the ground, k u, are as triangles are: |m - v|_k beside |r|_T, if tau has the tractions -k m on them, and the
energy norm has theirs.

From below: w that vanishes where v touches or is held has (sigma, eps(w)) = l(w), so that

    |e|  >=  (l(w) - (sigma_0 + C eps(v), eps(w))) / |w|_a,                  J(u)  <=  J(v) - half the square of that.

w is quadratic on edges, and inside cells what its values there make least energy of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints, totals
from vemcvx.bound.data_oscillation import DataOscillation
from vemcvx.bound.displacement import VALUES, FanDisplacement, fan_displacement, forces_of, strains_at_stations
from vemcvx.bound.equilibrium import Bonds, Equilibrium, edges_of, equilibrium
from vemcvx.bound.fan import (
    BARYCENTRIC,
    LINEAR_MASS_INVERSE,
    MASS,
    RULE,
    RULE_WEIGHTS,
    Fans,
    assembled,
    fans_of,
    monomials,
)
from vemcvx.bound.skeleton import Instant, check_estimable, skeleton
from vemcvx.bound.stress import PARABOLAS, fan_stress, lifted, of_edge, of_parabolas
from vemcvx.bound.surface import Boundary, Surface
from vemcvx.effects import Load
from vemcvx.errors import SceneError
from vemcvx.linear import Factor, choose_linear
from vemcvx.meshes import plane_mesh
from vemcvx.scene.pose import PosedScene
from vemcvx.vem import elastic_matrix, strains


def oscillation_constants(fans: Fans) -> tuple[Floats, Floats]:
    """(c, n) by which |f - f_1|_T and |t - t_1|_e count on the triangles of fans, e being their outer edges."""
    here, ahead = fans.corners, np.roll(fans.corners, -1, axis=1)
    sides = np.stack([np.linalg.norm(x, axis=2) for x in (ahead - here, ahead, here)], axis=2)
    area, around = 0.5 * fans.doubled_areas, sides.sum(axis=2)
    # The incentre, the centre of the fan being the origin, and how far it is from the corners.
    middle = (sides[..., 1:2] * here + sides[..., 2:3] * ahead) / around[..., None]
    radius = np.max([np.linalg.norm(middle - x, axis=2) for x in (here, ahead, 0.0 * here)], axis=0)
    ratio = 2.0 * area / (around * radius)
    beta2 = 0.5 * ratio**2 / (1.0 + np.sqrt(np.maximum(1.0 - ratio**2, 0.0)))
    common = sides.max(axis=2) * np.sqrt((1.0 + 2.0 / beta2) / fans.shear[:, None])
    return common / np.pi, common * np.sqrt((1.0 / np.pi**2 + 1.0 / np.pi) * sides[..., 0] / area)


def inner(fans: Fans, one: Floats, other: Floats) -> Floats:
    """(c, n) integrals over triangles of one : other, both (c, n, 18, 3) at stations."""
    c, n = one.shape[:2]
    weighed = np.matmul(MASS, one.reshape(c, n, 3, 6, 3)).reshape(c, n, -1)
    found: Floats = fans.doubled_areas * np.einsum("ctk,ctk->ct", weighed, other.reshape(c, n, -1))
    return found


def stresses_of(fans: Fans, strain: Floats) -> Floats:
    """C eps (c, n, 18, 3)."""
    stress: Floats = np.matmul(strain, fans.C[:, None])
    return stress


@dataclass(frozen=True, eq=False)
class Pair:
    """A displacement and a stress at an instant, admissible both, and what separates them."""

    u: Floats
    """(n_nodes, 2) of the displacement v"""
    surface: Surface
    defects: tuple[Floats, ...]
    """r (c, n, 18, 3) of each chunk of cells, at its stations"""
    w: Floats
    """of vertices and of middles of edges"""
    squares: Floats
    """(corners,) |r|_T^2 of the triangle on each edge of each cell"""
    springs: Floats
    """(b,) int k |v - m|^2 of springs on edges, m being the motion of the edges that belongs to tau"""
    oscillation: Floats
    """(corners,) osc_T"""
    densities: tuple[Floats, ...]
    """f (c, n, 21, 2) of each chunk of cells, at the points of the rule; none without body forces"""
    potential: float
    """J(v)"""
    norm: float
    """|v|_a"""
    lowered: float
    """the bound of |u - v|_a from below"""

    @property
    def triangles(self) -> Floats:
        """(corners,) (|r|_T + osc_T)^2."""
        squares: Floats = (np.sqrt(self.squares) + self.oscillation) ** 2
        return squares

    @property
    def A2(self) -> float:
        """A^2."""
        return float(self.triangles.sum() + self.springs.sum())

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
    """A pair inside a chunk of cells."""

    v: Floats
    """(c, n, 20) values at the nodes of triangles"""
    defect: Floats
    """r (c, n, 18, 3)"""
    work: Floats
    """of stresses on the functions of triangles, with a minus sign, in the shape of v"""
    energy: float
    """a(v, v)"""
    still: float
    """(sigma_0, eps(v))"""


@dataclass(frozen=True, eq=False)
class Hypercircle:
    """All of a posed scene that pairs are made of, at any instant."""

    posed: PosedScene
    boundary: Boundary
    fans: tuple[Fans, ...]
    displacements: tuple[FanDisplacement, ...]
    equilibrium: Equilibrium
    outlines: tuple[Ints, ...]
    """(c, 4 n) of each chunk the places of vertices and of middles of edges among those of all"""
    Q: sp.csr_matrix
    """(2 nodes + 2 edges, m) motions w of vertices and of middles of edges from free ones"""
    factor: Factor
    """of their energy"""

    def pair(self, now: Instant, before: Instant) -> Pair:
        """The pair of a displacement that obstacles admit, at the end of a step.

        Raises
        ------
        SceneError
            Something in the scene has no bound.
        """
        boundary, edges = self.boundary, self.boundary.edges
        boundary.check_supports(now)
        densities, prestress = self.densities_at(now.t), self._prestress(now)
        held, ends = np.einsum("bij,bej->bei", boundary.held, now.u[edges.outer_edges]), now.u[edges.outer_edges]
        weighed = [
            RULE_WEIGHTS[:, None] * fans.doubled_areas[..., None, None] * f
            for fans, f in zip(self.fans, densities, strict=False)
        ]
        moments = [np.matmul(BARYCENTRIC.T, f).reshape(len(f), -1) for f in weighed]
        surface = boundary.at(now, before, self._work(moments))
        body: list[Floats | None] = [*moments] or [None] * len(self.fans)
        stress, motion = self.equilibrium.solve(held, surface.forces, body, prestress)
        inside = [self._inside(k, now.u, body[k], tau, prestress) for k, tau in enumerate(stress)]
        defects = tuple(one.defect for one in inside)
        energy, potential = sum(one.energy for one in inside), sum(one.still for one in inside)
        residual = np.zeros(self.Q.shape[0])
        for k, one in enumerate(inside):
            work = one.work
            if weighed:
                loads = np.matmul(VALUES.T, weighed[k]).reshape(one.v.shape)
                potential -= float(np.sum(loads * one.v))
                work = work + loads
            place = self.outlines[k].ravel()
            residual += totals(place, self.displacements[k].on_outline(work).ravel(), len(residual))
        residual += self.of_tractions(surface.loads)
        energy += float(boundary.spring_energies(ends).sum())
        potential += 0.5 * energy + float(surface.cost.sum()) - float(np.sum(surface.loads[:, :2] * ends))
        left = self.Q.T @ residual
        w = self.factor.solve(left)
        return Pair(
            u=now.u,
            surface=surface,
            defects=defects,
            w=self.Q @ w,
            squares=self.squares(defects),
            springs=boundary.spring_energies(ends - motion),
            oscillation=self.oscillation(surface.acting, densities),
            densities=densities,
            potential=potential,
            norm=float(np.sqrt(max(energy, 0.0))),
            lowered=float(np.sqrt(max(float(left @ w), 0.0))),
        )

    def _prestress(self, now: Instant) -> Floats:
        """sigma_0 (n_cells, 3), one a cell."""
        if np.any(self.boundary.oscillation.stress(now.t, strains(self.posed.space, now.u))):
            raise SceneError(
                "error_bound: moduli, eigenstrains or prestress vary inside cells, and there is no bound for that; "
                "give one value a cell, as an array (n_cells,) or by on=."
            )
        prestress = self.posed.prestress
        return np.zeros((len(self.boundary.edges.areas), 3)) if prestress is None else prestress.stress(now.t)

    def _inside(self, k: int, u: Floats, F: Floats | None, tau: Floats, prestress: Floats) -> _Inside:
        """The displacement and the stress in the k-th chunk of cells."""
        fans = self.fans[k]
        v = self.displacements[k].nodal(outline_of(fans, u), F)
        strain = strains_at_stations(fans, v)
        elastic, still = stresses_of(fans, strain), prestress[fans.cells][:, None, None] + np.zeros_like(strain)
        return _Inside(
            v=v,
            defect=tau - still - elastic,
            work=-forces_of(fans, elastic + still),
            energy=float(inner(fans, strain, elastic).sum()),
            still=float(inner(fans, strain, still).sum()) if prestress.any() else 0.0,
        )

    def richer(self, pair: Pair) -> list[Floats]:
        """The defects of v + w."""
        found = []
        for fans, displacement, place, r in zip(
            self.fans, self.displacements, self.outlines, pair.defects, strict=True
        ):
            found.append(r - stresses_of(fans, strains_at_stations(fans, displacement.nodal(pair.w[place]))))
        return found

    def squares(self, stresses: Sequence[Floats]) -> Floats:
        """(corners,) squares in C^-1 of stresses (c, n, 18, 3) on the triangles of each chunk of cells."""
        found = np.zeros(len(self.boundary.edges.sides))
        for fans, r in zip(self.fans, stresses, strict=True):
            found[self._corners(fans)] = inner(fans, r, np.matmul(r, fans.D[:, None]))
        return found

    def oscillation(self, tractions: Floats, densities: Sequence[Floats]) -> Floats:
        """osc_T (corners,) of tractions (k, 3, 2) and body forces (c, n, 21, 2)."""
        edges = self.boundary.edges
        found, missed, bent = np.zeros(len(edges.sides)), np.zeros(len(edges.sides)), np.zeros((len(edges.sides), 1, 2))
        squares, bent[edges.outer_corners, 0] = self.boundary.missed(tractions)
        missed[edges.outer_corners] = np.sqrt(squares)
        for k, fans in enumerate(self.fans):
            place, (inside, outside) = self._corners(fans), oscillation_constants(fans)
            found[place] = outside * missed[place] + lifted(fans, of_edge(), bent[place])
            if densities:
                parabolas, rest = missed_forces(densities[k])
                found[place] += inside * np.sqrt(0.5 * fans.doubled_areas * rest)
                found[place] += lifted(fans, of_parabolas(), fans.doubled_areas[..., None, None] * parabolas)
        return found

    def distance(self, one: Floats, other: Floats) -> float:
        """|v - w|_a of the displacements with these nodal values (n_nodes, 2), under the same body forces."""
        squared = 0.0
        for fans, displacement in zip(self.fans, self.displacements, strict=True):
            outline = outline_of(fans, one - other)
            if outline.any():
                squared += float(np.sum(outline * fans.apply(displacement.stiffness, outline)))
        squared += float(self.boundary.spring_energies((one - other)[self.boundary.edges.outer_edges]).sum())
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
        return totals(place, work, self.Q.shape[0])

    def _work(self, moments: Sequence[Floats]) -> Floats:
        """(j,) the work of body forces (c, 6 n) on the rigid motions of bodies that nothing else holds."""
        work = np.zeros(self.boundary.motions.shape[1])
        for fans, F in zip(self.fans, moments, strict=False):
            for k, mode in enumerate(self.boundary.motions.T):
                N, x = mode.reshape(-1, 2)[fans.nodes], fans.corners - fans.corners.mean(axis=1, keepdims=True)
                turned = np.stack([-x[..., 1], x[..., 0]], axis=2)
                turn = np.einsum("cid,cid->c", turned, N) / np.einsum("cid,cid->c", x, x)
                y = fans.corners.mean(axis=1)
                centre = N.mean(axis=1) + turn[:, None] * np.stack([y[:, 1], -y[:, 0]], axis=1)
                each = np.stack([np.broadcast_to(centre[:, None], N.shape), N, np.roll(N, -1, axis=1)], axis=2)
                work[k] += float(np.sum(F * each.reshape(F.shape)))
        return work

    def densities_at(self, t: float) -> tuple[Floats, ...]:
        """Body forces (c, n, 21, 2) of each chunk of cells at the points of the rule; none if there are none."""
        loads = [load for load in self.posed.loads if isinstance(load, Load) and load.cells is not None]
        if not loads:
            return ()
        points = [fans.points() for fans in self.fans]
        return tuple(np.sum([load.at(x.reshape(-1, 2), t).reshape(x.shape) for load in loads], axis=0) for x in points)


def outline_of(fans: Fans, u: Floats) -> Floats:
    """(c, 4 n) the values of a displacement (n_nodes, 2) at vertices and middles of edges."""
    ends = u[fans.nodes]
    return np.concatenate([ends, 0.5 * (ends + np.roll(ends, -1, axis=1))], axis=1).reshape(len(ends), -1)


def missed_forces(f: Floats) -> tuple[Floats, Floats]:
    """Of body forces (c, n, 21, 2) at the points of the rule the coefficients (c, n, 3, 2) of parabolas.

    And (c, n) the mean of |f - f_2|^2. Of what differs by rounding alone nothing is missed.
    """
    rounding = 1e-13 * float(np.abs(f).max())
    weighed = RULE_WEIGHTS[:, None] * f
    bent = monomials(RULE.reshape(-1, 2)) @ PARABOLAS
    parabolas = np.matmul(bent.T, weighed)
    parabolas[np.abs(parabolas) <= rounding] = 0.0
    linear = BARYCENTRIC @ LINEAR_MASS_INVERSE @ BARYCENTRIC.T
    rest = f - np.matmul(linear, weighed) - np.matmul(bent, parabolas)
    rest[np.abs(rest) <= rounding] = 0.0
    return parabolas, 2.0 * np.einsum("q,ctqd,ctqd->ct", RULE_WEIGHTS, rest, rest)


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
    loaded = any(isinstance(load, Load) and load.cells is not None for load in posed.loads)
    displacements = tuple(fan_displacement(one, loaded) for one in fans)
    numbered = edges_of(mesh, edges, fans)
    bonds = Bonds(edges.joints.first, edges.joints.second, boundary.bonds)
    stresses = tuple(fan_stress(one, loaded) for one in fans)
    floats = boundary.motions.shape[1] > 0
    balance = equilibrium(numbered, stresses, boundary.free, bonds, springs=boundary.springs, floats=floats)
    outlines = tuple(
        _outline(one, place, posed.space.n_unknowns) for one, place in zip(fans, numbered.places, strict=True)
    )
    size = posed.space.n_unknowns + 2 * numbered.count
    A = assembled(fans, [one.stiffness for one in displacements], outlines, size)
    Q = _free_outlines(posed, boundary, numbered.outer[:, 0, 0] // 4, numbered.count)
    K = sp.csr_matrix(Q.T @ A @ Q)
    return Hypercircle(
        posed=posed,
        boundary=boundary,
        fans=fans,
        displacements=displacements,
        equilibrium=balance,
        outlines=outlines,
        Q=Q,
        factor=choose_linear(K.shape[0]).factorise(K),
    )


def _outline(fans: Fans, motions: Ints, first: int) -> Ints:
    """(c, 4 n) the places of vertices and middles of a chunk of cells, from those of motions; middles are the last."""
    edge = motions.reshape(len(fans.cells), fans.n, 4)[:, :, 0] // 4
    nodes = np.concatenate([fans.nodes, first // 2 + edge], axis=1)
    found: Ints = (2 * nodes[:, :, None] + np.arange(2)).reshape(len(nodes), -1)
    return found


def _free_outlines(posed: PosedScene, boundary: Boundary, outer: Ints, count: int) -> sp.csr_matrix:
    """Q, which leaves out what touches."""
    edges, P = boundary.edges, sp.csc_matrix(posed.supports.P)
    touched = np.zeros(posed.space.n_unknowns)
    nodes = np.unique(edges.outer_edges[boundary.touching])
    touched[(2 * nodes[:, None] + np.arange(2)).ravel()] = 1.0
    vertices = P[:, np.flatnonzero(abs(P).T @ touched == 0.0)]
    projectors = np.where(boundary.touching[:, None, None], 0.0, boundary.free)
    values, vectors = np.linalg.eigh(projectors)
    edge, axis = np.nonzero(values > 0.5)
    inner = np.ones(count, dtype=bool)
    inner[outer] = False
    alone = (2 * np.flatnonzero(inner)[:, None] + np.arange(2)).ravel()
    rows = 2 * outer[edge][:, None] + np.arange(2)
    columns = len(alone) + np.arange(len(rows))
    data = np.append(np.ones(len(alone)), vectors[edge, :, axis].ravel())
    where = np.append(alone, rows.ravel()), np.append(np.arange(len(alone)), np.repeat(columns, 2))
    middles = sp.csr_matrix((data, where), shape=(2 * count, len(alone) + len(rows)))
    return sp.csr_matrix(sp.block_diag([vertices, middles]))


def check_bounded(posed: PosedScene) -> None:
    """Raise SceneError where there is no bound."""
    plane_mesh(posed.space.mesh, "error_bound", "compare runs on finer meshes and in finer steps")
    check_estimable(posed, "error_bound")
    for load in posed.loads:
        if isinstance(load, Load) and load.cells is not None and load.matrix.shape[1] == len(load.points):
            raise SceneError(f"error_bound: there is no bound for {load.subject}, a body force of one component.")
    if posed.curves:
        raise SceneError(
            f"error_bound: there is no bound for {', '.join(posed.curves)} along a curve: a polygon, over whose "
            "corners nothing slides, is another body; vemcvx.error_budget estimates the error."
        )
