"""Data oscillation: the parts of loads, bounds, gaps and supports that nodes do not represent."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.fft import dst

from vemcvx.arrays import Bools, Floats, Ints, totals
from vemcvx.effects import GivenDatum, Load
from vemcvx.estimate.budget.skeleton import Instant, Skeleton, at_ends, pressures_at_ends
from vemcvx.estimate.measures.overlap import convex_pieces
from vemcvx.linear import Factor
from vemcvx.meshes import plane_mesh
from vemcvx.meshes.polygons.geometry import fans, places
from vemcvx.meshes.polygons.topology import positions
from vemcvx.scene.pose import PosedScene
from vemcvx.vem import Space, elastic_matrix

# Points at which an estimate looks at data: closer together than nodes and quadrature points, by a declared number.
#
# On the boundary 1/512 of the size of the body apart and at least four an edge, inside 1/128 and at least four a
# triangle. What is narrower than that, and between these points, is not seen.


@dataclass(frozen=True)
class SamplePoints:
    """Points (q, 2) with the weights (q,) of a midpoint rule: lengths, or areas."""

    x: Floats
    weights: Floats
    owner: Ints
    """(q,) the boundary edge of the skeleton, or the cell"""
    along: Floats
    """(q,) in (0, 1), from the first end of the edge to the second; empty inside"""


def on_edges(edges: Skeleton, points: Floats, chosen: Ints) -> SamplePoints:
    """SamplePoints on boundary edges that are given by their nodes (m, 2)."""
    which = positions(chosen, edges.outer_edges, len(points))
    length = edges.lengths[which]
    size = np.ptp(points, axis=0).max()
    counts = np.maximum(np.ceil(length * 512 / size).astype(np.int64), 4)
    row = np.repeat(np.arange(len(which)), counts)
    place = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    along = (place + 0.5) / counts[row]
    start, stop = (points[edges.outer_edges[which, side]][row] for side in range(2))
    return SamplePoints(start + along[:, None] * (stop - start), (length / counts)[row], which[row], along)


def in_cells(space: Space) -> SamplePoints:
    """SamplePoints in all cells: centroids of the triangles into which those of a cell are cut, in halves."""
    pieces = convex_pieces(space)
    triangles, areas, owner = fans(pieces.corners, pieces.owner)
    spacing = np.ptp(space.mesh.points, axis=0).max() / 128
    halved = np.maximum(np.ceil(0.5 * np.log2(2.0 * areas / spacing**2)), 1).astype(np.int64)
    parts = []
    for times in np.unique(halved):
        these = np.flatnonzero(halved == times)
        x = places(triangles[these], _centroids(int(times)))
        count = x.shape[1]
        parts.append((x.reshape(-1, 2), np.repeat(areas[these] / count, count), np.repeat(owner[these], count)))
    x, weights, cells = (np.concatenate(part) for part in zip(*parts, strict=True))
    return SamplePoints(x, weights, cells, np.zeros(0))


def _centroids(times: int) -> Floats:
    """Barycentric coordinates (4^times, 3) of the centroids of a triangle that was cut in four so many times."""
    corners = np.eye(3)[None]
    for _ in range(times):
        middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
        tips = [np.stack([corners[:, k], middles[:, k], middles[:, k - 1]], axis=1) for k in range(3)]
        corners = np.concatenate([*tips, middles])
    centroids: Floats = corners.mean(axis=1)
    return centroids


# Forces that the assembled problem lacks in all, and what they move.
#
# Two answers whose loads differ by r are no farther apart than |r| = sup r(v) / |v|, also with friction and contact:
# in the discrete space that is (r'K^-1 r)^{1/2}, one solve. Waves of a traction as long as an edge, a strip of weight
# between quadrature points, a bound that is read at its crests: they are all one sign, and move the whole body, so
# that no weight that vanishes with the edge can stand for them. With those alone estimates of a bound with 16 waves
# on 16 edges were .44 of the error, and of waves of traction .37.


@dataclass(frozen=True)
class WholeBody:
    """A posed scene's stiffness, ready to be solved with."""

    posed: PosedScene

    @cached_property
    def _factor(self) -> Factor:
        system = self.posed.system
        # Where K does not feel rigid motions a small part of its diagonal holds them; friction and contact do more.
        grounded = system.K if system.kernel is None else system.K + sp.diags_array(1e-8 * system.K.diagonal())
        return system.linear(None).factorise(sp.csr_matrix(grounded), system.near_kernel)

    @cached_property
    def _modes(self) -> Floats:
        kernel = self.posed.system.kernel
        return np.zeros((self.posed.system.n, 0)) if kernel is None else np.linalg.qr(kernel.modes)[0]

    def moved(self, forces: Floats) -> Floats:
        """(n_nodes, 2) how far nodal forces (n_nodes, 2) move the body."""
        P = self.posed.supports.P
        force = P.T @ forces.ravel()
        displacement: Floats = P @ self._factor.solve(force - self._modes @ (self._modes.T @ force))
        return displacement.reshape(-1, 2)


