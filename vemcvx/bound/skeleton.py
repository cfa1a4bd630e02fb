"""The edges of a mesh, the states of a run, and normal forces between bonded bodies.

Let T be the normal force on two opposite edges of an interface between bodies 1 and 2. If the supports prescribe the
jump of the normal displacement, the run has no multiplier for T. On the edge of body i, let s_i be the normal force of
the computed stress, mu_i the shear modulus, d_i the cell width across the edge, and w_i = d_i / (2 mu_i). T minimises

    w_1 |T - s_1|^2 + w_2 |T - s_2|^2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vemcvx.base.arrays import Bools, Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.history import History
from vemcvx.meshes import PolygonMesh, plane_mesh
from vemcvx.meshes.polygons import cell_of_corner, corner_edges, positions, right_of
from vemcvx.scene import ContactRows, InitialStresses, PosedScene, jump_rows
from vemcvx.vem.elasticity import mean_shear
from vemcvx.vem.tensors import elastic_matrix


@dataclass(frozen=True)
class Joints:
    """The pairs of opposite boundary edges or faces at interfaces."""

    across: Ints  # (b, 2) nodes across the interface for edges in `first`, else -1; empty in space
    first: Ints  # (k,) edge or face on the first body of each pair
    second: Ints  # (k,) opposite edge or face on the second body
    bonded: Bools  # (k,) True where the supports prescribe the normal jump

    def reaction(self, force: Floats) -> Floats:
        """Return the reactions on the edges in `second` to forces on the edges in `first`."""
        back = np.zeros_like(force)
        back[self.second] = -force[self.first]
        return back

    def normal_forces(self, traction: Floats, weights: Floats, units: Floats) -> Floats:
        """Return the forces T of bonded edges as vectors."""
        one, other = self.first[self.bonded], self.second[self.bonded]
        n, w, v = units[one], weights[one], weights[other]
        size = np.einsum("kd,kd->k", (w[:, None] * traction[one] - v[:, None] * traction[other]), n) / (w + v)
        force = np.zeros_like(traction)
        force[one] = size[:, None] * n
        force[other] = -force[one]
        return force


def joints(posed: PosedScene, edges: Ints, units: Floats) -> Joints:
    """Return the joints among boundary edges."""
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
    """The edges of a mesh, inside and on the boundary."""

    mesh: PolygonMesh
    sides: Ints  # (c, 2) end nodes of cell edges, counter-clockwise
    owner: Ints  # (c,) cells of the edges in `sides`
    shear: Floats  # (n_cells,) shear moduli
    outer: Ints  # (b,) cells of boundary edges
    outer_corners: Ints  # (b,) cell corners at which boundary edges begin
    outer_edges: Ints  # (b, 2) end nodes of boundary edges, counter-clockwise
    outer_normals: Floats  # (b, 2) outward normals of boundary edges, scaled by edge length
    free: Floats  # (b, 2, 2) projectors onto directions that the supports leave free
    joints: Joints

    @cached_property
    def sizes(self) -> Floats:
        """The sizes (n_cells,) of cells (`extents`)."""
        return extents(self.owner, self.mesh.points[self.sides] - self.mesh.centroids[self.owner, None])

    @cached_property
    def lengths(self) -> Floats:
        """The lengths (b,) of boundary edges."""
        return np.asarray(np.linalg.norm(self.outer_normals, axis=1))

    @cached_property
    def units(self) -> Floats:
        """The outward unit normals (b, 2) of boundary edges."""
        return self.outer_normals / self.lengths[:, None]

    @cached_property
    def tangents(self) -> Floats:
        """The unit tangents (b, 2) of boundary edges, with the body on the left."""
        return self.units[:, ::-1] * [-1.0, 1.0]

    def jumps(self, u: Floats) -> Floats:
        """Return u at the ends of boundary edges, minus u on the opposite edge at interfaces."""
        across = self.joints.across
        return np.asarray(u[self.outer_edges] - np.where(across[:, :, None] >= 0, u[across], 0.0))


def extents(owner: Ints, arms: Floats) -> Floats:
    """Return the sizes h_K (n_cells,) of cells.

    The size of a box is its longest side. In general, h_K^2 is the largest eigenvalue of 12 / |K| int_K (x - c)(x - c)'
    dx, with the centroid c of the cell K. The cell `owner[j]` contains a simplex with the corners c and c + arms[j, i].
    """
    dim, count = arms.shape[2], int(owner.max()) + 1
    volumes = np.linalg.det(arms)
    tips = np.concatenate([arms, arms.sum(axis=1, keepdims=True)], axis=1)
    moments = np.zeros((count, dim, dim))
    np.add.at(moments, owner, volumes[:, None, None] * np.einsum("kai,kaj->kij", tips, tips))
    moments *= 12.0 / ((dim + 1) * (dim + 2) * totals(owner, volumes, count)[:, None, None])
    return np.sqrt(np.linalg.eigvalsh(moments)[:, -1])


def skeleton(posed: PosedScene) -> Skeleton:
    """Return the skeleton of a posed scene."""
    mesh = plane_mesh(posed.space.mesh, "error_budget")
    shared = mesh.shared_edges
    edges = corner_edges(mesh.offsets, mesh.vertices)
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
    u: Floats  # (n_nodes, 2)
    lam: Floats  # (m, block) multipliers of friction
    p: Floats  # (r,) multipliers of obstacles
    weights: Floats  # (m,) weights of friction
    worn: Floats  # (m,) friction work since the initial instant


def instant(history: History, row: int) -> Instant:
    """Return the state in a row of a history."""
    run = history.trajectory
    parts = run.multipliers[row], run.pressures[row], run.weights[row], run.worn[row]
    return Instant(float(history.times[row]), history.displacement[row], *parts)


def pressures_at_ends(posed: PosedScene, edges: Skeleton, now: Instant) -> Floats:
    """Return the pressures of obstacles at ends of boundary edges."""
    return at_ends(edges, posed.obstacles, (now.p / posed.obstacles.lengths)[:, None])[..., 0]


def body_forces(posed: PosedScene, t: float) -> Floats:
    """Return the resultants (n_cells, dim) of body forces in cells."""
    total = np.zeros((posed.space.mesh.n_cells, posed.space.dim))
    for load in posed.loads:
        if not isinstance(load, InitialStresses) and load.cells is not None:
            np.add.at(total, load.cells, load.forces(t))
    return total


def at_ends(edges: Skeleton, rows: ContactRows, values: Floats) -> Floats:
    """Return values of contact rows at ends of boundary edges, or zero."""
    # At an interface, a supported node has no row, and gets the value at the other end of the edge.
    row, end = rows.ends.nonzero()
    found, known = np.zeros((len(edges.outer), 2, values.shape[1])), edges.joints.across < 0
    edge = positions(rows.names[end], edges.outer_edges, int(edges.outer_edges.max()) + 1)
    side = (rows.names[end, 0] != edges.outer_edges[edge, 0]).astype(int)
    np.add.at(found, (edge, side), values[row])
    known[edge, side] = True
    for one, other in ((0, 1), (1, 0)):
        bare = known[:, other] & ~known[:, one]
        found[bare, one] = found[bare, other]
    return found


def check_estimable(posed: PosedScene, subject: str) -> None:
    """Raise SceneError if there is no estimate."""
    if posed.system.damping is not None or posed.obstacles.rates.any():
        raise SceneError(
            f"{subject}: there is no estimate for scenes with Viscosity or VelocityContact; compare runs on several "
            "meshes and with several steps."
        )
    if posed.supports.amplitudes:
        loose = ", ".join(support.subject for support in posed.supports.given if support.patterns is not None)
        raise SceneError(
            f"{subject}: there is no estimate with {loose}, whose motion is unknown: the force on its nodes is no "
            "traction; compare runs on several meshes."
        )
    for friction in posed.terms.frictions:
        law = friction.law
        if (law is not None and law.slips) or friction.directions is not None:
            raise SceneError(
                f"{subject}: there is no estimate for {friction.subject}: its weights depend on slip, or it acts "
                "along given directions; compare runs on several meshes."
            )
    frictions = tuple(friction.subject for friction in posed.terms.frictions)
    for subjects, rows in ((frictions, posed.terms), (posed.obstacles.subjects, posed.obstacles)):
        if (rows.names[rows.ends.indices, 1] < 0).any():
            raise SceneError(
                f"{subject}: there is no estimate for {', '.join(subjects)}, whose edges are not known. An effect of "
                "your own names its edges by ends= of Friction, Obstacle or ContactSurface."
            )
    for load in posed.loads:
        if not isinstance(load, InitialStresses) and load.cells is None and load.edges is None:
            raise SceneError(
                f"{subject}: there is no estimate for {load.subject}: a point force does infinite work on an elastic "
                "body, so energies do not converge. Distribute it over a part of the boundary by Traction."
            )
