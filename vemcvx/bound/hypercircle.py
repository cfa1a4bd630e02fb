"""The hypercircle: an admissible displacement v and an admissible stress tau, with bounds on the error of v.

Source: W. Prager and J. L. Synge, Quart. Appl. Math. 5 (1947). :mod:`vemcvx.bound` has the theorems.

**The defect** is r = tau - sigma_0 - C eps(v), with the elastic tensor C and the prestress sigma_0. Edge motions m
determine the stress tau (:mod:`.equilibrium`). The matrix L maps v to edge motions L v (`to_edges`). Linear tractions
do the same work on v and on L v. In a cell K, let x = m - L v, and let f be the coefficients of the body force. The
outline of v consists of the values at vertices and middles of edges. Let v_1 be a linear function with the mean strain
of v, and y the outline of v - v_1. With the forms G of stresses (:mod:`.stress`) and S of displacements
(:mod:`.displacement`)

    |r|_K^2  =  x . G x  +  (y, f) . (S - L' G L) (y, f),        L (y, f) := (L y, f).

*Proof* for sigma_0 = 0. Let tau_x be the stress due to x, and tau_0 = tau - tau_x the stress due to L v and f. Let
r_0 = tau_0 - C eps(v), so that r = tau_x + r_0. The tractions of tau_x do the work (tau_x, eps(v)) on v, and the same
work on L v. Of all stresses in balance with f, tau_0 maximises the work on L v minus the energy (:mod:`.stress`). So
tau_x does the work (tau_x, C^-1 tau_0) on L v, and (tau_x, C^-1 r_0) = 0. The stress r_0 is the same for v and v - v_1.
Finally, |r_0|^2 = |tau_0|^2 - 2 (tau_0, eps(v)) + |v|^2. Here (tau_0, eps(v)) is the work of f and of the tractions of
tau_0 on v.

**The lower bound.** Let W be the space of displacements that are quadratic on edges, have least energy inside cells,
and vanish on the supports and on edges with friction, obstacles or bonded bodies. With the residual R of Theorem 2, we
compute w in W with a(w, z) = R(z) for all z in W. The lower bound is R(w) / |w| = |w|. We call v + w *richer*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.bound.displacement import displacement_form, split_outline, to_edges
from vemcvx.bound.equilibrium import Equilibrium, assemble, axes_of, edges_of, equilibrium
from vemcvx.bound.fan import FORCES, Fans, fans_of, gather
from vemcvx.bound.reading import Reader, Reading
from vemcvx.bound.skeleton import Instant, check_estimable, skeleton
from vemcvx.bound.stress import stress_form
from vemcvx.bound.surface import Boundary, Surface, free_alone
from vemcvx.linear import Factor, choose_linear
from vemcvx.meshes import plane_mesh
from vemcvx.scene import InitialStresses, PosedScene
from vemcvx.vem.tensors import elastic_matrix


@dataclass(frozen=True, eq=False)
class Forms:
    """The forms (k, 4 n + 6, 4 n + 6) of k shapes of cells with n vertices."""

    fans: Fans
    outlines: Ints  # (c, 4 n) positions of cell outlines in `Defect.outline`
    stress: Floats  # G, for edge motions and body force
    displacement: Floats  # S, for values at vertices and edge middles, and body force

    @cached_property
    def defect(self) -> Floats:
        """The matrices S - L' G L."""
        n = 4 * self.fans.n
        L = np.eye(n + FORCES)
        L[:n, :n] = to_edges(self.fans.n)
        return np.asarray(self.displacement - L.T @ self.stress @ L)

    def forms(self, matrices: Floats, one: Floats, other: Floats) -> Floats:
        """Return x . M y (c,) for x = `one`, y = `other`, and the matrix M of each cell."""
        return np.asarray(np.einsum("cm,cm->c", one, self.fans.apply(matrices, other)))


@dataclass(frozen=True, eq=False)
class Defect:
    """The defect r = tau - sigma_0 - C eps(v) on a mesh with E edges."""

    motion: Floats  # (4 E,) edge motions x
    outline: Floats  # (2 nodes + 2 E,) values of v at vertices and middles of edges
    body: Floats  # (n_cells, 6) coefficients f of the body force

    def __sub__(self, other: Defect) -> Defect:
        return Defect(self.motion - other.motion, self.outline - other.outline, self.body - other.body)


