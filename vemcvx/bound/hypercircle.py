"""The hypercircle: a displacement and a stress that are admissible, and the exact ones no farther away than a bound.

The theorems are 1 and 2 of :mod:`vemcvx.bound` (W. Prager and J. L. Synge, Quart. Appl. Math. 5 (1947)), for a step
with

    j(v) = int g |v_t - d| + c (v_t - d) + phi(v_n - gap),

phi being zero up to the gap of a rigid obstacle and infinite beyond it, k z_+^2 / 2 of a compliant one; :mod:`.surface`
has b. Springs to the ground, k u, are as triangles are: |m - v|_k beside |r|_K, if tau has the tractions -k m on them,
and the energy norm has theirs.

**The defect.** In a cell let x be the motions of edges that belong to tau, less those L u of v, u the values of v on
the outline less a linear displacement, and f the numbers of the body force. Of the forms G of stresses (:mod:`.stress`)
and S of displacements (:mod:`.displacement`), with L for motions from values beside one for f,

    |r|_K^2  =  x . G x  +  (u, f) . (S - L' G L) (u, f).

*Proof.* The stresses of x, without divergence, are orthogonal to the rest of r: that of L u does the work on x that v
does, that of f is of least energy, and v of f vanishes on the outline. What is left is |tau|^2 - 2 (tau, eps(v)) +
|v|^2 of L u and f, in which the second term is the work of the tractions of tau on v and of f on it.

**From below.** w is quadratic on edges, inside cells what its values there make least energy of, and vanishes where v
touches or is held; the best one is that of S w = R, R being the residual of v. The displacement v + w is richer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.bound.displacement import displacement_form, edge_forces, to_edges, without_slopes
from vemcvx.bound.equilibrium import Equilibrium, assembled, axes_of, edges_of, equilibrium
from vemcvx.bound.fan import FORCES, Fans, fans_of, gathered
from vemcvx.bound.reading import SAFETY, Reader, Reading
from vemcvx.bound.skeleton import Instant, check_estimable, skeleton
from vemcvx.bound.stress import stress_form
from vemcvx.bound.surface import Boundary, Surface, free_alone
from vemcvx.linear import Factor, choose_linear
from vemcvx.meshes import plane_mesh
from vemcvx.scene import PosedScene
from vemcvx.vem import elastic_matrix

IN_SPACE = (
    "in space a displacement inside polyhedra that does not lock is missing (the docstring of vemcvx.bound says how "
    "far it goes); vemcvx.error_budget estimates the error"
)


@dataclass(frozen=True, eq=False)
class Forms:
    """The forms of a chunk of cells, one matrix (k, 4 n + 6, 4 n + 6) a shape, by its outline and its body force."""

    fans: Fans
    outlines: Ints
    """(c, 4 n) the places of vertices and of middles of edges among those of all"""
    stress: Floats
    """G, by motions of edges"""
    displacement: Floats
    """S, by values at vertices and middles"""

    @cached_property
    def defect(self) -> Floats:
        """S - L' G L."""
        n = 4 * self.fans.n
        L = np.eye(n + FORCES)
        L[:n, :n] = to_edges(self.fans.n)
        defect: Floats = self.displacement - L.T @ self.stress @ L
        return defect

    def forms(self, matrices: Floats, one: Floats, other: Floats) -> Floats:
        """(c,) the forms of vectors (c, m) of cells."""
        of_cells: Floats = np.einsum("cm,cm->c", one, self.fans.apply(matrices, other))
        return of_cells


@dataclass(frozen=True, eq=False)
class Defect:
    """r of a displacement and a stress, by what makes it; linear in all three."""

    motion: Floats
    """x (4 E,)"""
    outline: Floats
    """(2 nodes + 2 E,) v at vertices and at middles of edges"""
    body: Floats
    """f (n_cells, 6)"""

    def __sub__(self, other: Defect) -> Defect:
        return Defect(self.motion - other.motion, self.outline - other.outline, self.body - other.body)


