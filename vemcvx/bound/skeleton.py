"""The skeleton of a mesh: its edges with their cells, and the forces that act on those of the boundary.

Forces on the surface are loads, friction, pressure of contact and springs. What contact exerts on an edge of the first
body it exerts on the second one's edge in the same place the other way. Where normals are held together, no multiplier
is at hand; the normal force that balances the stresses on both sides best, in the weights w = d_e / (2 mu) of the
residuals, is as good as any:

    min over T of  w_1 |T - s_1|^2 + w_2 |T - s_2|^2  =  w_1 w_2 / (w_1 + w_2) |s_1 - s_2|^2,

which is what a jump across an edge inside one body counts, d_e / (4 mu), where both sides are alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vemcvx.base.arrays import Bools, Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.history import History
from vemcvx.meshes import PolygonMesh, plane_mesh
from vemcvx.meshes.polygons import cell_of_corner, directed_edges, positions, right_of
from vemcvx.scene import ContactRows, InitialStresses, PosedScene, jump_rows
from vemcvx.vem import elastic_matrix, mean_shear


@dataclass(frozen=True)
class Joints:
    """Pairs of boundary edges, in space faces, in one place."""

    across: Ints
    """(b, 2) the partners of the nodes of each boundary edge; -1 where it is no first body's at an interface; in space
    there are none"""
    first: Ints
    """(k,) boundary edges, or faces, of first bodies"""
    second: Ints
    """(k,) those of second ones in the same places"""
    bonded: Bools
    """(k,) whether normals are held together"""

    def reaction(self, force: Floats) -> Floats:
        """The reaction on second bodies of contact that exerts forces (b, dim) on first ones."""
        back = np.zeros_like(force)
        back[self.second] = -force[self.first]
        return back

    def normal_forces(self, traction: Floats, weights: Floats, units: Floats) -> Floats:
        """(b, dim) what bilateral contact exerts on both bodies, by the tractions (b, dim) of stresses on all edges."""
        one, other = self.first[self.bonded], self.second[self.bonded]
        n, w, v = units[one], weights[one], weights[other]
        size = np.einsum("kd,kd->k", (w[:, None] * traction[one] - v[:, None] * traction[other]), n) / (w + v)
        force = np.zeros_like(traction)
        force[one] = size[:, None] * n
        force[other] = -force[one]
        return force


def joints(posed: PosedScene, edges: Ints, units: Floats) -> Joints:
    """The joints among boundary edges (b, 2) with outward normals (b, 2)."""
    mesh, across = posed.space.mesh, np.full(edges.shape, -1)
    none = np.empty((0, 2), dtype=np.int64)
    found = list(mesh.interfaces.values())
    ends, partners = (
        np.concatenate([none, *side]) for side in ([one.edges for one in found], [one.partners for one in found])
    )
    first, second = (positions(side, edges, mesh.n_nodes) for side in (ends, partners))
    across[first] = partners
    normals = np.repeat(units[first], 2, axis=0)[:, None]
    normal = jump_rows(ends.ravel(), partners.ravel(), normals, mesh.points)
    held = np.diff(posed.supports.on_free(normal).indptr) == 0
    return Joints(across, first, second, held.reshape(-1, 2).all(axis=1))


@dataclass(frozen=True, kw_only=True)
class Skeleton:
    """Edges inside and on the boundary."""

    mesh: PolygonMesh
    sides: Ints
    """(c, 2) the edges of every cell, counter-clockwise"""
    owner: Ints
    """(c,) the cell of each"""
    shear: Floats
    """(n_cells,) mu; half the harmonic mean of the two moduli of shear, at most twice the softer, where they differ"""
    outer: Ints
    """(b,) the cell of each boundary edge"""
    outer_corners: Ints
    """(b,) the corner of that cell at which it begins"""
    outer_edges: Ints
    """(b, 2) its nodes, counter-clockwise"""
    outer_normals: Floats
    """(b, 2) outward, as long as the edge"""
    free: Floats
    """(b, 2, 2) projector on the directions that supports leave free at one end at least"""
    joints: Joints
    """where two bodies meet"""

    @cached_property
    def sizes(self) -> Floats:
        """(n_cells,) h_K."""
        return extents(self.owner, self.mesh.points[self.sides] - self.mesh.centroids[self.owner, None])

    @property
    def areas(self) -> Floats:
        """(n_cells,)."""
        return self.mesh.areas

    @cached_property
    def lengths(self) -> Floats:
        """(b,) of boundary edges."""
        lengths: Floats = np.linalg.norm(self.outer_normals, axis=1)
        return lengths

    @cached_property
    def units(self) -> Floats:
        """(b, 2) outward unit normals of boundary edges."""
        return self.outer_normals / self.lengths[:, None]

    @cached_property
    def tangents(self) -> Floats:
        """(b, 2) unit tangents of boundary edges, the body on the left."""
        return self.units[:, ::-1] * [-1.0, 1.0]

    def jumps(self, u: Floats) -> Floats:
        """(b, 2, 2) u (n_nodes, 2) at both ends of boundary edges, less that of another body where there is one."""
        across = self.joints.across
        jumps: Floats = u[self.outer_edges] - np.where(across[:, :, None] >= 0, u[across], 0.0)
        return jumps


def extents(owner: Ints, arms: Floats) -> Floats:
    """h_K, the longest side of the box with a cell's moments M = 12 / |K| int (x - c)(x - c)' dx.

    `arms` (k, dim, dim) lead from the centroids c of cells (k,) to the corners of simplices that make them up. Over a
    simplex T of c and the corners c + a_i, int x x' = |T| (sum a_i a_i' + (sum a_i)(sum a_i)') / ((dim + 1)(dim + 2)).
    """
    dim, count = arms.shape[2], int(owner.max()) + 1
    volumes = np.linalg.det(arms)
    tips = np.concatenate([arms, arms.sum(axis=1, keepdims=True)], axis=1)
    moments = np.zeros((count, dim, dim))
    np.add.at(moments, owner, volumes[:, None, None] * np.einsum("kai,kaj->kij", tips, tips))
    moments *= 12.0 / ((dim + 1) * (dim + 2) * totals(owner, volumes, count)[:, None, None])
    return np.sqrt(np.linalg.eigvalsh(moments)[:, -1])


def skeleton(posed: PosedScene) -> Skeleton:
    """The edges of a posed scene's mesh."""
    mesh = plane_mesh(posed.space.mesh, "error_budget")
    shared = mesh.shared_edges
    edges = directed_edges(mesh.offsets, mesh.vertices)
    owner, outer = cell_of_corner(mesh.offsets), shared.corners[shared.first][shared.counts == 1]
    normals = right_of(np.diff(mesh.points[edges[outer]], axis=1)[:, 0])
    return Skeleton(
        mesh=mesh,
        sides=edges,
        owner=owner,
        shear=0.5 * mean_shear(elastic_matrix(posed.material.moduli)),
        outer=owner[outer],
        outer_corners=outer,
        outer_edges=edges[outer],
        outer_normals=normals,
        free=posed.supports.free_directions(edges[outer].ravel(), np.repeat(np.arange(len(outer)), 2)),
        joints=joints(posed, edges[outer], normals),
    )