@dataclass(frozen=True, eq=False, kw_only=True)
class Pair:
    """An admissible displacement v and an admissible stress tau at an instant."""

    circle: Hypercircle
    t: float
    u: Floats  # (n_nodes, 2) nodal values of v
    surface: Surface
    read: Reading
    prestress: Floats  # (n_cells, 3) sigma_0
    defect: Defect
    w: Floats  # (2 nodes + 2 E,) values of w at vertices and middles of edges
    cells: Floats  # (n_cells,) |r|_K^2
    potential: float  # J(v) of vemcvx.bound
    norm: float  # |v|_a
    lower: float  # lower bound of |u - v|_a

    @cached_property
    def richer(self) -> Defect:
        """The defect of v + w."""
        motion = self.defect.motion - self.circle.equilibrium.edges.motions @ self.w
        return replace(self.defect, motion=motion, outline=self.defect.outline + self.w)

    @cached_property
    def richer_A2(self) -> float:
        """The squared norm |r|^2 with v + w in place of v."""
        return float(self.circle.squares(self.richer).sum())

    def work_of(self, load: Pair) -> float:
        """Return the work of another pair's loads and prestress on v + w."""
        return self.work(load.surface.loads, load.read.body) - self.circle.work_of_stress(load.prestress, self.richer)

    def work(self, forces: Floats, body: Floats) -> float:
        """Return the work of edge forces (b, 2, 2) and body forces (n_cells, 6) on v + w."""
        on_edges = self.circle.work_of_tractions(forces) @ self.richer.outline
        return float(on_edges + self.circle.works(body, self.richer).sum())

    @property
    def A2(self) -> float:
        """The squared norm |r|^2."""
        return float(self.cells.sum())

    @property
    def law_defect(self) -> float:
        """The defect b in the laws of friction and contact."""
        return float(self.surface.gap.sum())

    @property
    def upper(self) -> float:
        """The upper bound of |u - v|_a."""
        return float(0.5 * np.sqrt(self.A2) + np.sqrt(0.25 * self.A2 + self.law_defect))


