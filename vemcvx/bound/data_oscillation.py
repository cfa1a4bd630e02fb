"""Data oscillation: what loads, bounds, gaps, supports and moduli are between the points that were assembled.

The effects of the scene are asked once more, on the same cells with their boundary edges cut into short pieces: what
they then say at the new nodes, less what is linear between the old ones, was not assembled. A datum that is not what
was assembled does work r(v) on test functions that the residual of the answer does not know:

    tractions       int (t - t_e) . v                    square  l_e / (2 mu) |t - t_e|^2_e
    body forces     int (f - f_K) . v                            h_K^2 / (9 mu) |f - f_K|^2_K
    bounds          int (g - g_h) |v_tau|                        l_e / (2 mu) |g - g_h|^2_e, or |t_h| - g in stick
    springs         int (k d - p_h) v_n                          |k d - p_h|^2_e / (2 mu / l_e + k)
    gaps            u is to move by d where it does not          2 mu max |d|^2
    motions         the same                                     mu pi sum k |d_k|^2, d = sum d_k sin(k pi s / l_e)
    moduli, heat    int (C - C_K) eps(u) + sigma_0 - sigma_0K : eps(v)        |.|^2_K in C^-1

with t_e the mean of t, f_K that which was assembled, g_h linear between nodal values plus the mean of g - g_h, and
l_e the length of e. These are energies, without the constant of the residuals in :mod:`vemcvx.estimate.budget`: the
first two by the Poincare inequalities of a cell and, with a half space below, of an edge, (3 - 4 nu) / pi <= .96 in
parts of l_e / (2 mu); that of motions is what a half space stores under waves along its surface, at most 2 mu times
the wave number. The last is the work itself, in its dual norm: with it the divergence of thermal stresses inside
cells is accounted for. Bounds count where friction is at its bound, or something has slipped before; elsewhere only
where they are less than what holds there.

All that is local. The means of tractions, body forces and bounds are forces r on the whole body. Two answers whose
loads differ by r are no farther apart than sup r(v) / |v|, also with friction and contact: in the discrete space that
is (r'K^-1 r)^{1/2}, one solve. Waves of a traction as long as an edge, a strip of weight between quadrature points, a
bound that is read at its crests are all of one sign and move the whole body, so that no weight that vanishes with the
edge can stand for them: with local weights alone estimates of a bound with 16 waves on 16 edges were .44 of the error,
and of waves of traction .37.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, ROUNDING, Bools, Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.bound.skeleton import Instant, Skeleton, at_ends, body_forces, edge_loads, pressures_at_ends
from vemcvx.effects import Contribution, Effect, Friction, Load, MaterialLaw, Obstacle, Support
from vemcvx.linear import Factor
from vemcvx.meshes import Interface, PolygonMesh, plane_mesh
from vemcvx.meshes.polygons import outlines, places, positions, triangulated
from vemcvx.scene import PosedScene, contributions, unwarned
from vemcvx.vem import Space, elastic_matrix

PIECES, SPACING = 512, 128
"""Parts of the size of the body, on the boundary and inside, that are looked at; what is narrower than these may be
missed. Edges have four pieces at least, and triangles four points."""
POINCARE = 1.0 / 9.0
"""1 / pi^2 on a convex cell of the longer side one, and a tenth for turning, which no strain resists: sideways waves of
weight on 8 x 8 and 16 x 16 squares were .9964 of the error with 1 / pi^2."""


@dataclass(frozen=True)
class FineBoundary:
    """A mesh with its boundary edges cut into pieces; its cells, and data on these, stay as they are."""

    mesh: PolygonMesh
    old: int
    """new nodes are numbered from here on"""
    pieces: Ints
    """(k, 2) the pieces, edge by edge"""
    piece_owner: Ints
    """(k,) the boundary edge of each"""
    owner: Ints
    """(q,) the boundary edge of each new node"""
    along: Floats
    """(q,) in (0, 1), from the first end of the edge to the second"""
    lengths: Floats
    """(q,) of the pieces beside it: weights of the trapezoidal rule for what vanishes at the ends of edges"""

    def between(self, values: Floats, at: Ints | slice = slice(None)) -> Floats:
        """Linear at new nodes between the values (b, 2, ...) at the ends of edges."""
        start, stop = values[self.owner[at], 0], values[self.owner[at], 1]
        s = self.along[at].reshape(-1, *[1] * (start.ndim - 1))
        line: Floats = (1.0 - s) * start + s * stop
        return line

    def tips(self, rows: Friction | Obstacle, values: Floats) -> Floats:
        """(b, 2, j) values (m, j) of rows at both ends of boundary edges; nan on edges without them.

        Effects that do not say which edges a row has are left out.
        """
        found = np.full((int(self.owner.max()) + 1, 2, values.shape[1]), np.nan)
        if rows.ends is not None:
            tips = np.flatnonzero((rows.nodes[rows.ends.row] < self.old) & (rows.ends.beyond >= self.old))
            next_door = rows.ends.beyond[tips] - self.old
            found[self.owner[next_door], (self.along[next_door] > 0.5).astype(int)] = values[rows.ends.row[tips]]
        return found

    def read(self, rows: Friction | Obstacle, values: Floats) -> tuple[Ints, Floats, Floats]:
        """New nodes (k,), the values (m, j) of rows there, and those that are linear between the ends of the edges."""
        new = np.flatnonzero(rows.nodes >= self.old) if rows.ends is not None else np.zeros(0, dtype=np.int64)
        at = rows.nodes[new] - self.old
        return at, *without_rounding(values[new], np.nan_to_num(self.between(self.tips(rows, values), at)))

    def forces(self, rows: Friction, pressure: Floats) -> Floats:
        """Normal forces (m,) on rows of a pressure (b, 2) that is linear along edges."""
        if rows.ends is None:
            return np.zeros(len(rows.nodes))
        node, beyond = rows.nodes[rows.ends.row], rows.ends.beyond
        # One end of every piece at least is new.
        piece = np.maximum(node, beyond) - self.old
        s = np.where(node < self.old, np.round(self.along[piece]), self.along[np.maximum(node - self.old, 0)])
        start, stop = pressure[self.owner[piece]].T
        return totals(rows.ends.row, rows.ends.lengths * ((1.0 - s) * start + s * stop), len(rows.nodes))


def without_rounding(values: Floats, line: Floats) -> tuple[Floats, Floats]:
    """The values, which are those of the line where they differ by rounding, and the line."""
    size = max(np.abs(values).max(initial=0.0), np.abs(line).max(initial=0.0))
    return np.where(np.abs(values - line) <= ROUNDING * size, line, values), line


def fine_boundary(mesh: PolygonMesh, edges: Skeleton) -> FineBoundary:
    """The mesh with the boundary edges of its skeleton cut, alike on both sides of an interface."""
    joints, ends = edges.joints, edges.outer_edges
    counts = np.maximum(np.ceil(edges.lengths * PIECES / np.ptp(mesh.points, axis=0).max()).astype(np.int64), 4)
    counts[joints.second] = counts[joints.first]
    inner, piece_owner = counts - 1, np.repeat(np.arange(len(counts)), counts)
    start, owner = np.cumsum(inner) - inner, np.repeat(np.arange(len(counts)), inner)
    place = np.arange(len(owner)) - start[owner]
    along, new = (place + 1) / counts[owner], mesh.n_nodes + np.arange(len(owner))
    first, last = mesh.points[ends[owner]].swapaxes(0, 1)
    offsets = mesh.offsets + np.append(0, np.cumsum(np.bincount(edges.outer, inner, mesh.n_cells))).astype(np.int64)
    opposite = np.full(len(counts), -1)
    opposite[joints.first] = joints.second
    across = np.where(opposite[owner] < 0, -1, mesh.n_nodes + start[opposite[owner]] + inner[owner] - 1 - place)

    def chained(of_new: Ints, of_ends: Ints) -> Ints:
        """(k, 2) of the pieces of all edges, one after the other."""
        tips = (np.insert(of_new, at, of_ends[:, side]) for side, at in enumerate((start, start + inner)))
        return np.column_stack(list(tips))

    def cut(whole: Ints) -> Bools:
        return np.isin(piece_owner, positions(whole, ends, mesh.n_nodes))

    pieces, partners = chained(new, ends), chained(across, joints.across)
    fine = PolygonMesh.unchecked(
        np.concatenate([mesh.points, first + along[:, None] * (last - first)]),
        offsets,
        np.insert(mesh.vertices, edges.outer_corners[owner] + 1, new),
    )
    sides = {name: of for name, of in mesh.boundaries.items() if name not in (*mesh.interfaces, "boundary")}
    named = {name: pieces[cut(of)] for name, of in sides.items()}
    joined = {
        name: Interface(joint.bodies, pieces[cut(joint.edges)], partners[cut(joint.edges)])
        for name, joint in mesh.interfaces.items()
    }
    fine = fine._replace(_named=named, interfaces=MappingProxyType(joined), cell_data=mesh.cell_data)
    return FineBoundary(
        mesh=fine,
        old=mesh.n_nodes,
        pieces=pieces,
        piece_owner=piece_owner,
        owner=owner,
        along=along,
        lengths=(edges.lengths / counts)[owner],
    )


@dataclass(frozen=True)
class SamplePoints:
    """Points (q, 2) of cells (q,) with the weights (q,) of a midpoint rule."""

    x: Floats
    weights: Floats
    owner: Ints


def in_cells(mesh: PolygonMesh, spacing: float = SPACING) -> SamplePoints:
    """The centroids of equal parts of the triangles that cells are cut into, each cut until its parts are small."""
    corners, areas, owner = triangulated(outlines(mesh.points, mesh.offsets, mesh.vertices))
    size = np.ptp(mesh.points, axis=0).max()
    cuts = np.maximum(np.ceil(np.sqrt(2.0 * areas) * spacing / size).astype(np.int64), 2)
    parts = []
    for m in np.unique(cuts):
        these, (i, j) = np.flatnonzero(cuts == m), np.indices((m, m))
        up, down = i + j < m, i + j < m - 1
        a, b = (np.append(k[up] + 1.0 / 3.0, k[down] + 2.0 / 3.0) / m for k in (i, j))
        x, count = places(corners[these], np.column_stack([a, b, 1.0 - a - b])), m * m
        parts.append((x.reshape(-1, 2), np.repeat(areas[these] / count, count), np.repeat(owner[these], count)))
    return SamplePoints(*(np.concatenate(part) for part in zip(*parts, strict=True)))


@dataclass(frozen=True)
class DataOscillation:
    """Data of a posed scene, and the places where they are looked at."""

    posed: PosedScene
    edges: Skeleton
    effects: Sequence[Effect] | None = None
    """whose data these are; None of the scene's"""

    @cached_property
    def fine(self) -> FineBoundary:
        """The mesh on which effects are asked again."""
        return fine_boundary(plane_mesh(self.posed.space.mesh, "error_budget"), self.edges)

    @cached_property
    def parts(self) -> list[Contribution]:
        """The contributions of all effects on the fine mesh, those that are zero as well; of materials, on the mesh."""
        effects = self.posed.scene.canonical if self.effects is None else self.effects
        others = [effect for effect in effects if not isinstance(effect, MaterialLaw)]
        with unwarned():
            asked = contributions(others, Space(self.fine.mesh))
        return [*(part for _, part in asked), *self.posed.laws]

    @property
    def frictions(self) -> list[Friction]:
        """The frictions of all effects, also of those that are zero."""
        return [friction for part in self.parts for friction in part.frictions]

    @property
    def obstacles(self) -> list[Obstacle]:
        """Likewise the obstacles."""
        return [obstacle for part in self.parts for obstacle in part.obstacles]

    @property
    def supports(self) -> list[Support]:
        """Likewise the supports."""
        return [support for part in self.parts for support in part.supports]

    @cached_property
    def body_loads(self) -> list[Load]:
        """Likewise the body forces."""
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
        """(q, 2, 2) stiffness per length of springs to the ground at new nodes."""
        springs, each = np.zeros((self.fine.mesh.n_nodes, 2, 2)), np.tile(np.eye(2), (self.fine.mesh.n_nodes, 1))
        for part in self.parts:
            if part.material is None and part.stiffness is not None:
                springs += (part.stiffness @ each).reshape(-1, 2, 2)
        found: Floats = springs[self.fine.old :] / self.fine.lengths[:, None, None]
        return found

    @cached_property
    def inside(self) -> SamplePoints:
        """Places in the cells."""
        return in_cells(plane_mesh(self.posed.space.mesh, "error_budget"))

    def squares(self, now: Instant, strain: Floats) -> Floats:
        """Squares (n_cells,) of the energies that are missed."""
        edges, n = self.edges, len(self.edges.shear)
        on_edges, lacking = self._tractions(now.t)
        on_edges += self._springs(now)
        for friction in self.frictions:
            squares, force = self._bound(friction, now)
            on_edges += squares
            lacking += force
            if friction.ground is not None:
                at, moved, line = self.fine.read(friction, friction.ground.vector(now.t))
                on_edges += self.of_motion(at, moved - line)
        on_edges += np.sum([self.of_obstacle(obstacle, now) for obstacle in self.obstacles], axis=0)
        on_edges += np.sum([self._support(support, now) for support in self.supports], axis=0)
        in_cells, force = self._body(now.t)
        local = totals(edges.outer, on_edges, n) + in_cells + self.stress(now.t, strain)
        return local + self.of_the_body(lacking, force)

    # The whole body.

    @cached_property
    def _factor(self) -> Factor:
        system = self.posed.system
        # Where K does not feel rigid motions a small part of its diagonal holds them; friction and contact do more.
        grounded = system.K if system.kernel is None else system.K + sp.diags_array(np.sqrt(EPS) * system.K.diagonal())
        return system.linear(None).factorise(sp.csr_matrix(grounded), system.near_kernel)

    def of_the_body(self, on_edges: Floats, in_cells: Floats) -> Floats:
        """r'K^-1 r of forces on edges (b, 2) and in cells (n_cells, 2), shared out by their work on each cell."""
        posed, edges = self.posed, self.edges
        none, P = np.zeros(len(in_cells)), posed.supports.P
        if posed.system.n == 0 or not (on_edges.any() or in_cells.any()):
            return none
        # Vertices share the force in a cell alike, as in the load.
        shares = (in_cells / np.bincount(edges.owner)[:, None])[edges.owner]
        nodes = np.append(edges.outer_edges, edges.sides[:, 0])
        cells = np.append(np.repeat(edges.outer, 2), edges.owner)
        forces = np.concatenate([np.repeat(0.5 * on_edges, 2, axis=0), shares])
        r = P.T @ np.stack([totals(nodes, one, posed.space.mesh.n_nodes) for one in forces.T], axis=1).ravel()
        kernel = posed.system.kernel
        modes = np.zeros((len(r), 0)) if kernel is None else np.linalg.qr(kernel.modes)[0]
        y = self._factor.solve(r - modes @ (modes.T @ r))
        work = totals(cells, np.abs(np.einsum("kd,kd->k", forces, (P @ y).reshape(-1, 2)[nodes])), len(none))
        squares: Floats = float(r @ y) * np.divide(work, work.sum(), out=none, where=work > 0)
        return squares

    # Edges of the boundary, (b,) each.

    @cached_property
    def compliances(self) -> Floats:
        """l_e / (2 mu)."""
        compliances: Floats = self.edges.lengths / (2.0 * self.edges.shear[self.edges.outer])
        return compliances

    def _sum(self, at: Ints | slice, values: Floats) -> Floats:
        """Integrals of values at new nodes."""
        return totals(self.fine.owner[at], self.fine.lengths[at] * values, len(self.edges.outer))

    def _scatter(self, squares: Floats, mean: Floats) -> Floats:
        """Integrals of squares, less those of the squares of the means."""
        scatter: Floats = np.maximum(squares - mean**2 / self.edges.lengths, 0.0)
        return scatter

    def on_pieces(self, t: float) -> Floats:
        """(k, 2) the mean tractions of loads on pieces."""
        fine, force = self.fine, np.zeros(self.fine.pieces.shape)
        for load in (load for part in self.parts for load in part.loads):
            if load.edges is not None:
                np.add.at(force, positions(load.edges, fine.pieces, fine.mesh.n_nodes), load.forces(t))
        traction: Floats = force / (self.edges.lengths / np.bincount(fine.piece_owner))[fine.piece_owner, None]
        return traction

    def _tractions(self, t: float) -> tuple[Floats, Floats]:
        """The squares that tractions add by differing from their assembled means, and their forces (b, 2)."""
        owner, count = self.fine.piece_owner, len(self.edges.outer)
        length = (self.edges.lengths / np.bincount(owner))[owner]
        mean = edge_loads(self.posed, self.edges, t) / self.edges.lengths[:, None]
        traction, assembled = without_rounding(self.on_pieces(t), mean[owner])
        apart = traction - assembled
        lacking = np.stack([totals(owner, length * one, count) for one in apart.T], axis=1)
        squares = [
            self._scatter(totals(owner, length * one**2, count), sums)
            for one, sums in zip(apart.T, lacking.T, strict=True)
        ]
        return self.compliances * np.sum(squares, axis=0), lacking

    def _bound(self, friction: Friction, now: Instant) -> tuple[Floats, Floats]:
        """The same of a bound of friction."""
        lam, bound, slipped = self._friction(now)
        none = np.zeros(len(friction.nodes))
        forces = self.fine.forces(friction, pressures_at_ends(self.posed, self.edges, now))
        w = friction.weights_under(now.t, forces, none, none)
        at, g, line = self.fine.read(friction, (w / friction.lengths)[:, None])
        differs = (g - line)[:, 0]
        exceeds = np.maximum(self.fine.between(lam, at) - g[:, 0], 0.0)
        # Friction counts as being at its bound from .99 of it on.
        active = np.any(slipped | (lam >= 0.99 * bound), axis=1)[self.fine.owner[at]]
        apart = np.where(active, differs, -np.minimum(exceeds, np.abs(differs)))
        mean = self._sum(at, apart)
        squares = self._of_jumps(self.compliances, self.edges.tangents) * self._scatter(self._sum(at, apart**2), mean)
        force = mean[:, None] * self._along_slip(now)
        return squares, force + self.edges.joints.reaction(force)

    def _friction(self, now: Instant) -> tuple[Floats, Floats, Bools]:
        """Size of friction and its bound, force per length, and whether it has slipped, at the ends of edges (b, 2)."""
        terms = self.posed.terms
        values = np.column_stack([np.linalg.norm(now.lam, axis=1), now.weights, (now.worn > 0) * terms.lengths])
        size, bound, worn = np.moveaxis(at_ends(self.edges, terms, values / terms.lengths[:, None]), 2, 0)
        return size, bound, worn > 0

    def _along_slip(self, now: Instant) -> Floats:
        """(b, 2) unit vectors along which friction acts; where there is none, along the way that the edges went."""
        terms, edges = self.posed.terms, self.edges
        force = np.einsum("mb,mbd->md", now.lam, terms.tangents) / terms.lengths[:, None]
        acting, jump = (np.sum(one, axis=1) for one in (at_ends(edges, terms, force), edges.jumps(now.u)))
        jump -= np.einsum("bd,bd->b", jump, edges.units)[:, None] * edges.units
        way = np.where(np.any(acting != 0.0, axis=1)[:, None], acting, jump)
        size = np.linalg.norm(way, axis=1, keepdims=True)
        unit: Floats = np.divide(way, size, out=np.zeros_like(way), where=size > 0)
        return unit

    def _of_jumps(self, values: Floats, unit: Floats) -> Floats:
        """Compliances of edges along the units (b, 2); what reads jumps may move either of two bodies.

        An edge that supports let move at the angle a to its unit has the part cos^2 a: the cosine of a force acts, and
        the cosine of the way is along the unit.
        """
        free = np.einsum("bi,bij,bj->b", unit, self.edges.free, unit)
        found, joints = np.where(free > ROUNDING, free * values, 0.0), self.edges.joints
        found[joints.first] += found[joints.second]
        return found

    def of_obstacle(self, obstacle: Obstacle, now: Instant) -> Floats:
        """The squares that obstacles add between nodes, rigid or compliant ones."""
        edges, soft = self.edges, obstacle.compliance > 0
        cosines = np.einsum("bd,bsd->bs", edges.units, edges.jumps(now.u))
        stiffness = np.divide(1.0, obstacle.compliance * obstacle.lengths, out=np.zeros(len(soft)), where=soft)
        at, values, line = self.fine.read(obstacle, np.column_stack([obstacle.gap(now.t), stiffness]))
        (gap, k), (nodal, _), outward = values.T, line.T, self.fine.between(cosines, at)
        pressure = pressures_at_ends(self.posed, edges, now)
        if soft.any():
            if not np.ptp(values, axis=0).any() and np.array_equal(values, line):
                return np.zeros(len(edges.outer))
            apart = k * np.maximum(outward - gap, 0.0) - self.fine.between(pressure, at)
            weight = self._of_jumps(self.compliances, edges.units)[self.fine.owner[at]]
            return self._sum(at, apart**2 * weight / (1.0 + k * weight))
        # Beyond the obstacle, or held away from it by both ends.
        held = np.all(pressure > 0, axis=1)[self.fine.owner[at]]
        apart = np.maximum(np.minimum(outward, nodal) - gap, np.where(held, gap - nodal, 0.0))
        highest = np.zeros(len(edges.outer))
        np.maximum.at(highest, self.fine.owner[at], np.maximum(apart, 0.0) ** 2)
        compliance = self._of_jumps(0.5 / edges.shear[edges.outer], edges.units)
        return np.divide(highest, compliance, out=np.zeros_like(highest), where=compliance > 0)

    def _support(self, support: Support, now: Instant) -> Floats:
        """The squares that prescribed displacements add by not being linear between nodes."""
        new = support.nodes >= self.fine.old
        if support.value is None:
            return np.zeros(len(self.edges.outer))
        at, directions = support.nodes[new] - self.fine.old, support.directions[new]
        line = np.einsum("qd,qd->q", directions, self.fine.between(now.u[self.edges.outer_edges], at))
        value, line = without_rounding(support.value(now.t)[new], line)
        return self.of_motion(at, (value - line)[:, None] * directions)

    def of_motion(self, at: Ints, apart: Floats) -> Floats:
        """mu pi sum_k k |d_k|^2 of the sine series of displacements (k, 2) at new nodes, zero at all others."""
        from scipy.fft import dst

        d, found = np.zeros((len(self.fine.owner), 2)), np.zeros(len(self.edges.outer))
        np.add.at(d, at, apart)
        inner = np.bincount(self.fine.owner)
        start = np.cumsum(inner) - inner
        for n in np.unique(inner[np.unique(self.fine.owner[at])]):
            rows = np.flatnonzero(inner == n)
            series = dst(d[start[rows, None] + np.arange(n)], type=1, axis=1) / (n + 1)
            found[rows] = np.pi * np.einsum("k,ekj->e", np.arange(1.0, n + 1.0), series**2)
        return self.edges.shear[self.edges.outer] * found

    def _springs(self, now: Instant) -> Floats:
        """The squares that springs to the ground add by a stiffness that is not the mean of their edge."""
        fine, owner, frame = self.fine, self.fine.owner, np.stack([self.edges.units, self.edges.tangents])
        k = np.einsum("jqa,qab,jqb->jq", frame[:, owner], self.springs, frame[:, owner])
        mean = np.stack([totals(owner, one, len(self.edges.outer)) for one in k]) / np.bincount(owner)
        k, assembled = without_rounding(k, mean[:, owner])
        moved = np.einsum("jqd,qd->jq", frame[:, owner], fine.between(now.u[self.edges.outer_edges]))
        squares = np.sum(((k - assembled) * moved) ** 2 / (1.0 / self.compliances[owner] + k), axis=0)
        return self._sum(slice(None), squares)

    # Cells, (n_cells,) each.

    def _integrals(self, values: Floats) -> Floats:
        return totals(self.inside.owner, self.inside.weights * values, len(self.edges.shear))

    def _body(self, t: float) -> tuple[Floats, Floats]:
        """The squares that body forces add by differing from those assembled, and their forces (n_cells, 2)."""
        edges, n = self.edges, len(self.edges.shear)
        loads = [load for part in self.parts for load in part.loads if load.cells is not None]
        if not any(callable(load.value) for load in loads):
            return np.zeros(n), np.zeros((n, 2))
        assembled = (body_forces(self.posed, t) / edges.areas[:, None])[self.inside.owner]
        f, assembled = without_rounding(np.sum([load.at(self.inside.x, t) for load in loads], axis=0), assembled)
        apart = f - assembled
        lacking = np.stack([self._integrals(one) for one in apart.T], axis=1)
        return POINCARE * edges.sizes**2 / edges.shear * self._integrals(np.sum(apart**2, axis=1)), lacking

    @cached_property
    def inside_cells(self) -> bool:
        """True where moduli, eigenstrains or prestress may vary inside cells."""
        materials = any(part.material.at for part in self.parts if part.material)
        swelling = any(one.at for part in self.parts for one in part.eigenstrains)
        return materials or swelling or any(one.at for part in self.parts for one in part.initial_stresses)

    @cached_property
    def _moduli(self) -> tuple[Floats, Floats, Floats, Floats]:
        """C and C_K (q, 3, 3), and moduli of thermal stress (q,) likewise, at the places in cells."""
        x, owner, material = self.inside.x, self.inside.owner, self.posed.material
        C_K, blocked_K = elastic_matrix(material.moduli)[owner], material.thermal_stress_moduli[owner]
        C, blocked = C_K.copy(), blocked_K.copy()
        for law in (part.material for part in self.parts if part.material):
            if law.at:
                here = np.ones(len(owner), dtype=bool) if law.cells is None else law.cells[owner]
                moduli, blocked[here] = law.at(x[here], owner[here])
                C[here] = elastic_matrix(moduli)
        return C, C_K, blocked, blocked_K

    def varies_inside_cells(self, t: float) -> bool:
        """True where moduli, eigenstrains or prestress do vary inside cells, whatever the strains there are."""
        if not self.inside_cells:
            return False
        C, C_K, *_ = self._moduli
        return bool((C != C_K).any() or self.stress(t, np.zeros((len(self.edges.shear), 3))).any())

    def stress(self, t: float, strain: Floats) -> Floats:
        """|(C - C_K) eps + sigma_0 - sigma_0K|^2_K in C^-1."""
        if not self.inside_cells:
            return np.zeros(len(strain))
        swelling = [(one, one.at) for part in self.parts for one in part.eigenstrains if one.at]
        initial = [(one, one.at) for part in self.parts for one in part.initial_stresses if one.at]
        x, owner, (C, C_K, blocked, blocked_K) = self.inside.x, self.inside.owner, self._moduli
        apart = np.zeros((len(owner), 3))
        for eigenstrain, at_place in swelling:
            apart += blocked_K * eigenstrain.value(t)[owner, None] - blocked * at_place(x, owner, t)[:, None]
        for stress, at_place in initial:
            apart += at_place(x, owner, t) - stress.value(t)[owner]
        apart += np.einsum("qij,qj->qi", C - C_K, strain[owner])
        return self._integrals(np.einsum("qi,qi->q", apart, np.linalg.solve(C, apart[:, :, None])[:, :, 0]))