@dataclass(frozen=True)
class Instant:
    """The state at an instant."""

    t: float
    u: Floats
    """(n_nodes, 2)"""
    lam: Floats
    """(m, block) multipliers of norm terms"""
    p: Floats
    """(r,) multipliers of limits"""
    weights: Floats
    """(m,) bounds of norm terms"""
    worn: Floats
    """(m,) their work since the initial instant"""


def instant(history: History, row: int) -> Instant:
    """The state of a row of a history's arrays."""
    run = history.trajectory
    parts = run.multipliers[row], run.pressures[row], run.weights[row], run.worn[row]
    return Instant(float(history.times[row]), history.displacement[row], *parts)


def pressures_at_ends(posed: PosedScene, edges: Skeleton, now: Instant) -> Floats:
    """Pressure of obstacles (b, 2) at the two ends of each boundary edge, force per length."""
    return at_ends(edges, posed.obstacles, (now.p / posed.obstacles.lengths)[:, None])[..., 0]


def edge_loads(posed: PosedScene, edges: Skeleton, t: float) -> Floats:
    """Loads (b, 2) on the boundary edges."""
    total = np.zeros((len(edges.outer), 2))
    for load in posed.loads:
        if not isinstance(load, InitialStresses) and load.edges is not None:
            np.add.at(total, positions(load.edges, edges.outer_edges, posed.space.mesh.n_nodes), load.forces(t))
    return total