@dataclass(frozen=True)
class LackingForces:
    """Forces on edges and in cells that a posed scene lacks at an instant, added up."""

    whole: WholeBody
    edges: Skeleton
    largest: float
    """of the nodal forces that act"""
    parts: list[tuple[Ints, Ints, Floats]] = field(default_factory=list)
    """nodes and cells (k,), and forces (k, 2) of these cells on these nodes"""

    def on_edges(self, force: Floats) -> None:
        """Add forces (b, 2) on boundary edges."""
        halves = np.repeat(0.5 * force, 2, axis=0)
        self.parts.append((self.edges.outer_edges.ravel(), np.repeat(self.edges.outer, 2), halves))

    def in_cells(self, force: Floats) -> None:
        """Add forces (n_cells, 2) in cells, which their vertices share alike, as in the load."""
        owner = self.edges.owner
        shares = (force / np.bincount(owner)[:, None])[owner]
        self.parts.append((self.edges.sides[:, 0], owner, shares))

    def squares(self) -> Floats:
        """r'K^-1 r, (n_cells,): to each cell in proportion to the work of the forces on it."""
        none, posed = np.zeros(len(self.edges.shear)), self.whole.posed
        if not self.parts or posed.system.n == 0:
            return none
        nodes, cells, forces = (np.concatenate(one) for one in zip(*self.parts, strict=True))
        nodal = np.stack([totals(nodes, one, posed.space.mesh.n_nodes) for one in forces.T], axis=1)
        # Nodal forces below 1e-12 of the largest one that acts are none.
        if np.abs(nodal).max() <= 1e-12 * self.largest:
            return none
        moved = self.whole.moved(nodal)
        work = totals(cells, np.abs(np.sum(forces * moved[nodes], axis=1)), len(none))
        squares: Floats = float(np.sum(nodal * moved)) * np.divide(work, work.sum(), out=none, where=work > 0)
        return squares


