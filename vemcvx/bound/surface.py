"""The surface of a body at an instant: supports, loads, and admissible tractions of friction and contact.

Functions on edges are linear, and given by values at both ends. Loads and friction bounds are linear fits to data
(:mod:`.reading`).

A displacement v has the normal component v_n, the slip s in the step, and the depth z = v_n - gap. The friction on the
body is -q, with the bound g, and the pressure is p. A compliant obstacle has the stiffness k. Tractions with |q| <= g
and p >= 0 are admissible. We divide the multipliers of the run by lengths, and clip the results to admissible values.
With z_+ = max(z, 0), the defect of v, q and p in the laws of friction and contact is the sum of

    friction                rigid obstacles (z <= 0)        compliant obstacles
    int (g |s| - q s),      int -p z,                       int (k z_+^2 / 2 + p^2 / (2 k) - p z).

Each integral is >= 0. Where s changes sign on an edge, linear interpolation of |s| increases the integral.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, SINGLE_EPS, Bools, Floats
from vemcvx.base.errors import SceneError
from vemcvx.bound.reading import Reader, Reading, stiffness_of
from vemcvx.bound.skeleton import Instant, Skeleton, at_ends
from vemcvx.effects import Friction, Obstacle, Support
from vemcvx.program.kernel import balance_multipliers
from vemcvx.scene import ContactRows, PosedScene
from vemcvx.vem.projection import tangents_of

MASS = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0
"""The integrals int phi_i phi_j of linear basis functions on an edge of unit length."""


def products(a: Floats, b: Floats) -> Floats:
    """Return the mean products (b,) of linear functions on edges."""
    return np.asarray(np.einsum("bi,ij,bj->b", a, MASS, b))


def along(ends: Floats, ways: Floats) -> Floats:
    """Return the products (b, 2) of the vectors `ends` and the directions `ways`."""
    return np.asarray(np.einsum("bed,bd->be", ends, ways))


def squares_above_zero(z: Floats) -> Floats:
    """Return the mean (b,) of z_+^2 on edges for linear functions z."""
    least, most = np.sort(z, axis=1).T
    crossing = (least < 0.0) & (most > 0.0)
    span = np.where(crossing, most - least, 1.0)
    return np.asarray(np.where(crossing, most**3 / (3.0 * span), products(np.maximum(z, 0.0), np.maximum(z, 0.0))))


@dataclass(frozen=True, eq=False)
class Surface:
    """The forces, friction and contact on boundary edges at an instant."""

    loads: Floats  # (b, 2, 2) loads at the ends of edges (`forces_of`)
    forces: Floats  # (b, 2, 2) loads, friction and pressure at the ends of edges
    cost: Floats  # (b,) int (g |s| + k z_+^2 / 2)
    gap: Floats  # (b,) defects in the laws of friction and contact
    laws: Floats  # (2, b, 2) g and q at the ends of edges
    slip: Floats  # (b, 2) s at the ends of edges

    @classmethod
    def from_loads(cls, loads: Floats) -> Surface:
        """Return a surface with loads and no contact."""
        none = np.zeros(loads.shape[:2])
        edges, laws = none[:, 0], np.stack([none, none])
        return cls(loads=loads, forces=loads, cost=edges, gap=edges, laws=laws, slip=none)


@dataclass(frozen=True, eq=False)
class _Pressing:
    """The pressure of rigid or of compliant obstacles."""

    ends: Floats  # (b, 2) p at the ends of edges
    acts: Bools  # (b,) mask of edges with an obstacle
    depth: Floats  # (b, 2) z, zero without an obstacle
    stiffness: Floats | None  # (b, 2) k; None for rigid obstacles

    @property
    def stored(self) -> Floats:
        """Upper bounds (b,) of mean values of k z_+^2 / 2 on edges."""
        if self.stiffness is None:
            return np.zeros(len(self.ends))
        return np.asarray(0.5 * self.stiffness.max(axis=1) * squares_above_zero(self.depth))

    def law_defect(self, p: Floats) -> Floats:
        """Return the mean defect (b,) in the law of contact."""
        if self.stiffness is None:
            return products(p, np.maximum(-self.depth, 0.0))
        return np.asarray(self.stored + 0.5 * products(p, p) / self.stiffness.min(axis=1) - products(p, self.depth))


@dataclass(frozen=True, eq=False)
class Boundary:
    """The boundary of a posed scene."""

    posed: PosedScene
    edges: Skeleton
    reader: Reader

    def _project_prescribed(self, joined: bool) -> Floats:
        """Return projectors (b, 2, 2) on directions of prescribed motions or jumps."""
        squares, fine = np.zeros((len(self.edges.outer), 2, 2)), self.reader.fine
        for support in self.reader.supports:
            jumps = False if support.partners is None else support.partners >= 0
            new = (support.nodes >= fine.old) & (jumps == joined)
            d, owner = support.directions[new], fine.owner[support.nodes[new] - fine.old]
            np.add.at(squares, owner, np.einsum("qi,qj->qij", d, d))
        values, vectors = np.linalg.eigh(squares)
        kept = values > 1e-4 * values.max(initial=0.0)
        return np.asarray(np.einsum("bik,bk,bjk->bij", vectors, kept, vectors))

    @cached_property
    def bonds(self) -> Floats:
        """The projectors (j, 2, 2) on the bonded directions of joints."""
        return self._project_prescribed(True)[self.edges.joints.first]

    @cached_property
    def free(self) -> Floats:
        """The projectors (b, 2, 2) on the directions that the supports leave free."""
        free, joints = np.eye(2) - self._project_prescribed(False), self.edges.joints
        held = (free[[joints.first, joints.second]] != np.eye(2)).any(axis=(0, 2, 3))
        if (held & self.bonds.any(axis=(1, 2))).any():
            raise SceneError(
                "error_bound: there is no bound if a support also holds edges of a bonded interface. "
                "Give the support a boundary without these edges."
            )
        return free

    def _moves(self, directions: Floats) -> Bools:
        """Return a mask (b,) of edges that can move or jump along `directions`."""
        joints = self.edges.joints
        moves: Bools = np.einsum("bi,bij,bj->b", directions, self.free, directions) > SAME
        along = directions[joints.first]
        bonded = np.einsum("ji,jik,jk->j", along, self.bonds, along) > 1.0 - SAME
        moves[joints.first] = (moves[joints.first] | moves[joints.second]) & ~bonded
        return moves

    @cached_property
    def _effect_edges(self) -> tuple[Bools, Bools]:
        """The masks (b,) of edges with friction and of edges with obstacles."""
        found = np.zeros((2, len(self.edges.outer)), dtype=bool)
        rows: tuple[Friction | Obstacle, ...] = (*self.reader.frictions, *self.reader.obstacles)
        for one in rows:
            if one.ends is None:
                raise SceneError(
                    f"error_bound: there is no bound for {one.subject}, whose edges are not known. An effect "
                    "of your own names its edges by ends= of Friction or Obstacle."
                )
            tips = self.reader.fine.tips(one, np.ones((len(one.nodes), 1)))
            found[int(isinstance(one, Obstacle))] |= np.isfinite(tips).any(axis=(1, 2))
        return found[0], found[1]

    @cached_property
    def acting(self) -> tuple[Bools, Bools]:
        """The masks (b,) of edges where friction can do work, and of edges where obstacles can do work."""
        slip, normal = self._effect_edges
        return slip & self._moves(self.edges.tangents), normal & self._moves(self.edges.units)

    @cached_property
    def touching(self) -> Bools:
        """The mask (b,) of edges with friction, an obstacle or a bonded body."""
        joints, (slip, normal) = self.edges.joints, self._effect_edges
        found = slip | normal
        found[joints.first] |= self.bonds.any(axis=(1, 2))
        found[joints.second] |= found[joints.first]
        return found

    def off_supports(self, u: Floats, components: Callable[[Support], Floats]) -> tuple[Support | None, float]:
        """Return the support whose prescribed values differ most from u, and the difference."""
        ends, jumps, fine = u[self.edges.outer_edges], self.edges.jumps(u), self.reader.fine
        size, found, most = float(np.abs(u).max(initial=0.0)), None, 0.0
        for support in self.reader.supports:
            new = support.nodes >= fine.old
            at, moved, values = support.nodes[new] - fine.old, ends, components(support)[new]
            line = fine.between(moved if support.partners is None else jumps, at)
            off = np.abs(np.einsum("qd,qd->q", support.directions[new], line) - values).max(initial=0.0)
            if off > SAME * max(size, np.abs(values).max(initial=0.0)) and off > most:
                found, most = support, float(off)
        return found, most

    def check_supports(self, now: Instant) -> None:
        """Raise SceneError if a support prescribes a displacement that is not linear on edges."""
        support, off = self.off_supports(
            now.u, lambda one: np.zeros(len(one.nodes)) if one.value is None else np.asarray(one.value(now.t))
        )
        if support is not None:
            raise SceneError(
                f"error_bound: {support.subject} prescribes a displacement that differs by {off:.3g} from a linear one "
                "between nodes; there is no bound for such supports. Prescribe a displacement that is linear on edges, "
                "or give tractions."
            )

    def at(self, now: Instant, before: Instant, read: Reading, body: Floats) -> Surface:
        """Return the surface after a step; `body` is the work of body forces on `motions`."""
        tangents, units, lengths = self.edges.tangents, self.edges.units, self.edges.lengths
        g, slip, loads = self._friction_bound(now, read), self._slip(now, before), self.forces_of(read.tractions)
        q, rigid, soft = self._friction(now, g), self._pressing(now, False), self._pressing(now, True)
        pressures = np.stack([rigid.ends, soft.ends])
        if self.motions.shape[1]:
            q, pressures = self._balance((q, g), (pressures, (rigid.acts, soft.acts)), loads, body)
        dissipated = products(g, np.abs(slip))
        law_defect = dissipated - products(q, slip) + rigid.law_defect(pressures[0]) + soft.law_defect(pressures[1])
        contact = q[..., None] * tangents[:, None] + pressures.sum(axis=0)[..., None] * units[:, None]
        contact[self.edges.joints.second] -= contact[self.edges.joints.first][:, ::-1]
        return Surface(
            loads=loads,
            forces=loads - self.forces_of(contact),
            cost=lengths * (dissipated + soft.stored),
            gap=np.maximum(lengths * law_defect, 0.0),
            laws=np.stack([g, q]),
            slip=slip,
        )

    def forces_of(self, tractions: Floats) -> Floats:
        """Return the forces int t phi (b, 2, 2) of tractions t, with hat functions phi."""
        return np.asarray(np.matmul(self.edges.lengths[:, None, None] * MASS, tractions))

    def law_defect(self, before: Surface, now: Surface) -> float:
        """Return the defect of a step in Tresca's law, with friction linear in time."""
        g, q = 0.5 * (before.laws + now.laws)
        means = products(g, np.abs(now.slip)) - products(q, now.slip)
        return max(float(np.sum(self.edges.lengths * means)), 0.0)

    def _at_ends(self, rows: ContactRows, values: Floats) -> Floats:
        """Return the values (b, 2, j) of rows at the ends of edges."""
        both = at_ends(self.edges, rows, np.column_stack([values, np.ones(len(values))]))
        return np.where(both[..., -1:] > 0, both, both[:, ::-1])[..., :-1]

    def _friction_bound(self, now: Instant, read: Reading) -> Floats:
        terms, g = self.posed.terms, read.friction
        if self.follows_pressure:
            g = self._at_ends(terms, (now.weights / terms.lengths)[:, None])[..., 0]
        return np.where(self.acting[0][:, None], g, 0.0)

    @property
    def follows_pressure(self) -> bool:
        """True if a friction bound depends on the pressure."""
        return any(friction.law is not None for friction in self.reader.frictions)

    def _slip(self, now: Instant, before: Instant) -> Floats:
        """Return the slip s (b, 2) relative to the ground."""
        moved = np.zeros((len(self.edges.outer), 2))
        for friction in self.reader.frictions:
            if friction.ground is not None:
                motion = friction.ground.vector(now.t) - friction.ground.vector(before.t)
                motion = np.einsum("md,md->m", motion, tangents_of(friction.normals)[:, 0])
                way = self.reader.fine.tips(friction, motion[:, None])[..., 0]
                # All frictions on an edge have the same ground motion.
                moved = np.where(np.isfinite(way), way, moved)
        return along(self.edges.jumps(now.u - before.u), self.edges.tangents) - moved

    def _friction(self, now: Instant, g: Floats) -> Floats:
        terms = self.posed.terms
        against = self._at_ends(terms, now.lam / terms.lengths[:, None] * terms.tangents[:, 0])
        return np.asarray(np.clip(along(against, self.edges.tangents), -g, g))

    def _pressing(self, now: Instant, compliant: bool) -> _Pressing:
        obstacles = self.posed.obstacles
        mine = (obstacles.compliance > 0) == compliant
        ends = self._at_ends(obstacles[np.flatnonzero(mine)], (now.p / obstacles.lengths)[mine, None])[..., 0]
        z, k = self._depths(now.u, now.t, compliant)
        acts = np.asarray(np.isfinite(z).all(axis=1))[:, None]
        z = np.where(acts, z, 0.0)
        if not compliant and z.max(initial=0.0) > SINGLE_EPS * np.abs(now.u).max(initial=0.0):
            raise SceneError(
                "error_bound: a node that the supports hold is inside a rigid obstacle, so the displacement is not "
                "admissible, and there is no bound. Give the obstacle a gap of zero or more there."
            )
        pressure = np.where(acts, np.maximum(ends, 0.0), 0.0)
        return _Pressing(pressure, acts[:, 0], z, np.where(acts, k, 1.0) if compliant else None)

    def _depths(self, u: Floats, t: float, compliant: bool) -> tuple[Floats, Floats]:
        """Return depths z (b, 2), -inf without obstacles, and stiffnesses k (b, 2)."""
        fine, (distance, stiffness) = self.reader.fine, np.zeros((2, len(self.edges.outer), 2))
        distance += np.inf
        for obstacle in (one for one in self.reader.obstacles if (one.compliance > 0).any() == compliant):
            read = fine.tips(obstacle, obstacle.gap(t)[:, None])[..., 0]
            known = np.isfinite(read)
            if np.isfinite(distance[known]).any():
                raise SceneError(
                    f"error_bound: there is no bound if {obstacle.subject} and another obstacle of the same kind act "
                    "on the same edge; give each its own part of the boundary, or replace both by one effect."
                )
            distance[known] = read[known]
            if compliant:
                stiffness[known] = fine.tips(obstacle, stiffness_of(obstacle)[:, None])[..., 0][known]
        distance[~self._moves(self.edges.units)] = np.inf
        return along(self.edges.jumps(u), self.edges.units) - distance, stiffness

    @cached_property
    def motions(self) -> Floats:
        """The rigid motions (n_u, j) of bodies that only friction and one-sided contact hold."""
        kernel, P = self.posed.system.kernel, self.posed.supports.P
        return np.zeros((P.shape[0], 0)) if kernel is None else np.asarray(P @ np.linalg.qr(kernel.modes)[0])

    def _balance(
        self, friction: tuple[Floats, Floats], pressing: tuple[Floats, tuple[Bools, Bools]], loads: Floats, body: Floats
    ) -> tuple[Floats, Floats]:
        """Return admissible q (b, 2) and pressures (2, b, 2) that balance the loads."""
        (q, g), (p, acting), edges = friction, pressing, self.edges
        moved = [mode.reshape(-1, 2) for mode in self.motions.T]
        jumps = [edges.jumps(mode) for mode in moved]
        slip, outward = (
            self.forces_of(np.stack([along(one, ways) for one in jumps], axis=2)).reshape(-1, len(moved))
            for ways in (edges.tangents, edges.units)
        )
        push = body + np.array([np.sum(loads * mode[edges.outer_edges]) for mode in moved])
        modes = np.concatenate([slip, *(outward * np.repeat(acts, 2)[:, None] for acts in acting)])
        lengths = np.repeat(edges.lengths, 2)
        found, pressure = balance_multipliers(
            (q.reshape(-1, 1), p.ravel()), g.ravel(), modes, push, (1.0 / lengths, 1.0 / np.tile(lengths, 2))
        )
        left = push - np.append(found, pressure) @ modes
        size = np.abs(np.append(q, p))[:, None] * np.abs(modes)
        if np.abs(left).max() > SAME * max(np.abs(push).max(), size.sum(axis=0).max()):
            raise SceneError(
                "error_bound: friction and pressure that are linear on edges cannot balance the load on a body that "
                "supports do not hold; there is no bound. Refine the mesh, or add a support."
            )
        acts = np.stack(acting)[:, :, None]
        return found.reshape(-1, 2), np.where(acts, pressure.reshape(p.shape), 0.0)


def free_alone(P: sp.csr_matrix | sp.csc_matrix) -> Floats:
    """Return projectors (n_nodes, 2, 2) on the directions in which nodes can move alone."""
    # The columns of P are orthonormal, so blocks of P P' have the eigenvalue 1 in these directions.
    moved = sp.csr_matrix(P @ P.T).tocoo()
    near, blocks = moved.row // 2 == moved.col // 2, np.zeros((P.shape[0] // 2, 2, 2))
    blocks[moved.row[near] // 2, moved.row[near] % 2, moved.col[near] % 2] = moved.data[near]
    values, vectors = np.linalg.eigh(blocks)
    return np.asarray(np.einsum("nik,nk,njk->nij", vectors, values > 1.0 - SAME, vectors))