def body_forces(posed: PosedScene, t: float) -> Floats:
    """Loads (n_cells, dim) in the cells."""
    total = np.zeros((posed.space.mesh.n_cells, posed.space.dim))
    for load in posed.loads:
        if not isinstance(load, InitialStresses) and load.cells is not None:
            np.add.at(total, load.cells, load.forces(t))
    return total


def at_ends(edges: Skeleton, rows: ContactRows, values: Floats) -> Floats:
    """(b, 2, k) values (m, k) of rows at the two ends of each edge that they own; zero where there is none.

    Where supports hold an end of an interface they bear what acts there, whatever it is: it is taken to be as at the
    other end.
    """
    row, end = rows.ends.nonzero()
    found, known = np.zeros((len(edges.outer), 2, values.shape[1])), edges.joints.across < 0
    edge = positions(rows.names[end], edges.outer_edges, int(edges.outer_edges.max()) + 1)
    side = (rows.names[end, 0] != edges.outer_edges[edge, 0]).astype(int)
    np.add.at(found, (edge, side), values[row])
    known[edge, side] = True
    for side_ in range(2):
        bare = known[:, 1 - side_] & ~known[:, side_]
        found[bare, side_] = found[bare, 1 - side_]
    return found


def check_estimable(posed: PosedScene, subject: str) -> None:
    """Raise SceneError where there is no estimate."""
    if posed.system.damping is not None:
        raise SceneError(
            f"{subject}: there is no estimate for scenes with Viscosity; compare meshes and steps of your own choice."
        )
    if posed.supports.amplitudes:
        loose = ", ".join(support.subject for support in posed.supports.given if support.patterns is not None)
        raise SceneError(
            f"{subject}: there is no estimate beside {loose}, whose motion is unknown: what holds its nodes is no "
            "traction; compare meshes and steps of your own choice."
        )
    for friction in posed.terms.frictions:
        law = friction.law
        if (law is not None and law.slips) or friction.directions is not None:
            raise SceneError(
                f"{subject}: there is no estimate for {friction.subject}: its weights depend on slip, or act along "
                "given directions; compare meshes and steps of your own choice."
            )
    frictions = tuple(friction.subject for friction in posed.terms.frictions)
    for subjects, rows in ((frictions, posed.terms), (posed.obstacles.subjects, posed.obstacles)):
        if (rows.names[rows.ends.indices, 1] < 0).any():
            raise SceneError(
                f"{subject}: there is no estimate for {', '.join(subjects)}, which does not say on which edges it "
                "acts: effects of one's own say it by ends= of their Friction, Obstacle or ContactSurface."
            )
    for load in posed.loads:
        if not isinstance(load, InitialStresses) and load.cells is None and load.edges is None:
            raise SceneError(
                f"{subject}: there is no estimate for {load.subject}: a force on a point does infinite work on an "
                "elastic body, and no mesh comes near that energy. Spread it over a part of the boundary by Traction."
            )