@dataclass(frozen=True, eq=False, kw_only=True)
class Pair:
    """A displacement and a stress at an instant, admissible both, and what separates them."""

    circle: Hypercircle
    t: float
    u: Floats
    """(n_nodes, 2) of the displacement v"""
    surface: Surface
    read: Reading
    defect: Defect
    w: Floats
    """of vertices and of middles of edges"""
    cells: Floats
    """(n_cells,) |r|_K^2"""
    springs: Floats
    """(b,) int k |v - m|^2 of springs on edges, m being the motion of the edges that belongs to tau"""
    potential: float
    """J(v)"""
    norm: float
    """|v|_a"""
    lowered: float
    """the bound of |u - v|_a from below"""

    @property
    def richer(self) -> Defect:
        """r of v + w."""
        motion = self.defect.motion - self.circle.equilibrium.edges.motions @ self.w
        return replace(self.defect, motion=motion, outline=self.defect.outline + self.w)

    def allowances(self) -> tuple[float, float]:
        """For what is not read of the data: eta, and |e(u)| of the exact u; zero where data are linear."""
        if self.read.exact:
            return 0.0, 0.0
        eta = self.read.energy
        return eta, self.circle.misread(self.read, self.defect) + SAFETY * self.read.on_gaps + eta * self.upper

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