@dataclass(frozen=True, eq=False, kw_only=True)
class Hypercircle:
    """Operators that compute pairs for a posed scene."""

    posed: PosedScene
    boundary: Boundary
    forms: tuple[Forms, ...]
    equilibrium: Equilibrium
    free: sp.csr_matrix  # (2 nodes + 2 E, m) orthonormal basis of the space W
    factor: Factor | None  # factor of S in the basis `free`; None for an empty basis

    def pair(self, now: Instant, before: Instant) -> Pair:
        """Return the pair at the end of a step, or raise SceneError."""
        boundary = self.boundary
        boundary.check_supports(now)
        if boundary.reader.varies_inside_cells(now.t):
            raise SceneError(
                "error_bound: moduli, eigenstrains or prestress vary inside cells, for which there is no bound; "
                "give one value per cell, as an array (n_cells,) or by on=."
            )
        read = boundary.reader.at(now)
        surface = boundary.at(now, before, read, self.work(read.body, boundary.motions))
        return self.make_pair((now.t, now.u), surface, read, self.posed.prestress)

    def make_pair(
        self, at: tuple[float, Floats], surface: Surface, read: Reading, stresses: InitialStresses | None
    ) -> Pair:
        """Return the pair of a displacement (n_nodes, 2) at an instant."""
        (t, u), boundary, numbered = at, self.boundary, self.equilibrium.edges
        prestress = np.zeros((len(read.body), 3)) if stresses is None else stresses.stress(t)
        defect = Defect(np.zeros(4 * numbered.count), numbered.outline(u), read.body)
        ends = u[boundary.edges.outer_edges]
        tractions, work = self._forces_of(defect, prestress)
        given = -tractions
        np.add.at(given, numbered.outer, surface.forces)
        largest = max(float(np.abs(one).max(initial=0.0)) for one in (tractions, surface.forces))
        motion = self.equilibrium.solve(given, largest)
        w, lower = self._best(self.work_of_tractions(surface.loads) - work)
        defect = replace(defect, motion=motion)
        energy, at_rest = self.products(defect, defect)[0].sum(), self.work_of_stress(prestress, defect)
        loads = float(self.works(read.body, defect).sum() + np.sum(surface.loads * ends))
        return Pair(
            circle=self,
            t=t,
            u=u,
            surface=surface,
            read=read,
            prestress=prestress,
            defect=defect,
            w=w,
            cells=self.squares(defect),
            potential=float(0.5 * energy + at_rest - loads + surface.cost.sum()),
            norm=float(np.sqrt(max(energy, 0.0))),
            lower=lower,
        )

    def work_of_tractions(self, forces: Floats) -> Floats:
        """Map forces on outer edges to equivalent forces at vertices and edge middles."""
        edges = self.equilibrium.edges
        whole = totals(edges.outer.ravel(), forces.ravel(), 4 * edges.count)
        return np.asarray(edges.motions.T @ whole)

    def _forces_of(self, defect: Defect, prestress: Floats) -> tuple[Floats, Floats]:
        """Return forces on edges, and forces at vertices and edge middles."""
        tractions, works = list[Floats](), list[Floats]()
        for one in self.forms:
            n, (strain, bent) = 4 * one.fans.n, split_outline(one.fans, defect.outline[one.outlines])
            L, f = to_edges(one.fans.n), defect.body[one.fans.cells]
            stress = np.matmul(one.fans.C, strain[:, :, None])[:, :, 0] + prestress[one.fans.cells]
            half = np.matmul(one.fans.normals, 0.5 * stress[:, [[0, 2], [2, 1]]])
            even = np.repeat(half[:, :, None], 2, axis=2).reshape(-1, n)
            tractions.append(even + one.fans.apply(one.stress[:, :n], np.concatenate([bent @ L.T, f], axis=1)))
            works.append(even @ L + one.fans.apply(one.displacement[:, :n], np.concatenate([bent, f], axis=1)))
        edges = self.equilibrium.edges
        on_edges = gather(edges.places, tractions, 4 * edges.count)
        return on_edges, gather([one.outlines for one in self.forms], works, len(defect.outline))

    def _best(self, residual: Floats) -> tuple[Floats, float]:
        """Return w and the lower bound of |u - v|_a."""
        if self.factor is None:
            return np.zeros(len(residual)), 0.0
        left = self.free.T @ residual
        part = self.factor.solve(left)
        w, work = self.free @ part, float(left @ part)
        # Near Poisson's ratio 1/2, |w|^2 and `work` differ by rounding errors.
        energy = float(sum(self._inner(one, w, w).sum() for one in self.forms))
        return (w, work / float(np.sqrt(energy))) if work > 0.0 and energy > 0.0 else (0.0 * w, 0.0)

    def _inner(self, one: Forms, v: Floats, w: Floats) -> Floats:
        """Return a(v, w) (c,) in the cells of a chunk."""
        n = 4 * one.fans.n
        (of_v, bent_v), (of_w, bent_w) = (split_outline(one.fans, each[one.outlines]) for each in (v, w))
        linear = np.einsum("ck,ckl,cl->c", of_v, one.fans.C, of_w)
        return one.fans.areas * linear + one.forms(one.displacement[:, :n, :n], bent_v, bent_w)

    def products(self, one: Defect, other: Defect) -> tuple[Floats, Floats]:
        """Return a(v, v') and (r, C^-1 r') of two defects, in each cell."""
        energies, defects = np.zeros((2, len(self.boundary.edges.mesh.areas)))
        for form, place in zip(self.forms, self.equilibrium.edges.places, strict=True):
            at, n = form.fans.cells, 4 * form.fans.n
            f, h = one.body[at], other.body[at]
            energies[at] = self._inner(form, one.outline, other.outline)
            energies[at] -= form.forms(form.displacement[:, n:, n:], f, h)
            whole = [
                np.concatenate([split_outline(form.fans, each.outline[form.outlines])[1], each.body[at]], axis=1)
                for each in (one, other)
            ]
            defects[at] = form.forms(form.stress[:, :n, :n], one.motion[place], other.motion[place])
            defects[at] += form.forms(form.defect, *whole)
        return energies, defects

    def squares(self, defect: Defect) -> Floats:
        """Return |r|_K^2, (n_cells,)."""
        return np.maximum(self.products(defect, defect)[1], 0.0)

    def works(self, body: Floats, v: Defect) -> Floats:
        """Return the work of body forces (n_cells, 6) on v, cell by cell."""
        found = np.zeros(len(body))
        for one in self.forms:
            at, n = one.fans.cells, 4 * one.fans.n
            whole = np.concatenate([v.outline[one.outlines], v.body[at]], axis=1)
            found[at] = -one.forms(one.displacement[:, :, n:], whole, body[at])
        return found

    def work(self, body: Floats, motions: Floats) -> Floats:
        """Return the work of body forces (n_cells, 6) on each rigid motion."""
        outlines = [self.equilibrium.edges.outline(mode.reshape(-1, 2)) for mode in motions.T]
        rigid = [Defect(np.zeros(0), outline, 0.0 * body) for outline in outlines]
        return np.array([self.works(body, one).sum() for one in rigid])

    def work_of_stress(self, stress: Floats, v: Defect) -> float:
        """Return (sigma, eps(v)) for the stress sigma = `stress`, constant in each cell."""
        total = 0.0
        for one in self.forms:
            strain = split_outline(one.fans, v.outline[one.outlines])[0]
            total += float(one.fans.areas @ np.einsum("ck,ck->c", stress[one.fans.cells], strain))
        return total