# What the assembled problem does not see of the data: what they are at finer places, less what was assembled.
#
# A datum that is not what was assembled does work r(v) on test functions that the residual of the answer does not
# know:
#
#     tractions       int (t - t_e) . v                    square  l_e / (2 mu) |t - t_e|^2_e
#     body forces     int (f - f_K) . v                            h_K^2 / (9 mu) |f - f_K|^2_K
#     bounds          int (g - g_h) |v_tau|                        l_e / (2 mu) |g - g_h|^2_e, or |t_h| - g in stick
#     springs         int (k d - p_h) v_n                          |k d - p_h|^2_e / (2 mu / l_e + k)
#     gaps            u is to move by d where it does not          2 mu max |d|^2
#     motions         the same                                     mu pi sum k |d_k|^2, d = sum d_k sin(k pi s / l_e)
#     moduli, heat    int (C - C_K) eps(u) + sigma_0 - sigma_0K : eps(v)        |.|^2_K in C^-1
#
# with t_e the mean of t, f_K that which was assembled, g_h linear between nodal values plus the mean of g - g_h, and
# l_e the length of e. These are energies, without the constant of the residuals (:mod:`.residual`): the first two by
# the Poincare inequalities of a cell and, with a half space below, of an edge, (3 - 4 nu) / pi <= .96 in parts of l_e
# / (2 mu); that of motions what a half space stores under waves along its surface, at most 2 mu times the wave
# number. The last is the work itself, in its dual norm: with it the divergence of thermal stresses inside cells is
# accounted for. Bounds count where friction is at its bound, or something has slipped before; elsewhere only where
# they are less than what holds there.
#
# All that is local. What the means of tractions, body forces and bounds lack is a force on the whole body:
# :mod:`.lacking_forces`.


POINCARE = 1.0 / 9.0
"""1 / pi^2 on a convex cell of the longer side one, and a tenth for turning, which no strain resists: sideways waves of
weight on 8 x 8 and 16 x 16 squares were .9964 of the error with 1 / pi^2."""