@dataclass(frozen=True, eq=False, kw_only=True)
class Hypercircle:
    """The parts of a posed scene that pairs are made of, at any instant."""

    posed: PosedScene
    boundary: Boundary
    forms: tuple[Forms, ...]
    equilibrium: Equilibrium
    free: sp.csr_matrix
    """(2 nodes + 2 E, m) orthonormal columns, the w there are"""
    factor: Factor | None
    """of S on these, if there are any"""

    def pair(self, now: Instant, before: Instant) -> Pair:
        """The pair of a displacement that obstacles admit, at the end of a step.

        Raises
        ------
        SceneError
            Something in the scene has no bound.
        """
        boundary = self.boundary
        boundary.check_supports(now)
        if boundary.reader.varies_inside_cells(now.t):
            raise SceneError(
                "error_bound: moduli, eigenstrains or prestress vary inside cells, and there is no bound for that; "
                "give one value a cell, as an array (n_cells,) or by on=."
            )
        read = boundary.reader.at(now)
        surface = boundary.at(now, before, read, self.work(read.body, boundary.motions))
        return self.joined((now.t, now.u), surface, read, self.prestress(now.t))

    def joined(self, at: tuple[float, Floats], surface: Surface, read: Reading, still: Floats) -> Pair:
        """The pair of a displacement (n_nodes, 2) at an instant, under body forces and the prestress (n_cells, 3)."""
        (t, u), boundary, numbered = at, self.boundary, self.equilibrium.edges
        defect = Defect(np.zeros(4 * numbered.count), numbered.outline(u), read.body)
        ends = u[boundary.edges.outer_edges]
        tractions, work = self._forces_of(defect, still)
        pull = np.einsum("bij,bj->bi", boundary.springs, ends.reshape(-1, 4)).reshape(ends.shape)
        given = -tractions
        np.add.at(given, numbered.outer, surface.forces - pull)
        largest = max(float(np.abs(one).max(initial=0.0)) for one in (tractions, surface.forces))
        motion = self.equilibrium.solve(given, largest)
        w, lowered = self._best(self.of_tractions(surface.loads) - work)
        defect, springs = replace(defect, motion=motion), boundary.spring_energies(ends).sum()
        energy, at_rest = self.products(defect, defect)[0].sum() + springs, self.stretched(still, defect)
        loads = float(self.works(read.body, defect).sum() + np.sum(surface.loads * ends))
        return Pair(
            circle=self,
            t=t,
            u=u,
            surface=surface,
            read=read,
            defect=defect,
            w=w,
            cells=self.squares(defect),
            springs=boundary.spring_energies(motion[numbered.outer]),
            potential=float(0.5 * energy + at_rest - loads + surface.cost.sum()),
            norm=float(np.sqrt(max(energy, 0.0))),
            lowered=lowered,
        )

    def prestress(self, t: float) -> Floats:
        """sigma_0 (n_cells, 3)."""
        stresses = self.posed.prestress
        return np.zeros((len(self.boundary.edges.areas), 3)) if stresses is None else stresses.stress(t)

    def of_tractions(self, forces: Floats) -> Floats:
        """(2 nodes + 2 E,) the work of int t phi (b, 2, 2) at both ends of boundary edges on vertices and middles."""
        edges = self.equilibrium.edges
        whole = totals(edges.outer.ravel(), forces.ravel(), 4 * edges.count)
        work: Floats = edges.motions.T @ whole
        return work

    def _forces_of(self, defect: Defect, still: Floats) -> tuple[Floats, Floats]:
        """The tractions (4 E,) on edges of the stress of motions L u, and the work of that of v on all outlines.

        Both are under body forces, and with the prestress `still` (n_cells, 3).
        """
        tractions, works = list[Floats](), list[Floats]()
        for one in self.forms:
            v, n = without_slopes(one.fans, defect.outline[one.outlines]), 4 * one.fans.n
            L, f = to_edges(one.fans.n), defect.body[one.fans.cells]
            constant = np.matmul(one.fans.C, v.strain[:, :, None])[:, :, 0] + still[one.fans.cells]
            even = edge_forces(one.fans, constant)
            tractions.append(even + one.fans.apply(one.stress[:, :n], np.concatenate([v.bent @ L.T, f], axis=1)))
            works.append(even @ L + one.fans.apply(one.displacement[:, :n], np.concatenate([v.bent, f], axis=1)))
        edges = self.equilibrium.edges
        on_edges = gathered(edges.places, tractions, 4 * edges.count)
        return on_edges, gathered([one.outlines for one in self.forms], works, len(defect.outline))

    def _best(self, residual: Floats) -> tuple[Floats, float]:
        """w and the bound of |u - v|_a from below, by the residual of v."""
        if self.factor is None:
            return np.zeros(len(residual)), 0.0
        left = self.free.T @ residual
        part = self.factor.solve(left)
        w, work = self.free @ part, float(left @ part)
        # As it is, not as it should be: near nu = 1/2 the solution is rounded.
        energy = float(sum(self._inner(one, w, w).sum() for one in self.forms))
        return (w, work / float(np.sqrt(energy))) if work > 0.0 and energy > 0.0 else (0.0 * w, 0.0)

    def _inner(self, one: Forms, v: Floats, w: Floats) -> Floats:
        """(c,) a(v, w) in a chunk of cells of displacements by their outlines, without body forces."""
        n = 4 * one.fans.n
        (a, b) = (without_slopes(one.fans, each[one.outlines]) for each in (v, w))
        linear = np.einsum("ck,ckl,cl->c", a.strain, one.fans.C, b.strain)
        return one.fans.areas * linear + one.forms(one.displacement[:, :n, :n], a.bent, b.bent)

    def products(self, one: Defect, other: Defect) -> tuple[Floats, Floats]:
        """(n_cells,) a(v, v') and (r, r') in C^-1 of two displacements and their defects."""
        energies, defects = np.zeros((2, len(self.boundary.edges.areas)))
        for form, place in zip(self.forms, self.equilibrium.edges.places, strict=True):
            at, n = form.fans.cells, 4 * form.fans.n
            f, h = one.body[at], other.body[at]
            energies[at] = self._inner(form, one.outline, other.outline)
            energies[at] -= form.forms(form.displacement[:, n:, n:], f, h)
            whole = [
                np.concatenate([without_slopes(form.fans, each.outline[form.outlines]).bent, each.body[at]], axis=1)
                for each in (one, other)
            ]
            defects[at] = form.forms(form.stress[:, :n, :n], one.motion[place], other.motion[place])
            defects[at] += form.forms(form.defect, *whole)
        return energies, defects

    def squares(self, defect: Defect) -> Floats:
        """(n_cells,) |r|_K^2."""
        return np.maximum(self.products(defect, defect)[1], 0.0)

    def works(self, body: Floats, v: Defect) -> Floats:
        """(n_cells,) the work of body forces (n_cells, 6) on the displacement of a defect."""
        found = np.zeros(len(body))
        for one in self.forms:
            at, n = one.fans.cells, 4 * one.fans.n
            whole = np.concatenate([v.outline[one.outlines], v.body[at]], axis=1)
            found[at] = -one.forms(one.displacement[:, :, n:], whole, body[at])
        return found

    def work(self, body: Floats, motions: Floats) -> Floats:
        """(j,) the work of body forces (n_cells, 6) on rigid motions (n_u, j)."""
        outlines = [self.equilibrium.edges.outline(mode.reshape(-1, 2)) for mode in motions.T]
        rigid = [Defect(np.zeros(0), outline, 0.0 * body) for outline in outlines]
        return np.array([self.works(body, one).sum() for one in rigid])

    def stretched(self, stress: Floats, v: Defect) -> float:
        """(sigma, eps(v)) of constant stresses (n_cells, 3) in cells."""
        total = 0.0
        for one in self.forms:
            strain = without_slopes(one.fans, v.outline[one.outlines]).strain
            total += float(one.fans.areas @ np.einsum("ck,ck->c", stress[one.fans.cells], strain))
        return total

    def misread(self, read: Reading, v: Defect) -> float:
        """|e(v)| of the displacement of a defect."""
        edges = self.equilibrium.edges
        forces = self.boundary.forces_of(read.tractions_apart)
        along = np.sum(forces * (edges.motions @ v.outline)[edges.outer], axis=(1, 2))
        bent = np.zeros(len(read.body))
        for one in self.forms:
            n, inside = 4 * one.fans.n, without_slopes(one.fans, v.outline[one.outlines])
            bent[one.fans.cells] = one.forms(one.displacement[:, :n, :n], inside.bent, inside.bent)
            f = v.body[one.fans.cells]
            bent[one.fans.cells] -= one.forms(one.displacement[:, n:, n:], f, f)
        return read.misread((self.works(read.body_apart, v), along), bent)


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
    fans = fans_of(posed.space, elastic_matrix(posed.material.moduli))
    centres = np.zeros((mesh.n_cells, 2))
    for one in fans:
        centres[one.cells] = one.centres
    boundary = Boundary(posed, edges, Reader(posed, edges, centres))
    numbered = edges_of(mesh, edges, fans)
    forms = tuple(
        Forms(one, _outline(one, place, posed.space.n_unknowns), stress_form(one), displacement_form(one))
        for one, place in zip(fans, numbered.places, strict=True)
    )
    stiffness = tuple(np.ascontiguousarray(one.stress[:, : 4 * one.fans.n, : 4 * one.fans.n]) for one in forms)
    free, factor = _freed(posed, boundary, forms, numbered.outer[:, 0, 0] // 4)
    return Hypercircle(
        posed=posed,
        boundary=boundary,
        forms=forms,
        equilibrium=equilibrium(numbered, fans, stiffness, boundary),
        free=free,
        factor=factor,
    )


def _outline(fans: Fans, motions: Ints, first: int) -> Ints:
    """(c, 4 n) the places of vertices and middles of a chunk of cells, from those of motions; middles are the last."""
    edge = motions.reshape(len(fans.cells), fans.n, 4)[:, :, 0] // 4
    nodes = np.concatenate([fans.nodes, first // 2 + edge], axis=1)
    found: Ints = (2 * nodes[:, :, None] + np.arange(2)).reshape(len(nodes), -1)
    return found


def _freed(
    posed: PosedScene, boundary: Boundary, forms: Sequence[Forms], outer: Ints
) -> tuple[sp.csr_matrix, Factor | None]:
    """What supports leave free of vertices and of middles that touch nothing, and the factor of S on that."""
    edges, P = boundary.edges, sp.csc_matrix(posed.supports.P)
    touched = np.zeros(P.shape[0])
    nodes = np.unique(edges.outer_edges[boundary.touching])
    touched[(2 * nodes[:, None] + np.arange(2)).ravel()] = 1.0
    count = (1 + max(int(one.outlines.max()) for one in forms)) // 2 - posed.space.n_unknowns // 2
    middles = np.tile(np.eye(2), (count, 1, 1))
    middles[outer] = np.where(boundary.touching[:, None, None], 0.0, boundary.free)
    vertices = free_alone(P[:, np.flatnonzero(abs(P).T @ touched == 0.0)])
    which, axes = axes_of(np.concatenate([vertices, middles]))
    size, m = 2 * (len(vertices) + count), len(which)
    places = (2 * which[:, None] + np.arange(2)).ravel(), np.repeat(np.arange(m), 2)
    free = sp.csr_matrix((axes.ravel(), places), shape=(size, m))
    if m == 0:
        return free, None
    S = [one.fans.of_cells(one.displacement[:, : 4 * one.fans.n, : 4 * one.fans.n]) for one in forms]
    K = sp.csr_matrix(free.T @ assembled([one.outlines for one in forms], S, size) @ free)
    return free, choose_linear(m).factorise(K)


def check_bounded(posed: PosedScene) -> None:
    """Raise SceneError where there is no bound."""
    plane_mesh(posed.space.mesh, "error_bound", IN_SPACE)
    check_estimable(posed, "error_bound")
    if posed.curves:
        raise SceneError(
            f"error_bound: there is no bound for {', '.join(posed.curves)} along a curve: a polygon, over whose "
            "corners nothing slides, is another body; vemcvx.error_budget estimates the error."
        )
