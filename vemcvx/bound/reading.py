"""Reading of data for bounds and estimates: fits that are linear on edges and in cells, and their remainders.

Effects are evaluated again, on edges cut into pieces (:mod:`vemcvx.bound.fine_boundary`). *Error bounds* use fits by
linear functions. On every edge, these are fits to mean tractions on pieces and to friction bounds at new nodes; in
every cell, fits to body forces. Error bounds are theorems if these data, gaps and ground motions are linear. Otherwise
bounds are theorems for the fits, the data *as read*. The load minus its fit is the omitted load l_0(w), a linear
functional of displacements w. Its norm eta = sup l_0(w) / |w| is estimated by

    SAFETY times the energy norm of the body's response to the difference between the fits and fits to fewer points,
    plus the root of the sum over cells of the energies (see below) of the remainders (data minus fits).

The solutions for the data and for their fits differ by at most eta, also with friction and contact. The minima of a
step differ by at most |l_0(v)| + eta |u - v| + eta^2 / 2, plus SAFETY times the work of the pressure on the remainders
of gaps. Features narrower than the distance between points may be missed.

*Estimates* (:mod:`vemcvx.estimate.unseen`) use assembled data in place of linear fits. Let t and f be errors of
tractions and body forces, and d the motion that exact gaps or ground motions would add between nodes.

    errors of       work on a displacement v             energy
    tractions       int t . v                            l_e / (2 mu) |t|^2_e
    body forces     int f . v                            d_K^2 / (9 mu) |f|^2_K
    compliance      int (k z_+ - p_h) v_n                |k z_+ - p_h|^2_e / (2 mu / l_e + k)
    gaps            (d is added to u)                    2 mu max |d|^2
    motions         (d is added to u)                    2 mu |d|_e |d'|_e
    moduli, heat    int ((C - C_K) eps(u) + sigma_0 - sigma_0K) : eps(v)      |.|^2_K in C^-1

with edge length l_e, derivative d' along the edge, longest side d_K of a cell's box, depth z and stiffness k of
:mod:`.surface`, interpolated nodal pressure p_h, and assembled C_K and sigma_0K of the cell. The first two energies
follow from Poincare inequalities on an edge of a half space (the exact factor of l_e / (2 mu) is (3 - 4 nu) / pi <=
.96) and on a cell. If t or f is orthogonal to linear functions, half of its energy suffices. A wave d on the surface of
a half space, with wave number kappa, stores 2 mu kappa |d|^2: at most the energy of "motions".

These energies are local. Errors in the means of tractions and body forces are forces r that move the whole body: two
solutions for loads that differ by r differ by at most (r'K^-1 r)^{1/2} in the energy norm of the discrete space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, ROUNDING, SAME, Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.bound.fine_boundary import SPACING, FineBoundary, SamplePoints, fine_boundary, in_cells
from vemcvx.bound.skeleton import Instant, Skeleton, pressures_at_ends
from vemcvx.effects import Contribution, Effect, Friction, Load, MaterialLaw, Obstacle, Support
from vemcvx.linear import Factor
from vemcvx.meshes.polygons import positions
from vemcvx.scene import PosedScene, contributions, suppress_scene_warnings
from vemcvx.vem import Space
from vemcvx.vem.tensors import elastic_matrix

SAFETY = 2.0
"""Safety factor of the difference between two readings."""
POINCARE = 1.0 / 9.0
"""Constant of the Poincare inequality: 1 / pi^2 for convex cells in a box of longer side 1; 10 % more for rotations."""


@dataclass(frozen=True, eq=False)
class LocalFit:
    """A least-squares fit of values at points, separately on each part (an edge or a cell)."""

    owner: Ints
    """(q,) part of each point"""
    basis: Floats
    """(q, j) basis functions at points, whose span contains constants"""
    weights: Floats
    """(q,) weights of points"""
    count: int
    """number of parts"""

    @cached_property
    def matrix(self) -> sp.csr_matrix:
        """The matrix (count * j, q) from values to coefficients."""
        q, j = self.basis.shape
        gram = np.zeros((self.count, j, j))
        np.add.at(gram, self.owner, self.weights[:, None, None] * self.basis[:, :, None] * self.basis[:, None])
        gram[np.bincount(self.owner, self.weights, self.count) == 0.0] = np.eye(j)
        entries = np.einsum("qij,qj->qi", np.linalg.inv(gram)[self.owner], self.basis) * self.weights[:, None]
        rows = self.owner[:, None] * j + np.arange(j)
        return sp.csr_matrix((entries.ravel(), (rows.ravel(), np.repeat(np.arange(q), j))), shape=(self.count * j, q))

    def fit(self, values: Floats) -> Floats:
        """Return the coefficients (count, j, d) of values (q, d)."""
        return np.asarray(self.matrix @ values).reshape(self.count, self.basis.shape[1], -1)

    def at_points(self, coefficients: Floats) -> Floats:
        """Return the values (q, d) of coefficients (count, j, d) at the points."""
        return np.asarray(np.einsum("qj,qjd->qd", self.basis, coefficients[self.owner]))

    @cached_property
    def second(self) -> LocalFit:
        """The fit with the weights 1.5 and 0.5 in turn, half-way from equal weights to the weights 2 and 0."""
        return replace(self, weights=np.where(np.arange(len(self.owner)) % 2 == 0, 1.5, 0.5) * self.weights)

    @cached_property
    def means(self) -> LocalFit:
        """The fit by constants."""
        return replace(self, basis=np.ones((len(self.owner), 1)))

    def read(self, values: Floats) -> tuple[Floats, Floats, Floats]:
        """Return coefficients, their differences from a fit to every other point, and remainders (q, d)."""
        found = self.fit(values)
        apart, left = 2.0 * (self.second.fit(values) - found), values - self.at_points(found)
        return found, *_remove_rounding(values, apart, left)

    def compare_means(self, values: Floats, known: Floats) -> tuple[Floats, Floats]:
        """Return the differences of means from known means (count, d), and remainders (q, d)."""
        apart = self.means.fit(values)[:, 0] - known
        left = values - (known + apart)[self.owner]
        return _remove_rounding(values, apart, left)


def _remove_rounding(values: Floats, apart: Floats, left: Floats) -> tuple[Floats, Floats]:
    """Return the differences `apart` and `left`, set to zero where they are rounding errors of `values`."""
    rounding = SAME * np.abs(values).max(initial=0.0)
    return np.where(np.abs(apart) <= rounding, 0.0, apart), np.where(np.abs(left) <= rounding, 0.0, left)


@dataclass(frozen=True, eq=False)
class Reading:
    """The data at an instant: fits that are linear on edges and in cells, and remainders."""

    reader: Reader
    tractions: Floats
    """(b, 2, 2) tractions at the ends of edges"""
    friction: Floats
    """(b, 2) given bounds of friction at the ends of edges"""
    body: Floats
    """(n_cells, 6) coefficients of body forces, as in :class:`.fan.Fans`"""
    tractions_apart: Floats
    """(b, 2, 2) differences of tractions in a second reading"""
    body_apart: Floats
    """(n_cells, 6) differences of body forces in a second reading"""
    on_pieces: Floats
    """(k, 2) remainders of tractions"""
    in_cells: Floats
    """(q, 2) remainders of body forces"""
    others: Floats
    """(n_cells,) energies of remainders of friction bounds, gaps and ground motions"""
    on_gaps: float
    """work of the computed pressure on remainders of gaps"""

    @property
    def exact(self) -> bool:
        """True if data are linear at all examined points."""
        left = self.tractions_apart, self.body_apart, self.on_pieces, self.in_cells, self.others
        return not any(one.any() for one in left)

    def __sub__(self, other: Reading) -> Reading:
        """Return the change of data since another instant."""
        names = "tractions", "friction", "body", "tractions_apart", "body_apart", "on_pieces", "in_cells"
        new = {name: getattr(self, name) - getattr(other, name) for name in names}
        return replace(self, **new, others=np.abs(self.others - other.others))

    @cached_property
    def local(self) -> Floats:
        """The energies (n_cells,) of remainders in cells and on their edges."""
        return 0.5 * self.reader.energies(self.on_pieces, self.in_cells) + self.others

    @property
    def energy(self) -> float:
        """The estimate eta."""
        if self.exact:
            return 0.0
        on_edges = self.reader.edges.lengths[:, None] * self.tractions_apart.mean(axis=1)
        apart = self.reader.body_energies(on_edges, self.reader.forces_of(self.body_apart))
        return float(np.sqrt(self.local.sum()) + SAFETY * np.sqrt(apart.sum()))

    def estimate_omitted_work(self, works: Sequence[Floats], bent: Floats) -> float:
        """Estimate |l_0(w)|, given the `works` that the differences between both readings do on w.

        `bent` (n_cells,) are the energies of w minus its linear part: on the linear part, remainders do no work.
        """
        left = np.sum(np.sqrt(self.local * np.maximum(bent, 0.0)))
        return float(SAFETY * sum(np.abs(one).sum() for one in works) + left)


@dataclass(frozen=True, eq=False)
class Reader:
    """The data of a posed scene, and the points at which they are read."""

    posed: PosedScene
    edges: Skeleton
    centres: Floats
    """(n_cells, 2) origins of the linear functions for body forces"""
    effects: Sequence[Effect] | None = None
    """effects with these data; None for the effects of the scene"""

    @cached_property
    def fine(self) -> FineBoundary:
        """The mesh with edges cut into pieces, on which effects contribute again."""
        return fine_boundary(self.edges.mesh, self.edges)

    @cached_property
    def parts(self) -> list[Contribution]:
        """Contributions of all effects, even if their data are zero, to the fine mesh."""
        return list_parts(self.posed, Space(self.fine.mesh), self.effects)

    @property
    def frictions(self) -> list[Friction]:
        """The frictions of all effects, even if their data are zero."""
        return [friction for part in self.parts for friction in part.frictions]

    @property
    def obstacles(self) -> list[Obstacle]:
        """The obstacles of all effects, even if their data are zero."""
        return [obstacle for part in self.parts for obstacle in part.obstacles]

    @property
    def supports(self) -> list[Support]:
        """The supports of all effects, even if their data are zero."""
        return [support for part in self.parts for support in part.supports]

    @cached_property
    def body_loads(self) -> list[Load]:
        """The body forces of all effects, even if their data are zero."""
        loads = [load for part in self.parts for load in part.loads if load.cells is not None]
        for load in loads:
            if load.matrix.shape[1] == len(load.points):
                raise SceneError(
                    f"error_bound: there is no bound for {load.subject}, a body force of one component; give it as a "
                    "vector, as BodyForce does."
                )
        return loads

    @cached_property
    def springs(self) -> Floats:
        """The stiffness (q, 2, 2) per length of springs to the ground at new nodes."""
        springs, each = np.zeros((self.fine.mesh.n_nodes, 2, 2)), np.tile(np.eye(2), (self.fine.mesh.n_nodes, 1))
        for part in self.parts:
            if part.material is None and part.stiffness is not None:
                springs += (part.stiffness @ each).reshape(-1, 2, 2)
        return np.asarray(springs[self.fine.old :] / self.fine.lengths[:, None, None])

    # Loads.

    @cached_property
    def inside(self) -> SamplePoints:
        """The sample points in cells."""
        return in_cells(self.edges.mesh)

    @cached_property
    def pieces(self) -> LocalFit:
        """The fit by linear functions on boundary edges, for mean values on pieces."""
        owner, counts = self.fine.piece_owner, np.bincount(self.fine.piece_owner)
        place = np.arange(len(owner)) - (np.cumsum(counts) - counts)[owner]
        s = (place + 0.5) / counts[owner]
        return LocalFit(owner, np.column_stack([1.0 - s, s]), (self.edges.lengths / counts)[owner], len(counts))

    @cached_property
    def cells(self) -> LocalFit:
        """The fit by linear functions in cells, for values at the sample points."""
        return self._about_centres(self.inside)

    @cached_property
    def _coarse(self) -> tuple[SamplePoints, LocalFit]:
        """The coarser sample points in cells, for a second reading, and their fit."""
        inside = in_cells(self.edges.mesh, 0.75 * SPACING)
        return inside, self._about_centres(inside)

    def _about_centres(self, inside: SamplePoints) -> LocalFit:
        h = np.sqrt(self.edges.mesh.areas)
        about = (inside.x - self.centres[inside.owner]) / h[inside.owner, None]
        return LocalFit(inside.owner, np.column_stack([np.ones(len(about)), about]), inside.weights, len(h))

    def on_pieces(self, t: float) -> Floats:
        """Return the mean tractions (k, 2) of loads on pieces."""
        fine, force = self.fine, np.zeros(self.fine.pieces.shape)
        for load in (load for part in self.parts for load in part.loads):
            if load.edges is not None:
                np.add.at(force, positions(load.edges, fine.pieces, fine.mesh.n_nodes), load.forces(t))
        return np.asarray(force / self.pieces.weights[:, None])

    def body_force(self, points: SamplePoints, t: float) -> Floats:
        """Return the body force (q, 2) at points."""
        return np.sum([load.in_cells(points.x, points.owner, t) for load in self.body_loads], axis=0)

    def body(self, t: float) -> tuple[Floats, Floats, Floats]:
        """Return body forces (n_cells, 6), their differences in a second reading, and remainders (q, 2)."""
        h = np.sqrt(self.edges.mesh.areas)
        if not self.body_loads:
            return np.zeros((len(h), 6)), np.zeros((len(h), 6)), np.zeros((0, 2))
        f, (coarse, fit) = self.body_force(self.inside, t), self._coarse
        found = self.cells.fit(f)
        second = fit.fit(self.body_force(coarse, t))
        apart, left = _remove_rounding(f, second - found, f - self.cells.at_points(found))
        scales = np.column_stack([np.ones(len(h)), 1.0 / h, 1.0 / h])[..., None]
        body, body_apart = ((one * scales).reshape(len(h), 6) for one in (found, apart))
        return body, body_apart, left

    def forces_of(self, body: Floats) -> Floats:
        """Return the force (n_cells, 2) of a body force (n_cells, 6) in each cell."""
        about = self.posed.space.mesh.centroids - self.centres
        values = np.column_stack([np.ones(len(about)), about])
        return np.asarray(self.edges.mesh.areas[:, None] * np.einsum("cj,cjd->cd", values, body.reshape(-1, 3, 2)))

    def at(self, now: Instant) -> Reading:
        """Return the data at an instant."""
        tractions, apart, on_pieces = self.pieces.read(self.on_pieces(now.t))
        body, body_apart, in_cells = self.body(now.t)
        friction, squares = self._bounds(now.t)
        squares += self.between_nodes(now)
        return Reading(
            reader=self,
            tractions=tractions,
            friction=friction,
            body=body,
            tractions_apart=apart,
            body_apart=body_apart,
            on_pieces=on_pieces,
            in_cells=in_cells,
            others=totals(self.edges.outer, squares, len(body)),
            on_gaps=self._work_on_gaps(now),
        )

    def _bounds(self, t: float) -> tuple[Floats, Floats]:
        """Return given bounds of friction (b, 2) at the ends of edges, and the energies (b,) of remainders."""
        fine, g = self.fine, np.zeros((len(self.fine.owner), 1))
        for friction in (one for one in self.frictions if one.law is None):
            at, bound, _ = fine.read(friction, (friction.weights(t) / friction.lengths)[:, None])
            g[at] += bound
        basis = np.column_stack([1.0 - fine.along, fine.along])
        found, _, left = LocalFit(fine.owner, basis, fine.lengths, len(self.compliances)).read(g)
        return np.maximum(found[..., 0], 0.0), 0.5 * self.compliances * self.sums(slice(None), left[:, 0] ** 2)

    # Energies: on boundary edges (b,), in cells (n_cells,).

    @cached_property
    def compliances(self) -> Floats:
        """The compliances l_e / (2 mu), (b,)."""
        return np.asarray(self.edges.lengths / (2.0 * self.edges.shear[self.edges.outer]))

    def sums(self, at: Ints | slice, values: Floats) -> Floats:
        """Return integrals over edges of values at new nodes."""
        return totals(self.fine.owner[at], self.fine.lengths[at] * values, len(self.edges.outer))

    def energies(self, on_pieces: Floats, in_cells: Floats) -> Floats:
        """Return the energies (n_cells,) of tractions (k, 2) on pieces, and of body forces (q, 2) at points if any."""
        edges, inside, n = self.edges, self.inside, len(self.edges.mesh.areas)
        squares = totals(self.fine.piece_owner, self.pieces.weights * np.sum(on_pieces**2, axis=1), len(edges.outer))
        found = totals(edges.outer, self.compliances * squares, n)
        if len(in_cells):
            within = totals(inside.owner, inside.weights * np.sum(in_cells**2, axis=1), n)
            found += POINCARE * edges.sizes**2 / edges.shear * within
        return found

    def between_nodes(self, now: Instant, compliant: bool = False) -> Floats:
        """Return the energies (b,) of gaps and ground motions that are not linear between nodes.

        With `compliant`, include compliant obstacles whose gap is linear, but whose pressure is not.
        """
        squares = np.zeros(len(self.edges.outer))
        for friction in (one for one in self.frictions if one.ground is not None):
            assert friction.ground is not None
            at, moved, line = self.fine.read(friction, friction.ground.vector(now.t))
            squares += self.motion_energies(at, moved - line)
        return squares + np.sum([self._obstacle_energies(one, now, compliant) for one in self.obstacles], axis=0)

    def _work_on_gaps(self, now: Instant) -> float:
        """Return int p |gap - line|, the work of pressure if the gap differs from its linear interpolation `line`."""
        if not self.obstacles:
            return 0.0
        pressure, work = pressures_at_ends(self.posed, self.edges, now), 0.0
        for obstacle in self.obstacles:
            at, gap, line = self.fine.read(obstacle, obstacle.gap(now.t)[:, None])
            work += float(np.sum(self.fine.lengths[at] * np.abs(gap - line)[:, 0] * self.fine.between(pressure, at)))
        return work

    def motion_energies(self, at: Ints, apart: Floats) -> Floats:
        """Return 2 mu |d|_e |d'|_e, (b,): d is `apart` (k, 2) at the new nodes `at` (k,), and zero at other nodes."""
        fine, d = self.fine, np.zeros((len(self.fine.owner), 2))
        np.add.at(d, at, apart)
        first = np.diff(fine.owner, prepend=-1) > 0
        last = np.roll(first, -1)
        rise = np.sum((d - np.where(first[:, None], 0.0, np.roll(d, 1, axis=0))) ** 2, axis=1)
        rise += last * np.sum(d**2, axis=1)
        squares = self.sums(slice(None), np.sum(d**2, axis=1)) * self.sums(slice(None), rise / fine.lengths**2)
        return 2.0 * self.edges.shear[self.edges.outer] * np.sqrt(squares)

    def compliance_sums(self, values: Floats, unit: Floats) -> Floats:
        """Return the compliances (b,) of edges along unit vectors (b, 2); at interfaces, the sum of both bodies."""
        # If an edge can move only at the angle phi to its unit vector, its compliance has the factor cos^2 phi.
        free = np.einsum("bi,bij,bj->b", unit, self.edges.free, unit)
        found, joints = np.where(free > ROUNDING, free * values, 0.0), self.edges.joints
        found[joints.first] += found[joints.second]
        return found

    def _obstacle_energies(self, obstacle: Obstacle, now: Instant, compliant: bool) -> Floats:
        """Return the energies (b,) due to an obstacle, rigid or compliant, between nodes."""
        edges, soft = self.edges, obstacle.compliance > 0
        stiffness = np.divide(1.0, obstacle.compliance * obstacle.lengths, out=np.zeros(len(soft)), where=soft)
        at, values, line = self.fine.read(obstacle, np.column_stack([obstacle.gap(now.t), stiffness]))
        # For constant gap and stiffness, the nodal pressure is exact.
        bears = compliant and soft.any() and bool(np.any(values != line) or np.ptp(values, axis=0).any())
        if np.array_equal(values[:, 0], line[:, 0]) and not bears:
            return np.zeros(len(edges.outer))
        cosines = np.einsum("bd,bsd->bs", edges.units, edges.jumps(now.u))
        (gap, k), (nodal, _), outward = values.T, line.T, self.fine.between(cosines, at)
        pressure = pressures_at_ends(self.posed, edges, now)
        if soft.any():
            apart = k * np.maximum(outward - gap, 0.0) - self.fine.between(pressure, at)
            weight = self.compliance_sums(self.compliances, edges.units)[self.fine.owner[at]]
            return self.sums(at, apart**2 * weight / (1.0 + k * weight))
        # Either the edge penetrates the obstacle, or both its ends touch the obstacle and hold the edge away from it.
        held = np.all(pressure > 0, axis=1)[self.fine.owner[at]]
        apart = np.maximum(np.minimum(outward, nodal) - gap, np.where(held, gap - nodal, 0.0))
        highest = np.zeros(len(edges.outer))
        np.maximum.at(highest, self.fine.owner[at], np.maximum(apart, 0.0) ** 2)
        compliance = self.compliance_sums(0.5 / edges.shear[edges.outer], edges.units)
        return np.divide(highest, compliance, out=np.zeros_like(highest), where=compliance > 0)

    # The whole body.

    @cached_property
    def _factor(self) -> Factor:
        system = self.posed.system
        # A small multiple of the diagonal restrains rigid motions in the kernel of K; friction and contact are stiffer.
        grounded = system.K if system.kernel is None else system.K + sp.diags_array(np.sqrt(EPS) * system.K.diagonal())
        return system.linear(None).factorise(sp.csr_matrix(grounded), system.near_kernel)

    def body_energies(self, on_edges: Floats, in_cells: Floats) -> Floats:
        """Return parts (n_cells,) of r'K^-1 r, for the forces r on edges (b, 2) and in cells (n_cells, 2)."""
        posed, edges = self.posed, self.edges
        none, P = np.zeros(len(in_cells)), posed.supports.P
        if posed.system.n == 0 or not (on_edges.any() or in_cells.any()):
            return none
        # Each vertex carries an equal part of the force in a cell, as in the load.
        shares = (in_cells / np.bincount(edges.owner)[:, None])[edges.owner]
        nodes = np.append(edges.outer_edges, edges.sides[:, 0])
        cells = np.append(np.repeat(edges.outer, 2), edges.owner)
        forces = np.concatenate([np.repeat(0.5 * on_edges, 2, axis=0), shares])
        r = P.T @ np.stack([totals(nodes, one, posed.space.mesh.n_nodes) for one in forces.T], axis=1).ravel()
        kernel = posed.system.kernel
        modes = np.zeros((len(r), 0)) if kernel is None else np.linalg.qr(kernel.modes)[0]
        y = self._factor.solve(r - modes @ (modes.T @ r))
        work = totals(cells, np.abs(np.einsum("kd,kd->k", forces, (P @ y).reshape(-1, 2)[nodes])), len(none))
        return np.asarray(float(r @ y) * np.divide(work, work.sum(), out=none, where=work > 0))

    # Variation inside cells.

    def varies_inside_cells(self, t: float) -> bool:
        """Return True if moduli, eigenstrains or prestress vary inside cells."""
        unit = np.ones((len(self.edges.mesh.areas), 3))
        apart = (compare_stresses(self.posed, self.parts, self.inside, t, strain)[0] for strain in (0.0 * unit, unit))
        return any(one.any() for one in apart)