@dataclass(frozen=True)
class DataOscillation:
    """Data of a posed scene, and the places where they are looked at."""

    posed: PosedScene
    edges: Skeleton
    on: tuple[tuple[GivenDatum, SamplePoints], ...] = field(init=False)

    def __post_init__(self) -> None:
        points, given = self.posed.space.mesh.points, self.posed.given
        on = tuple((one, on_edges(self.edges, points, one.edges)) for one in given if one.edges is not None)
        object.__setattr__(self, "on", on)

    @cached_property
    def inside(self) -> SamplePoints:
        """SamplePoints in the cells."""
        return in_cells(self.posed.space)

    @cached_property
    def whole(self) -> WholeBody:
        """The body that forces move."""
        return WholeBody(self.posed)

    @cached_property
    def _compliances(self) -> Floats:
        """(b,) l_e / (2 mu) of boundary edges."""
        compliances: Floats = self.edges.lengths / (2.0 * self.edges.shear[self.edges.outer])
        return compliances

    def squares(self, now: Instant, strain: Floats) -> Floats:
        """Squares (n_cells,) of the energies that are missed."""
        n, edges = len(self.edges.shear), self.edges
        acting = np.append(np.abs(self.posed.force(now.t)), now.weights).max()
        missed, lacking = np.zeros(n), LackingForces(self.whole, edges, float(acting))
        for given, sampled in self.on:
            if given.load is not None and given.load.edges is not None:
                apart = self._traction(given.load, given.load.edges, sampled, now.t)
                squares = np.sum([self._scatter(sampled, one) for one in apart.T], axis=0)
                missed += totals(edges.outer, self._compliances * squares, n)
                lacking.on_edges(self._vectors(sampled, apart))
            elif given.kind == "bound":
                apart = self._bound(given, sampled, now)
                tangents = edges.units[:, ::-1] * [-1.0, 1.0]
                squares = self._of_jumps(self._compliances, tangents) * self._scatter(sampled, apart)
                missed += totals(edges.outer, squares, n)
                force = self._sum(sampled, apart)[:, None] * self._along_slip(now)
                lacking.on_edges(force + edges.joints.reaction(force))
            else:
                missed += totals(edges.outer, ON_EDGES[given.kind](self, given, sampled, now), n)
        for given in self.posed.given:
            if given.load is not None and given.load.cells is not None:
                apart = self._body(given.load, given.load.cells, now.t)
                squares = totals(self.inside.owner, self.inside.weights * np.sum(apart**2, axis=1), n)
                missed += POINCARE * edges.sizes**2 / edges.shear * squares
                lacking.in_cells(self._in_cells(apart))
        if any(given.kind in ("moduli", "eigenstrain", "stress") for given in self.posed.given):
            missed += self._stress(now.t, strain)
        return missed + lacking.squares()

    def _in_cells(self, values: Floats) -> Floats:
        """(n_cells, 2) integrals of values (q, 2) at the places inside."""
        weighed = self.inside.weights[:, None] * values
        return np.stack([totals(self.inside.owner, one, len(self.edges.shear)) for one in weighed.T], axis=1)

    def _vectors(self, places: SamplePoints, values: Floats) -> Floats:
        """(b, 2) integrals over edges of tractions (q, 2), or of pressures (q, 1) along the inward normals."""
        sums: Floats = np.stack([self._sum(places, one) for one in values.T], axis=1)
        return sums if sums.shape == self.edges.units.shape else -sums * self.edges.units

    def _along_slip(self, now: Instant) -> Floats:
        """(b, 2) unit vectors along which friction acts; where there is none, along the way that the edges went."""
        terms, edges = self.posed.terms, self.edges
        force = np.einsum("mb,mbd->md", now.lam, terms.tangents) / terms.lengths[:, None]
        acting, jump = (np.sum(one, axis=1) for one in (at_ends(edges, terms, force), self._jumps(now)))
        jump -= np.einsum("bd,bd->b", jump, edges.units)[:, None] * edges.units
        way = np.where(np.any(acting != 0.0, axis=1)[:, None], acting, jump)
        size = np.linalg.norm(way, axis=1, keepdims=True)
        unit: Floats = np.divide(way, size, out=np.zeros_like(way), where=size > 0)
        return unit

    def _jumps(self, now: Instant) -> Floats:
        """(b, 2, 2) u at both ends of boundary edges, less that of another body where there is one."""
        across = self.edges.joints.across
        jumps: Floats = now.u[self.edges.outer_edges] - np.where(across[:, :, None] >= 0, now.u[across], 0.0)
        return jumps

    def _scatter(self, places: SamplePoints, values: Floats) -> Floats:
        """(b,) integrals over edges of the squares of values (q,), less those of their means."""
        return self._sum(places, values**2) - self._sum(places, values) ** 2 / self.edges.lengths

    def _sum(self, places: SamplePoints, values: Floats) -> Floats:
        return totals(places.owner, places.weights * values, len(self.edges.outer))

    def _body(self, load: Load, cells: Ints, t: float) -> Floats:
        """f - f_K (q, 2) at the places inside."""
        areas = plane_mesh(self.posed.space.mesh, "error_budget").areas
        f = load.at(self.inside.x, t)
        mean = np.zeros((len(areas), f.shape[1]))
        np.add.at(mean, cells, load.forces(t))
        apart: Floats = f - (mean / areas[:, None])[self.inside.owner]
        return apart

    def _stress(self, t: float, strain: Floats) -> Floats:
        """|(C - C_K) eps + sigma_0 - sigma_0K|^2_K in C^-1."""
        places, material, mesh = self.inside, self.posed.material, self.posed.space.mesh
        owner = places.owner
        C_K, blocked_K = elastic_matrix(material.moduli)[owner], material.thermal_stress_moduli[owner]
        C, blocked, apart = C_K.copy(), blocked_K.copy(), np.zeros((len(owner), 3))
        cells = np.arange(mesh.n_cells)
        for given in self.posed.given:
            if given.kind == "moduli":
                here = slice(None) if given.cells is None else given.cells[owner]
                moduli, blocked[here] = given.value(places.x[here], owner[here])
                C[here] = elastic_matrix(moduli)
        for given in self.posed.given:
            if given.kind == "eigenstrain":
                middle = given.value(mesh.centroids, cells, t)[owner]
                apart += blocked_K * middle[:, None] - blocked * given.value(places.x, owner, t)[:, None]
            if given.kind == "stress":
                apart += given.value(places.x, t) - given.value(mesh.centroids, t)[owner]
        apart += np.einsum("qij,qj->qi", C - C_K, strain[owner])
        squares = np.einsum("qi,qi->q", apart, np.linalg.solve(C, apart[:, :, None])[:, :, 0])
        return totals(owner, places.weights * squares, mesh.n_cells)

    def _traction(self, load: Load, edges: Ints, places: SamplePoints, t: float) -> Floats:
        """t - t_e (q, 2), or (q, 1) of a pressure."""
        value = load.at(places.x, t).reshape(len(places.x), -1)
        point = np.unique(edges, axis=0, return_inverse=True)[1].ravel()
        assembled = load.at(load.points, t).reshape(len(point), -1)
        count = np.bincount(point)
        mean = np.stack([totals(point, one, len(count)) for one in assembled.T], axis=1) / count[:, None]
        edge = np.cumsum(np.append(0, places.owner[1:] != places.owner[:-1]))
        apart: Floats = value - mean[edge]
        return apart

    def _bound(self, given: GivenDatum, places: SamplePoints, now: Instant) -> Floats:
        """g - g_h (q,), of two bounds the one that is farther off."""
        lam, bound, slipped = self._friction(now)
        pressure = pressures_at_ends(self.posed, self.edges, now)
        ends = self.posed.space.mesh.points[self.edges.outer_edges]
        along, owner = places.along, places.owner
        read = np.unique(owner)
        nodal = np.zeros((2, len(self.edges.outer), 2))
        for side in range(2):
            g = given.value(ends[read, side], now.t, pressure[read, side])
            nodal[:, read, side] = g
        g = given.value(places.x, now.t, _between(pressure, owner, along))
        assembled = np.stack([_between(one, owner, along) for one in nodal])[: len(g)]
        # Friction counts as being at its bound from .99 of it on.
        active = np.any(slipped | (lam >= 0.99 * bound), axis=1)[owner]
        off = g - assembled
        differs = np.take_along_axis(off, np.abs(off).argmax(axis=0)[None], axis=0)[0]
        exceeds = np.maximum(_between(lam, owner, along) - g.min(axis=0), 0.0)
        apart: Floats = np.where(active, differs, -np.minimum(exceeds, np.abs(differs)))
        return apart

    def _friction(self, now: Instant) -> tuple[Floats, Floats, Bools]:
        """Size of friction and its bound, force per length, and whether it has slipped, at the ends of edges (b, 2)."""
        terms = self.posed.terms
        if len(terms.nodes) == 0:
            none = np.zeros((len(self.edges.outer), 2))
            return none, none, np.zeros(none.shape, dtype=bool)
        size = np.linalg.norm(now.lam, axis=1)
        values = np.column_stack([size, now.weights, (now.worn > 0) * terms.lengths]) / terms.lengths[:, None]
        size, bound, worn = np.moveaxis(at_ends(self.edges, terms, values), 2, 0)
        return size, bound, worn > 0

    def _of_jumps(self, values: Floats, unit: Floats) -> Floats:
        """Values (b,) of the edges free along the units (b, 2); what reads jumps may move either of two bodies."""
        free = np.einsum("bi,bij,bj->b", unit, self.edges.free, unit) > 0.5
        found, joints = np.where(free, values, 0.0), self.edges.joints
        found[joints.first] += found[joints.second]
        return found

    def _outward(self, places: SamplePoints, now: Instant) -> Floats:
        """u . n at the places, of the jump to another body where there is one."""
        return _between(np.einsum("bsd,bd->bs", self._jumps(now), self.edges.units), places.owner, places.along)

    def _gap(self, given: GivenDatum, places: SamplePoints, now: Instant) -> Floats:
        points, nodes, owner = self.posed.space.mesh.points, self.edges.outer_edges, places.owner
        read = np.unique(owner)
        nodal = np.zeros((len(nodes), 2))
        for side in range(2):
            nodal[read, side] = given.value(points[nodes[read, side]], now.t)
        gap, assembled = given.value(places.x, now.t), _between(nodal, owner, places.along)
        pressed = np.all(pressures_at_ends(self.posed, self.edges, now) > 0, axis=1)[owner]
        # Beyond the obstacle, or held away from it by both ends.
        beyond, away = np.minimum(self._outward(places, now), assembled) - gap, np.where(pressed, gap - assembled, 0.0)
        apart = np.maximum(np.maximum(beyond, away), 0.0)
        compliance = self._of_jumps(0.5 / self.edges.shear[self.edges.outer], self.edges.units)
        stiffness = np.divide(1.0, compliance, out=np.zeros_like(compliance), where=compliance > 0)
        return self._highest(places, apart) * stiffness

    def _highest(self, places: SamplePoints, apart: Floats) -> Floats:
        """(b,) the largest square on each edge."""
        highest = np.zeros(len(self.edges.outer))
        np.maximum.at(highest, places.owner, apart**2)
        return highest

    def _spring(self, given: GivenDatum, places: SamplePoints, now: Instant) -> Floats:
        owner = places.owner
        pressure, k = given.value(places.x, now.t, self._outward(places, now))
        apart = pressure - _between(pressures_at_ends(self.posed, self.edges, now), owner, places.along)
        weight = self._of_jumps(self._compliances, self.edges.units)[owner]
        return self._sum(places, apart**2 * weight / (1.0 + k * weight))

    def _foundation(self, given: GivenDatum, places: SamplePoints, now: Instant) -> Floats:
        owner, nodes = places.owner, self.edges.outer_edges
        k = given.value(places.x)
        count = np.bincount(owner, minlength=len(self.edges.outer))
        mean = np.stack([totals(owner, one, len(count)) for one in k]) / np.maximum(count, 1)
        frame = np.stack([self.edges.units, self.edges.units[:, ::-1] * [-1.0, 1.0]])
        moved = np.einsum("bsd,kbd->kbs", now.u[nodes], frame)
        moved = np.stack([_between(one, owner, places.along) for one in moved])
        apart = (k - mean[:, owner]) * moved
        return self._sum(places, np.sum(apart**2 / (1.0 / self._compliances[owner] + k), axis=0))

    def _displacement(self, given: GivenDatum, places: SamplePoints, now: Instant) -> Floats:
        points, nodes, owner = self.posed.space.mesh.points, self.edges.outer_edges, places.owner
        value = given.value(places.x, now.t).reshape(len(owner), -1)
        start, stop = (given.value(points[nodes[owner, side]], now.t).reshape(value.shape) for side in range(2))
        apart = value - start - places.along[:, None] * (stop - start)
        return 2.0 * self.edges.shear[self.edges.outer] * self._waves(places, apart)

    def _waves(self, places: SamplePoints, apart: Floats) -> Floats:
        """(b,) sum_k k pi / 2 |d_k|^2 of the sine series on each edge of displacements (q, j) at its places."""
        found, first = np.zeros(len(self.edges.outer)), np.flatnonzero(np.diff(places.owner, prepend=-1))
        counts = np.diff(np.append(first, len(places.owner)))
        for n in np.unique(counts):
            rows = first[counts == n]
            series = dst(apart[rows[:, None] + np.arange(n)], axis=1) / n
            series[:, -1] *= 0.5
            found[places.owner[rows]] = 0.5 * np.pi * np.einsum("k,ekj->e", np.arange(1.0, n + 1.0), series**2)
        return found


ON_EDGES = {
    "gap": DataOscillation._gap,
    "spring": DataOscillation._spring,
    "foundation": DataOscillation._foundation,
    "displacement": DataOscillation._displacement,
}


def _between(values: Floats, owner: Ints, along: Floats) -> Floats:
    """Linear between the values (b, 2) at the ends of edges."""
    line: Floats = (1.0 - along) * values[owner, 0] + along * values[owner, 1]
    return line
