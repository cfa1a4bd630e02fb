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

from vemcvx.base.arrays import Bools, Floats, Ints
from vemcvx.base.errors import SceneError
from vemcvx.history import History
from vemcvx.meshes import PolygonMesh, plane_mesh
from vemcvx.meshes.polygons import cell_of_corner, cross, directed_edges, positions, right_of, spans
from vemcvx.scene import ContactRows, InitialStresses, PosedScene, jump_rows
from vemcvx.vem import elastic_matrix, mean_shear, strains, stresses


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

    sizes: Floats
    """(n_cells,) h_K: the longer side of the rectangle with the cell's second moments"""
    corners: Floats
    """(c, 2) the corners of every cell, counter-clockwise"""
    offsets: Ints
    """(n_cells + 1,) where those of each cell begin"""
    areas: Floats
    """(n_cells,)"""
    sides: Ints
    """(c, 2) the edges of every cell, counter-clockwise"""
    owner: Ints
    """(c,) the cell of each"""
    shear: Floats
    """(n_cells,) mu; half the harmonic mean of the two moduli of shear, at most twice the softer, where they differ"""
    inside: Ints
    """(e, 2) the two cells of each inner edge"""
    inside_normals: Floats
    """(e, 2) from the first cell to the second, as long as the edge"""
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


def widths(corners: Floats, offsets: Ints, cells: Ints, normals: Floats) -> Floats:
    """(e,) of cells (e,) along normals (e, dim) of any length; the corners (c, dim) of each begin at its offset."""
    if len(cells) == 0:
        return np.zeros(0)
    counts = np.diff(offsets)[cells]
    height = np.einsum("ki,ki->k", corners[spans(offsets[cells], counts)], np.repeat(normals, counts, axis=0))
    first = np.cumsum(counts) - counts
    width = np.maximum.reduceat(height, first) - np.minimum.reduceat(height, first)
    return np.asarray(width / np.linalg.norm(normals, axis=1))


def skeleton(posed: PosedScene) -> Skeleton:
    """The edges of a posed scene's mesh."""
    mesh = plane_mesh(posed.space.mesh, "error_budget")
    shared = mesh.shared_edges
    edges = directed_edges(mesh.offsets, mesh.vertices)
    normals = right_of(np.diff(mesh.points[edges], axis=1)[:, 0])
    first, two = shared.corners[shared.first], shared.counts == 2
    owner = cell_of_corner(mesh.offsets)
    inner, outer = first[two], first[~two]
    return Skeleton(
        sizes=np.sqrt(np.linalg.eigvalsh(_extents(mesh, edges, owner))[:, 1]),
        corners=mesh.points[edges[:, 0]],
        offsets=mesh.offsets,
        areas=mesh.areas,
        sides=edges,
        owner=owner,
        shear=0.5 * mean_shear(elastic_matrix(posed.material.moduli)),
        inside=mesh.neighbours,
        inside_normals=normals[inner],
        outer=owner[outer],
        outer_corners=outer,
        outer_edges=edges[outer],
        outer_normals=normals[outer],
        free=posed.supports.free_directions(edges[outer].ravel(), np.repeat(np.arange(len(outer)), 2)),
        joints=joints(posed, edges[outer], normals[outer]),
    )


def _extents(mesh: PolygonMesh, edges: Ints, owner: Ints) -> Floats:
    """M = 12 / |K| int_K (x - c)(x - c)' dx: diag(a^2, b^2) for a rectangle with the sides a, b.

    Over the triangle of c = 0, a and b, int x x' = |T| (a a' + b b' + (a + b)(a + b)') / 12.
    """
    ends = mesh.points[edges] - mesh.centroids[owner, None]
    corners = np.concatenate([ends, ends.sum(axis=1, keepdims=True)], axis=1)
    share = 0.5 * cross(ends[:, 0], ends[:, 1]) / mesh.areas[owner]
    extents = np.zeros((mesh.n_cells, 2, 2))
    np.add.at(extents, owner, share[:, None, None] * np.einsum("eki,ekj->eij", corners, corners))
    return extents


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


def contact_tractions(posed: PosedScene, now: Instant) -> tuple[Floats, Floats]:
    """Friction on rows of terms (m, dim), and pressure on those of obstacles (r, dim)."""
    terms, obstacles = posed.terms, posed.obstacles
    friction: Floats = -np.einsum("mb,mbd->md", now.lam, terms.tangents) / terms.lengths[:, None]
    return friction, -(now.p / obstacles.lengths)[:, None] * obstacles.normals


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


def volume_squares(posed: PosedScene, sizes: Floats, shear: Floats, t: float) -> Floats:
    """h^2 / mu |f|^2_K (n_cells,) with the mean force: F = |K| f."""
    squared: Floats = np.sum(body_forces(posed, t) ** 2, axis=1)
    return sizes**2 / posed.space.mesh.measures * squared / shear


def strained(posed: PosedScene, now: Instant) -> tuple[Floats, Floats]:
    """Strains of Pi u in the cells, and the stresses under these, with those at zero strain."""
    strain = strains(posed.space, now.u)
    sigma = stresses(posed.material.moduli, strain)
    return strain, sigma if posed.prestress is None else sigma + posed.prestress.stress(now.t)


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
