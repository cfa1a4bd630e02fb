"""The surface of a body at an instant: what holds it, what loads it, and tractions that friction and contact admit.

All is linear on edges, known at both ends: loads and bounds of friction as :mod:`.reading` has them, gaps and motions
of the ground by their values at nodes. The effects of the scene are asked once more on edges cut into pieces
(:mod:`vemcvx.bound.fine_boundary`), which tells on what edges they act.

With s the slip of v since the step before, q the friction (against s, so that tau_t = -q) and g its bound, z = v_n -
gap the depth, p the pressure and k the stiffness of a compliant obstacle, any |q| <= g and p >= 0 will do, and the
multipliers of the answer give them, as force over length, clipped. What v and these lack of the laws of friction and
contact is the sum of

    int g |s| - q s,        int -p z  (z <= 0),        int k z_+^2 / 2 + p^2 / (2 k) - p z,

each >= 0. On an edge where s changes its sign |s| is not linear; the line between its ends is above it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, SINGLE_EPS, Bools, Floats
from vemcvx.base.errors import SceneError
from vemcvx.bound.reading import Reader, Reading
from vemcvx.bound.skeleton import Instant, Skeleton, at_ends
from vemcvx.effects import Friction, Obstacle, Support
from vemcvx.program.kernel import balance_multipliers
from vemcvx.scene import ContactRows, PosedScene
from vemcvx.vem import tangents_of

MASS = np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0
"""int phi_i phi_j over an edge of length one, of functions that are linear from either end."""


def products(a: Floats, b: Floats) -> Floats:
    """(b,) the mean of the product of two functions (b, 2) that are linear on edges, known at their ends."""
    mean: Floats = np.einsum("bi,ij,bj->b", a, MASS, b)
    return mean


def along(ends: Floats, ways: Floats) -> Floats:
    """The components (b, 2) along ways (b, 2) of motions (b, 2, 2) of the ends of edges."""
    components: Floats = np.einsum("bed,bd->be", ends, ways)
    return components


def squares_above_zero(z: Floats) -> Floats:
    """(b,) the mean of z_+^2 of functions (b, 2) that are linear on edges, known at their ends."""
    least, most = np.sort(z, axis=1).T
    crossing = (least < 0.0) & (most > 0.0)
    span = np.where(crossing, most - least, 1.0)
    mean: Floats = np.where(crossing, most**3 / (3.0 * span), products(np.maximum(z, 0.0), np.maximum(z, 0.0)))
    return mean


@dataclass(frozen=True, eq=False)
class Surface:
    """The forces on the boundary edges (b,) at an instant, and the laws of friction and contact there."""

    loads: Floats
    """(b, 2, 2) int t phi at both ends, of loads"""
    forces: Floats
    """(b, 2, 2) likewise of loads, friction and pressure"""
    cost: Floats
    """(b,) int g |s| + k z_+^2 / 2: what v pays for friction, and stores in obstacles"""
    gap: Floats
    """(b,) what v and the tractions lack of the laws of friction and contact"""
    laws: Floats
    """(2, b, 2) g and q at the ends of edges, g being zero where nothing rubs"""
    slip: Floats
    """(b, 2) s"""

    @classmethod
    def of_loads(cls, loads: Floats) -> Surface:
        """The surface of loads (b, 2, 2) where nothing touches."""
        none = np.zeros(loads.shape[:2])
        edges, laws = none[:, 0], np.stack([none, none])
        return cls(loads=loads, forces=loads, cost=edges, gap=edges, laws=laws, slip=none)


@dataclass(frozen=True, eq=False)
class _Pressing:
    """The pressure of rigid or of compliant obstacles."""

    ends: Floats
    """(b, 2) p at the ends of edges"""
    acts: Bools
    """(b,) on which edges"""
    depth: Floats
    """(b, 2) z, zero where there is none"""
    stiffness: Floats | None
    """(b, 2) k; None of rigid ones"""

    @property
    def stored(self) -> Floats:
        """(b,) the mean of k z_+^2 / 2 on edges, at most."""
        if self.stiffness is None:
            return np.zeros(len(self.ends))
        stored: Floats = 0.5 * self.stiffness.max(axis=1) * squares_above_zero(self.depth)
        return stored

    def lacking(self, p: Floats) -> Floats:
        """(b,) the mean of what the law lacks on edges where pressures are p (b, 2)."""
        if self.stiffness is None:
            return products(p, np.maximum(-self.depth, 0.0))
        lacking: Floats = self.stored + 0.5 * products(p, p) / self.stiffness.min(axis=1) - products(p, self.depth)
        return lacking


@dataclass(frozen=True, eq=False)
class Boundary:
    """The boundary of a posed scene."""

    posed: PosedScene
    edges: Skeleton
    reader: Reader

    # What supports hold.

    def _prescribed(self, joined: bool) -> Floats:
        """(b, 2, 2) projectors on what supports prescribe on edges: motions, or jumps to another body."""
        squares, fine = np.zeros((len(self.edges.outer), 2, 2)), self.reader.fine
        for support in self.reader.supports:
            jumps = False if support.partners is None else support.partners >= 0
            new = (support.nodes >= fine.old) & (jumps == joined)
            d, owner = support.directions[new], fine.owner[support.nodes[new] - fine.old]
            np.add.at(squares, owner, np.einsum("qi,qj->qij", d, d))
        values, vectors = np.linalg.eigh(squares)
        kept = values > 1e-4 * values.max(initial=0.0)
        projectors: Floats = np.einsum("bik,bk,bjk->bij", vectors, kept, vectors)
        return projectors

    @cached_property
    def bonds(self) -> Floats:
        """(j, 2, 2) projectors on the directions in which the two edges of each joint move alike."""
        return self._prescribed(True)[self.edges.joints.first]

    @cached_property
    def free(self) -> Floats:
        """(b, 2, 2) projectors on the directions in which supports do not hold edges."""
        free, joints = np.eye(2) - self._prescribed(False), self.edges.joints
        held = (free[[joints.first, joints.second]] != np.eye(2)).any(axis=(0, 2, 3))
        if (held & self.bonds.any(axis=(1, 2))).any():
            raise SceneError(
                "error_bound: there is no bound where a support holds an edge of an interface whose two sides are held "
                "together; end it beside the interface."
            )
        return free

    def _moves(self, directions: Floats) -> Bools:
        """(b,) which edges move along these directions (b, 2), also at an angle; of a joint, move apart along them."""
        joints = self.edges.joints
        moves: Bools = np.einsum("bi,bij,bj->b", directions, self.free, directions) > SAME
        along = directions[joints.first]
        bonded = np.einsum("ji,jik,jk->j", along, self.bonds, along) > 1.0 - SAME
        moves[joints.first] = (moves[joints.first] | moves[joints.second]) & ~bonded
        return moves

    @cached_property
    def _bearing(self) -> tuple[Bools, Bools]:
        """(b,) the edges of frictions, and of obstacles, also those that assembled as zero."""
        found = np.zeros((2, len(self.edges.outer)), dtype=bool)
        rows: tuple[Friction | Obstacle, ...] = (*self.reader.frictions, *self.reader.obstacles)
        for one in rows:
            if one.ends is None:
                raise SceneError(
                    f"error_bound: there is no bound for {one.subject}, which does not say on which edges it acts: "
                    "effects of one's own say it by ends= of their Friction or Obstacle."
                )
            tips = self.reader.fine.tips(one, np.ones((len(one.nodes), 1)))
            found[int(isinstance(one, Obstacle))] |= np.isfinite(tips).any(axis=(1, 2))
        return found[0], found[1]

    @cached_property
    def acting(self) -> tuple[Bools, Bools]:
        """(b,) the edges on which friction, and obstacles, may act."""
        slip, normal = self._bearing
        return slip & self._moves(self.edges.tangents), normal & self._moves(self.edges.units)

    @cached_property
    def touching(self) -> Bools:
        """(b,) edges on which friction or obstacles act, or another body is bonded."""
        joints, (slip, normal) = self.edges.joints, self._bearing
        found = slip | normal
        found[joints.first] |= self.bonds.any(axis=(1, 2))
        found |= self.springs.any(axis=(1, 2))
        found[joints.second] |= found[joints.first]
        return found

    @cached_property
    def springs(self) -> Floats:
        """(b, 4, 4) matrices of springs to the ground on edges, by the motions of both ends."""
        owner, k, count = self.reader.fine.owner, self.reader.springs, len(self.edges.outer)
        mean = np.zeros((count, 2, 2))
        np.add.at(mean, owner, k / np.bincount(owner)[owner, None, None])
        if np.abs(k - mean[owner]).max(initial=0.0) > SAME * np.abs(k).max(initial=0.0):
            raise SceneError(
                "error_bound: there is no bound for springs (ElasticFoundation) whose stiffness varies along an edge; "
                "give one number for each part of the boundary."
            )
        springs: Floats = np.einsum("bij,bkl->bikjl", self.edges.lengths[:, None, None] * MASS, mean)
        self._check_along_boundary(springs.sum(axis=3))
        return springs.reshape(count, 4, 4)

    def _check_along_boundary(self, felt: Floats) -> None:
        """Raise SceneError where the scene's stiffness is not that of springs by which the ends of edges are held.

        `felt` (b, 2, 2, 2) are their forces on both ends under unit translations. No entry off the diagonal of a matrix
        of springs to the ground is negative, so that the diagonal is at most what translations feel.
        """
        stiffness, own = self.posed.springs, np.zeros((self.posed.space.mesh.n_nodes, 2, 2))
        if stiffness is None:
            return
        np.add.at(own, self.edges.outer_edges, felt)
        whole = (stiffness @ np.tile(np.eye(2), (len(own), 1))).reshape(own.shape)
        beyond = stiffness.diagonal().reshape(-1, 2).sum(axis=1) - np.trace(own, axis1=1, axis2=2)
        if max(np.abs(whole - own).max(), beyond.max()) > SAME * np.abs(own).max(initial=0.0):
            raise SceneError(
                "error_bound: there is no bound for a stiffness of one's own beside the material's that is not of "
                "springs to the ground along edges of the boundary, as ElasticFoundation has them."
            )

    def spring_energies(self, motion: Floats) -> Floats:
        """(b,) int k m . m of motions (b, 2, 2) of the ends of edges."""
        flat = motion.reshape(-1, 4)
        energies: Floats = np.einsum("bi,bij,bj->b", flat, self.springs, flat)
        return energies

    def off_supports(self, u: Floats, wanted: Callable[[Support], Floats]) -> tuple[Support | None, float]:
        """The support from whose components (m,) on edges nodal values (n_nodes, 2) are off most, if any, and by what.

        `wanted` gives those components of it.
        """
        ends, jumps, fine = u[self.edges.outer_edges], self.edges.jumps(u), self.reader.fine
        size, found, most = float(np.abs(u).max(initial=0.0)), None, 0.0
        for support in self.reader.supports:
            new = support.nodes >= fine.old
            at, moved, values = support.nodes[new] - fine.old, ends, wanted(support)[new]
            line = fine.between(moved if support.partners is None else jumps, at)
            off = np.abs(np.einsum("qd,qd->q", support.directions[new], line) - values).max(initial=0.0)
            if off > SAME * max(size, np.abs(values).max(initial=0.0)) and off > most:
                found, most = support, float(off)
        return found, most

    def check_supports(self, now: Instant) -> None:
        """Raise SceneError where nodal values do not follow supports along edges."""
        support, off = self.off_supports(
            now.u, lambda one: np.zeros(len(one.nodes)) if one.value is None else np.asarray(one.value(now.t))
        )
        if support is not None:
            raise SceneError(
                f"error_bound: {support.subject} moves the boundary by {off:.3g} otherwise than linearly between "
                "nodes; there is no bound for such supports. Prescribe what is linear on edges, or give tractions."
            )

    # What acts.

    def at(self, now: Instant, before: Instant, read: Reading, body: Floats) -> Surface:
        """The surface at the end of a step that began `before`; `body` (j,) is the work of body forces on `motions`.

        Raises
        ------
        SceneError
            Something has no bound.
        """
        tangents, units, lengths = self.edges.tangents, self.edges.units, self.edges.lengths
        g, slip, loads = self._friction_bound(now, read), self._slip(now, before), self.forces_of(read.tractions)
        q, rigid, soft = self._friction(now, g), self._pressing(now, False), self._pressing(now, True)
        pressures = np.stack([rigid.ends, soft.ends])
        if self.motions.shape[1]:
            q, pressures = self._balanced((q, g), (pressures, (rigid.acts, soft.acts)), loads, body)
        paid = products(g, np.abs(slip))
        lacking = paid - products(q, slip) + rigid.lacking(pressures[0]) + soft.lacking(pressures[1])
        contact = q[..., None] * tangents[:, None] + pressures.sum(axis=0)[..., None] * units[:, None]
        contact[self.edges.joints.second] -= contact[self.edges.joints.first][:, ::-1]
        return Surface(
            loads=loads,
            forces=loads - self.forces_of(contact),
            cost=lengths * (paid + soft.stored),
            gap=np.maximum(lengths * lacking, 0.0),
            laws=np.stack([g, q]),
            slip=slip,
        )

    def forces_of(self, tractions: Floats) -> Floats:
        """(b, 2, 2) int t phi at both ends of tractions (b, 2, 2) that are linear on edges, known there."""
        forces: Floats = np.matmul(self.edges.lengths[:, None, None] * MASS, tractions)
        return forces

    def lacking(self, before: Surface, now: Surface) -> float:
        """D, what friction and slip lack of their law between two instants, linear in time: >= 0."""
        g, q = 0.5 * (before.laws + now.laws)
        means = products(g, np.abs(now.slip)) - products(q, now.slip)
        return max(float(np.sum(self.edges.lengths * means)), 0.0)

    def _at_ends(self, rows: ContactRows, values: Floats) -> Floats:
        """(b, 2, j) values (m, j) of rows at the ends of edges; where supports hold one end, as at the other."""
        both = at_ends(self.edges, rows, np.column_stack([values, np.ones(len(values))]))
        return np.where(both[..., -1:] > 0, both, both[:, ::-1])[..., :-1]

    def _friction_bound(self, now: Instant, read: Reading) -> Floats:
        """Return the bound g (b, 2) of friction at the ends of edges; where it follows pressure that of the answer."""
        terms, g = self.posed.terms, read.friction
        if self.follows_pressure:
            g = self._at_ends(terms, (now.weights / terms.lengths)[:, None])[..., 0]
        return np.where(self.acting[0][:, None], g, 0.0)

    @property
    def follows_pressure(self) -> bool:
        """True where a law of friction reads the answer."""
        return any(friction.law is not None for friction in self.reader.frictions)

    def _slip(self, now: Instant, before: Instant) -> Floats:
        """(b, 2) the slip in a step at the ends of edges, less what the ground moves by."""
        moved = np.zeros((len(self.edges.outer), 2))
        for friction in self.reader.frictions:
            if friction.ground is not None:
                motion = friction.ground.vector(now.t) - friction.ground.vector(before.t)
                motion = np.einsum("md,md->m", motion, tangents_of(friction.normals)[:, 0])
                way = self.reader.fine.tips(friction, motion[:, None])[..., 0]
                # Frictions that share an edge share their ground: it moves once.
                moved = np.where(np.isfinite(way), way, moved)
        return along(self.edges.jumps(now.u - before.u), self.edges.tangents) - moved

    def _friction(self, now: Instant, g: Floats) -> Floats:
        """q (b, 2) at the ends of edges, by the multipliers."""
        terms = self.posed.terms
        against = self._at_ends(terms, now.lam / terms.lengths[:, None] * terms.tangents[:, 0])
        clipped: Floats = np.clip(along(against, self.edges.tangents), -g, g)
        return clipped

    def _pressing(self, now: Instant, compliant: bool) -> _Pressing:
        """The pressure of obstacles, rigid or compliant, by the multipliers."""
        obstacles = self.posed.obstacles
        mine = (obstacles.compliance > 0) == compliant
        ends = self._at_ends(obstacles[np.flatnonzero(mine)], (now.p / obstacles.lengths)[mine, None])[..., 0]
        z, k = self._depths(now.u, now.t, compliant)
        acts = np.asarray(np.isfinite(z).all(axis=1))[:, None]
        z = np.where(acts, z, 0.0)
        if not compliant and z.max(initial=0.0) > SINGLE_EPS * np.abs(now.u).max(initial=0.0):
            raise SceneError(
                "error_bound: the body is inside of a rigid obstacle at a node that supports hold: no displacement is "
                "at hand that is admissible, and there is no bound. Give the obstacle a gap of zero or more there."
            )
        pressure = np.where(acts, np.maximum(ends, 0.0), 0.0)
        return _Pressing(pressure, acts[:, 0], z, np.where(acts, k, 1.0) if compliant else None)

    def _depths(self, u: Floats, t: float, compliant: bool) -> tuple[Floats, Floats]:
        """The depths (b, 2) of a displacement in obstacles, -inf where there is none, and the stiffness of these."""
        fine, (distance, stiffness) = self.reader.fine, np.zeros((2, len(self.edges.outer), 2))
        distance += np.inf
        for obstacle in (one for one in self.reader.obstacles if (one.compliance > 0).any() == compliant):
            read = fine.tips(obstacle, obstacle.gap(t)[:, None])[..., 0]
            known = np.isfinite(read)
            if compliant and (stiffness[known] > 0).any():
                raise SceneError(
                    f"error_bound: there is no bound where {obstacle.subject} and another compliant obstacle share an "
                    "edge; give each its own part of the boundary, or one NormalCompliance for both."
                )
            distance[known] = np.minimum(distance[known], read[known])
            if compliant:
                k = 1.0 / (obstacle.compliance * obstacle.lengths)
                stiffness[known] = fine.tips(obstacle, k[:, None])[..., 0][known]
        distance[~self._moves(self.edges.units)] = np.inf
        return along(self.edges.jumps(u), self.edges.units) - distance, stiffness

    # The balance of bodies that nothing else holds.

    @cached_property
    def motions(self) -> Floats:
        """(n_u, j) of bodies that only friction and one-sided contact hold."""
        kernel, P = self.posed.system.kernel, self.posed.supports.P
        return np.zeros((P.shape[0], 0)) if kernel is None else np.asarray(P @ kernel.basis)

    def _balanced(
        self, friction: tuple[Floats, Floats], pressing: tuple[Floats, tuple[Bools, Bools]], loads: Floats, body: Floats
    ) -> tuple[Floats, Floats]:
        """The nearest friction q (b, 2) within its bound, and pressures (2, b, 2), that balance loads on these motions.

        Nodal multipliers do, but tractions linear between nodes have other moments.
        """
        (q, g), (p, acting), edges = friction, pressing, self.edges
        moved = [mode.reshape(-1, 2) for mode in self.motions.T]
        jumps = [edges.jumps(mode) for mode in moved]
        # (2 b, j) the work of tractions that are one at an end of an edge and zero at the other.
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
                "error_bound: no friction and pressure that are linear on edges balance the load on a body that "
                "nothing else holds; there is no bound for that. Refine the mesh, or add a support."
            )
        acts = np.stack(acting)[:, :, None]
        return found.reshape(-1, 2), np.where(acts, pressure.reshape(p.shape), 0.0)


def free_alone(P: sp.csr_matrix | sp.csc_matrix) -> Floats:
    """(nodes, 2, 2) projectors on the directions in which nodes move by themselves, by orthonormal columns P of all.

    In the blocks of P P' on its diagonal these have the value one.
    """
    moved = sp.csr_matrix(P @ P.T).tocoo()
    near, blocks = moved.row // 2 == moved.col // 2, np.zeros((P.shape[0] // 2, 2, 2))
    blocks[moved.row[near] // 2, moved.row[near] % 2, moved.col[near] % 2] = moved.data[near]
    values, vectors = np.linalg.eigh(blocks)
    alone: Floats = np.einsum("nik,nk,njk->nij", vectors, values > 1.0 - SAME, vectors)
    return alone