def hypercircle(posed: PosedScene) -> Hypercircle:
    """Return the Hypercircle of a posed scene, or raise SceneError."""
    check_bounded(posed)
    mesh = plane_mesh(posed.space.mesh, "error_bound")
    edges = skeleton(posed)
    fans = fans_of(posed.space, elastic_matrix(posed.material.moduli))
    boundary = Boundary(posed, edges, Reader(posed, edges, fans))
    numbered = edges_of(mesh, edges, fans)
    forms = tuple(
        Forms(one, _outline(one, place, posed.space.n_unknowns), stress_form(one), displacement_form(one))
        for one, place in zip(fans, numbered.places, strict=True)
    )
    stiffness = tuple(np.ascontiguousarray(one.stress[:, : 4 * one.fans.n, : 4 * one.fans.n]) for one in forms)
    free, factor = _find_free(posed, boundary, forms, numbered.outer[:, 0, 0] // 4)
    return Hypercircle(
        posed=posed,
        boundary=boundary,
        forms=forms,
        equilibrium=equilibrium(numbered, fans, stiffness, boundary),
        free=free,
        factor=factor,
    )


def _outline(fans: Fans, motions: Ints, first: int) -> Ints:
    edge = motions.reshape(len(fans.cells), fans.n, 4)[:, :, 0] // 4
    nodes = np.concatenate([fans.nodes, first // 2 + edge], axis=1)
    return np.asarray((2 * nodes[:, :, None] + np.arange(2)).reshape(len(nodes), -1))


def _find_free(
    posed: PosedScene, boundary: Boundary, forms: Sequence[Forms], outer: Ints
) -> tuple[sp.csr_matrix, Factor | None]:
    """Return the attributes `free` and `factor` of the hypercircle."""
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
    S = [one.fans.expand(one.displacement[:, : 4 * one.fans.n, : 4 * one.fans.n]) for one in forms]
    K = sp.csr_matrix(free.T @ assemble([one.outlines for one in forms], S, size) @ free)
    return free, choose_linear(m).factorise(K)


def check_bounded(posed: PosedScene) -> None:
    """Raise SceneError if a scene has no error bound."""
    in_space = "in space there is no bound yet (see the docstring of vemcvx.bound for the reason)"
    plane_mesh(posed.space.mesh, "error_bound", f"{in_space}; vemcvx.error_budget estimates the error")
    posed.space.refuse_revolution("error_bound")
    check_estimable(posed, "error_bound")
    if posed.springs is not None:
        raise SceneError(
            "error_bound: there is no bound with springs to the ground (ElasticFoundation), or with a user's stiffness "
            "in addition to the material's; vemcvx.error_budget estimates the error."
        )
    if posed.curves:
        raise SceneError(
            f"error_bound: there is no bound for {', '.join(posed.curves)} along a curve: the mesh has corners there, "
            "over which nothing slides; vemcvx.error_budget estimates the error."
        )