def list_parts(posed: PosedScene, space: Space, effects: Sequence[Effect] | None = None) -> list[Contribution]:
    """Return the contributions in a space of all effects, even if their data are zero; materials are already posed."""
    others = [effect for effect in effects or posed.scene.canonical if not isinstance(effect, MaterialLaw)]
    with suppress_scene_warnings():
        return [*(part for _, part in contributions(others, space)), *posed.laws]


def compare_stresses(
    posed: PosedScene, parts: Sequence[Contribution], at: SamplePoints, t: float, strain: Floats
) -> tuple[Floats, Floats]:
    """Return (C - C_K) eps + sigma_0 - sigma_0K (q, k) at points, and C there (q, k, k)."""
    x, owner, material, dim = at.x, at.owner, posed.material, posed.space.dim
    C_K, blocked_K = elastic_matrix(material.moduli, dim), material.thermal_stress_moduli
    C, blocked = C_K[owner], blocked_K[owner]
    for law in (part.material for part in parts if part.material):
        if law.at:
            here = np.ones(len(owner), dtype=bool) if law.cells is None else law.cells[owner]
            moduli, blocked[here] = law.at(x[here], owner[here])
            C[here] = elastic_matrix(moduli, dim)
    apart = np.einsum("qij,qj->qi", C - C_K[owner], strain[owner])
    for part in parts:
        for swelling in part.eigenstrains:
            if swelling.at:
                rest = blocked * swelling.at(x, owner, t)[:, None]
                apart += blocked_K[owner] * swelling.value(t)[owner, None] - rest
        for stress in part.initial_stresses:
            apart += 0.0 if stress.at is None else stress.at(x, owner, t) - stress.value(t)[owner]
    return apart, C
