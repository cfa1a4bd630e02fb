"""The surface of a body at an instant: what holds it, what loads it, and tractions that friction and contact admit.

The effects of the scene are asked on the boundary's edges cut into pieces (:mod:`vemcvx.bound.data_oscillation`).
Data are read at the ends of the pieces and taken for linear between them; loads at three Gauss points a piece.

With s the slip of v since the step before, q the friction (against s, so that tau_t = -q) and g its bound, z = v_n -
gap the depth, p the pressure and k the stiffness of a compliant obstacle, any |q| <= g and p >= 0 will do, and the
multipliers of the answer give them: q = theta g and p with theta and p linear between the ends of edges, where they
are force over length, clipped. What v and these lack of the laws of friction and contact is the sum of

    int g |s| - q s,        int -p z  (z <= 0),        int k z_+^2 / 2 + p^2 / (2 k) - p z,

each >= 0. On a piece where s changes its sign |s| is not linear; the line between its ends is above it (likewise z_+).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, ROUNDING, SAME, Bools, Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.bound.data_oscillation import DataOscillation, FineBoundary
from vemcvx.bound.skeleton import Instant, Skeleton, at_ends
from vemcvx.effects import Friction, Load, Obstacle
from vemcvx.meshes.polygons import positions, spans
from vemcvx.program.kernel import balanced
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.rows import ContactRows
from vemcvx.vem import tangents_of

GAUSS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(3)


def products(a: Floats, b: Floats) -> Floats:
    """(k,) the mean of the product of two functions (k, 2) that are linear on pieces, known at their ends."""
    mean: Floats = (2.0 * a[:, 0] * b[:, 0] + a[:, 0] * b[:, 1] + a[:, 1] * b[:, 0] + 2.0 * a[:, 1] * b[:, 1]) / 6.0
    return mean


@dataclass(frozen=True, eq=False)
class Surface:
    """The forces on the boundary edges (b,) at an instant, and the laws of friction and contact there."""

    loads: Floats
    """(b, 3, 2) int t phi of loads, phi being linear from either end, and the parabola 4 s (1 - s)"""
    forces: Floats
    """(b, 2, 2) int t phi at both ends, of loads, friction and pressure"""
    acting: Floats
    """(k, 3, 2) all these at the Gauss points of pieces"""
    cost: Floats
    """(b,) int g |s| + k z_+^2 / 2: what v pays for friction, and stores in obstacles"""
    gap: Floats
    """(b,) what v and the tractions lack of the laws of friction and contact"""
    laws: Floats
    """(2, k, 2) g and q at the ends of pieces, g being zero where nothing rubs"""
    slip: Floats
    """(k, 2) s"""


@dataclass(frozen=True, eq=False)
class Boundary:
    """The boundary of a posed scene."""

    posed: PosedScene
    edges: Skeleton
    oscillation: DataOscillation

    @property
    def fine(self) -> FineBoundary:
        """The boundary cut into pieces."""
        return self.oscillation.fine

    @cached_property
    def _along(self) -> Floats:
        """(k, 2) where pieces begin and end on their edges, in [0, 1]."""
        pieces, along = self.fine.pieces, self.fine.along
        new = np.maximum(pieces - self.fine.old, 0)
        return np.where(pieces >= self.fine.old, along[new], [0.0, 1.0])

    @cached_property
    def lengths(self) -> Floats:
        """(k,) of the pieces."""
        lengths: Floats = self.edges.lengths[self.fine.piece_owner] * np.diff(self._along, axis=1)[:, 0]
        return lengths

    def _prescribed(self, joined: bool) -> Floats:
        """(b, 2, 2) projectors on what supports prescribe on edges: motions, or jumps to another body."""
        squares = np.zeros((len(self.edges.outer), 2, 2))
        for support in (support for part in self.oscillation.parts for support in part.supports):
            jumps = False if support.partners is None else support.partners >= 0
            new = (support.nodes >= self.fine.old) & (jumps == joined)
            d, owner = support.directions[new], self.fine.owner[support.nodes[new] - self.fine.old]
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
        """(b,) the edges of frictions, and of obstacles."""
        found = np.zeros((2, len(self.edges.outer)), dtype=bool)
        for part in self.oscillation.parts:
            rows: tuple[Friction | Obstacle, ...] = (*part.frictions, *part.obstacles)
            for one in rows:
                found[int(isinstance(one, Obstacle)), self.fine.piece_owner[self._pieces(one)[0]]] = True
        return found[0], found[1]

    @cached_property
    def acting(self) -> tuple[Bools, Bools]:
        """(b,) the edges on which friction, and obstacles, may act, also those that assembled as zero."""
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
        owner, k, count = self.fine.owner, self.oscillation.springs, len(self.edges.outer)
        mean = np.zeros((count, 2, 2))
        np.add.at(mean, owner, k / np.bincount(owner)[owner, None, None])
        if np.abs(k - mean[owner]).max(initial=0.0) > SAME * np.abs(k).max(initial=0.0):
            raise SceneError(
                "error_bound: there is no bound for springs (ElasticFoundation) whose stiffness varies along an edge; "
                "give one number for each part of the boundary."
            )
        mass = self.edges.lengths[:, None, None] * np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0
        springs: Floats = np.einsum("bij,bkl->bikjl", mass, mean)
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

    def check_supports(self, now: Instant) -> None:
        """Raise SceneError where nodal values do not follow supports along edges."""
        ends, jumps = now.u[self.edges.outer_edges], self.edges.jumps(now.u)
        size = float(np.abs(now.u).max(initial=0.0))
        for support in (support for part in self.oscillation.parts for support in part.supports):
            new = support.nodes >= self.fine.old
            at, moved = support.nodes[new] - self.fine.old, ends if support.partners is None else jumps
            wanted = np.zeros(len(at)) if support.value is None else np.asarray(support.value(now.t))[new]
            apart = np.einsum("qd,qd->q", support.directions[new], self.fine.between(moved, at)) - wanted
            if (worst := np.abs(apart).max(initial=0.0)) > SAME * max(size, np.abs(wanted).max(initial=0.0)):
                raise SceneError(
                    f"error_bound: {support.subject} moves the boundary by {worst:.3g} otherwise than linearly "
                    "between nodes; there is no bound for such supports. Prescribe what is linear on edges, or give "
                    "tractions."
                )

    def _pieces(self, rows: Friction | Obstacle) -> tuple[Ints, Ints, Ints]:
        """The pieces, their ends, and the rows of effects there."""
        if rows.ends is None:
            raise SceneError(
                f"error_bound: there is no bound for {rows.subject}, which does not say on which edges it acts: "
                "effects of one's own say it by ends= of their Friction or Obstacle."
            )
        names = np.column_stack([rows.nodes[rows.ends.row], rows.ends.beyond])
        piece = positions(names, self.fine.pieces, self.fine.mesh.n_nodes)
        return piece, (names[:, 0] != self.fine.pieces[piece, 0]).astype(int), rows.ends.row

    def _read(self, rows: Friction | Obstacle, values: Floats) -> Floats:
        """(k, 2) values (m,) of rows at the ends of pieces; nan elsewhere."""
        found = np.full(self.fine.pieces.shape, np.nan)
        piece, end, row = self._pieces(rows)
        found[piece, end] = values[row]
        return found

    def _line(self, ends: Floats) -> Floats:
        """(k, 2) at the ends of pieces what is linear between values (b, 2) at the ends of edges."""
        start, stop = ends[self.fine.piece_owner].T[:, :, None]
        line: Floats = (1.0 - self._along) * start + self._along * stop
        return line

    def integrals(self, means: Floats) -> Floats:
        """(b,) integrals over edges of what has these means (k,) on pieces."""
        return totals(self.fine.piece_owner, self.lengths * means, len(self.edges.outer))

    def _at_ends(self, rows: ContactRows, values: Floats) -> Floats:
        """(b, 2, j) values (m, j) of rows at the ends of edges; where supports hold one end, as at the other."""
        both = at_ends(self.edges, rows, np.column_stack([values, np.ones(len(values))]))
        return np.where(both[..., -1:] > 0, both, both[:, ::-1])[..., :-1]

    def at(self, now: Instant, before: Instant, body: Floats) -> Surface:
        """The surface at the end of a step that began `before`; `body` (j,) is the work of body forces on `motions`.

        Raises
        ------
        SceneError
            Something has no bound.
        """
        owner, traction = self.fine.piece_owner, self.tractions(now.t, self.gauss)
        g, slip, loads = self._friction_bound(now), self._slip(now, before), self.moments(traction)
        theta, presses = self._theta(now, g), [self._pressing(now, compliant) for compliant in (False, True)]
        if self.motions.shape[1]:
            theta, presses = self._balanced(theta, presses, g, loads[:, :2], body)
        q = self._line(theta) * g
        paid = products(g, np.abs(slip))
        rigid, soft = (self._line(press.ends) for press in presses)
        lacking = presses[0].lacking(rigid) + presses[1].lacking(soft)
        along, outward = self.edges.tangents[owner, None], self.edges.units[owner, None]
        contact = q[..., None] * along + (rigid + soft)[..., None] * outward
        second, first = self._opposite
        contact[second] -= contact[first][:, ::-1]
        within = 0.5 + 0.5 * GAUSS[:, None]
        acting = traction - (1.0 - within) * contact[:, :1] - within * contact[:, 1:]
        return Surface(
            loads=loads,
            forces=self.moments(acting)[:, :2],
            acting=acting,
            cost=self.integrals(paid + presses[1].stored),
            gap=np.maximum(self.integrals(paid - products(q, slip) + lacking), 0.0),
            laws=np.stack([g, q]),
            slip=slip,
        )

    def lacking(self, before: Surface, now: Surface) -> float:
        """D, what friction and slip lack of their law between two instants, linear in time: >= 0."""
        g, q = 0.5 * (before.laws + now.laws)
        means = products(g, np.abs(now.slip)) - products(q, now.slip)
        return max(float(self.integrals(means).sum()), 0.0)

    def missed(self, traction: Floats) -> tuple[Floats, Floats]:
        """int |t - t_2|^2 (b,) of tractions t (k, 3, 2), t_2 being quadratic on edges, with the same moments.

        Besides, (b, 2) |e| times the coefficients of 1 - 6 s (1 - s) in t_2. Differences that are rounding count as
        zero.
        """
        moments, owner, lengths = self.moments(traction), self.fine.piece_owner, self.edges.lengths[:, None]
        # The mean square of 1 - 6 s (1 - s) is 1/5.
        bent = 5.0 * (moments[:, :2].sum(axis=1) - 1.5 * moments[:, 2])
        rounding = ROUNDING * np.abs(traction).max(initial=0.0)
        bent[np.abs(bent) <= rounding * lengths] = 0.0
        tips = (4.0 * moments[:, :2] - 2.0 * moments[:, 1::-1]) / lengths[..., None]
        s, mean = self.gauss[..., None], (bent / lengths)[owner, None]
        rest = traction - (1.0 - s) * tips[owner, :1] - s * tips[owner, 1:] - (1.0 - 6.0 * s * (1.0 - s)) * mean
        rest[np.abs(rest) <= rounding] = 0.0
        # On m pieces three points lack the part m^-6 of the square of what quadratic functions leave of a cubic one.
        seen = 1.0 - np.bincount(owner) ** -6.0
        return totals(owner, np.einsum("kq,kqd,kqd->k", self._weights, rest, rest), len(bent)) / seen, bent

    @cached_property
    def _opposite(self) -> tuple[Ints, Ints]:
        """The pieces of second bodies at interfaces, and those of first ones in the same places, which run back."""
        counts = np.bincount(self.fine.piece_owner)
        start, joints = np.cumsum(counts) - counts, self.edges.joints
        second = spans(start[joints.second], counts[joints.second])
        place = second - np.repeat(start[joints.second], counts[joints.second])
        return second, np.repeat((start + counts - 1)[joints.first], counts[joints.first]) - place

    # Loads.

    @cached_property
    def gauss(self) -> Floats:
        """(k, 3) where Gauss points are on their edges."""
        return self.rule(GAUSS, GAUSS_WEIGHTS)[0]

    @cached_property
    def _weights(self) -> Floats:
        return self.rule(GAUSS, GAUSS_WEIGHTS)[1]

    def rule(self, points: Floats, weights: Floats) -> tuple[Floats, Floats]:
        """(k, q) where the points in [-1, 1] of a rule are on edges, and their weights on pieces."""
        places: Floats = self._along.mean(axis=1)[:, None] + 0.5 * np.diff(self._along, axis=1) * points
        return places, 0.5 * self.lengths[:, None] * weights

    def moments(self, traction: Floats) -> Floats:
        """(b, 3, 2) int t phi of tractions (k, 3, 2), phi being linear from either end, and the parabola."""
        return self.works(self.gauss, self._weights, traction)

    def works(self, s: Floats, weights: Floats, traction: Floats) -> Floats:
        """The same by any rule, with places and weights (k, q) of tractions (k, q, 2)."""
        found = np.zeros((len(self.edges.outer), 3, 2))
        for place, phi in enumerate((1.0 - s, s, 4.0 * s * (1.0 - s))):
            np.add.at(found[:, place], self.fine.piece_owner, np.einsum("kq,kqd->kd", weights * phi, traction))
        return found

    def tractions(self, t: float, s: Floats) -> Floats:
        """(k, q, 2) tractions of loads at places (k, q) of edges."""
        owner = self.fine.piece_owner
        start, stop = self.posed.space.mesh.points[self.edges.outer_edges[owner]].swapaxes(0, 1)
        x = start[:, None] + s[..., None] * (stop - start)[:, None]
        traction = np.zeros(x.shape)
        for load in (load for part in self.oscillation.parts for load in part.loads):
            if load.edges is not None:
                piece, factor = self._factors(load)
                values = load.at(x[piece].reshape(-1, 2), t).reshape(len(piece), x.shape[1], -1)
                traction[piece] += np.einsum("kdc,kqc->kqd", factor, values)
        return traction

    def _factors(self, load: Load) -> tuple[Ints, Floats]:
        """The pieces (k,) of a load, and the matrices (k, 2, j) by which its datum is a force per length."""
        assert load.edges is not None
        entries, width = load.matrix.tocoo(), load.matrix.shape[1] // len(load.points)
        where = positions(load.edges, self.fine.pieces, self.fine.mesh.n_nodes)
        piece, place = np.unique(where, return_inverse=True)
        sums = np.zeros((len(piece), 2, width))
        np.add.at(sums, (place[entries.col // width], entries.row % 2, entries.col % width), entries.data)
        return piece, sums / self.lengths[piece, None, None]

    # Friction.

    def _friction_bound(self, now: Instant) -> Floats:
        """Return the bound g (k, 2) of friction at the ends of pieces."""
        terms, g = self.posed.terms, np.zeros(self.fine.pieces.shape)
        for friction in self.frictions:
            g += np.nan_to_num(self._read(friction, friction.weights(now.t) / friction.lengths))
        if any(friction.law is not None for friction in self.frictions):
            # Bounds that follow the pressure are those of the answer, linear between nodes.
            g = self._line(self._at_ends(terms, (now.weights / terms.lengths)[:, None])[..., 0])
        return np.where(self._moves(self.edges.tangents)[self.fine.piece_owner, None], g, 0.0)

    def _slip(self, now: Instant, before: Instant) -> Floats:
        """(k, 2) the slip in a step at the ends of pieces, less what the ground moves by."""
        moved = np.zeros(self.fine.pieces.shape)
        for friction in self.frictions:
            if friction.ground is not None:
                along = friction.ground.vector(now.t) - friction.ground.vector(before.t)
                way = self._read(friction, np.einsum("md,md->m", along, tangents_of(friction.normals)[:, 0]))
                # Frictions that share an edge share their ground: it moves once.
                moved = np.where(np.isfinite(way), way, moved)
        return self._along_edges(self.edges.jumps(now.u - before.u), self.edges.tangents) - moved

    @property
    def frictions(self) -> list[Friction]:
        """The frictions of all effects, also of those that are zero."""
        return [friction for part in self.oscillation.parts for friction in part.frictions]

    def _along_edges(self, ends: Floats, ways: Floats) -> Floats:
        """(k, 2) at the ends of pieces the components of motions (b, 2, 2) of the ends of edges along ways (b, 2)."""
        return self._line(np.einsum("bed,bd->be", ends, ways))

    def _theta(self, now: Instant, g: Floats) -> Floats:
        """theta (b, 2) at the ends of edges, by the multipliers."""
        terms = self.posed.terms
        against = self._at_ends(terms, now.lam / terms.lengths[:, None] * terms.tangents[:, 0])
        ends, bound = np.einsum("bed,bd->be", against, self.edges.tangents), self._tips(g)
        theta = np.divide(ends, bound, out=np.zeros_like(ends), where=bound > 0.0)
        clipped: Floats = np.clip(np.where(bound > 0.0, theta, theta[:, ::-1]), -1.0, 1.0)
        return clipped

    # The balance of bodies that nothing else holds.

    @cached_property
    def motions(self) -> Floats:
        """(n_u, j) of bodies that only friction and one-sided contact hold."""
        kernel, P = self.posed.system.kernel, self.posed.supports.P
        return np.zeros((P.shape[0], 0)) if kernel is None else np.asarray(P @ kernel.basis)

    def _balanced(
        self, theta: Floats, presses: list[_Pressing], bound: Floats, loads: Floats, body: Floats
    ) -> tuple[Floats, list[_Pressing]]:
        """The nearest theta and pressures that balance the loads (b, 2, 2) on these motions.

        Nodal multipliers do, but tractions linear between nodes have other moments.
        """
        count = len(self.edges.outer)
        moved = [mode.reshape(-1, 2) for mode in self.motions.T]
        along, outward = (
            [self._along_edges(self.edges.jumps(mode), way) for mode in moved]
            for way in (self.edges.tangents, self.edges.units)
        )
        hats = 1.0 - self._along, self._along

        def felt(ways: list[Floats], weight: Floats | float) -> Floats:
            """(2 b, j) the work of hats of both ends."""
            works = [[self.integrals(products(hat * weight, way)) for way in ways] for hat in hats]
            return np.moveaxis(np.array(works), (0, 1), (1, 2)).reshape(2 * count, len(ways))

        push = body + np.array([np.sum(loads * mode[self.edges.outer_edges]) for mode in moved])
        acting = [press.acts for press in presses]
        H = np.concatenate([felt(outward, 1.0) * np.repeat(acts, 2)[:, None] for acts in acting])
        G = felt(along, bound)
        length, mean = np.repeat(self.edges.lengths, 2), self.integrals(bound.mean(axis=1)) / self.edges.lengths
        g = np.repeat(np.where(mean > 0.0, mean, 1.0), 2)
        p = np.concatenate([press.ends.ravel() for press in presses])
        modes, weights = np.concatenate([G, H]), (1.0 / (length * g**2), 1.0 / np.tile(length, 2))
        found, pressure = balanced((theta.reshape(-1, 1), p), np.ones(2 * count), modes, push, weights)
        left = push - np.append(found, pressure) @ modes
        if np.abs(left).max() > SAME * max(np.abs(push).max(), np.abs(p @ H).max(), np.abs(theta.ravel() @ G).max()):
            raise SceneError(
                "error_bound: no friction and pressure that are linear on edges balance the load on a body that "
                "nothing else holds; there is no bound for that. Refine the mesh, or add a support."
            )
        rigid, soft = pressure.reshape(2, count, 2)
        ends_of = [np.where(acts[:, None], ends, 0.0) for acts, ends in zip(acting, (rigid, soft), strict=True)]
        return found.reshape(-1, 2), [replace(press, ends=e) for press, e in zip(presses, ends_of, strict=True)]

    def _tips(self, values: Floats) -> Floats:
        """(b, 2) at the ends of edges, of values (k, 2) at those of pieces."""
        found = np.zeros((len(self.edges.outer), 2))
        for end in range(2):
            first = np.flatnonzero(self._along[:, end] == end)
            found[self.fine.piece_owner[first], end] = values[first, end]
        return found

    # Obstacles.

    def _pressing(self, now: Instant, compliant: bool) -> _Pressing:
        """The pressure of obstacles, rigid or compliant, by the multipliers."""
        obstacles, count = self.posed.obstacles, len(self.edges.outer)
        mine = (obstacles.compliance > 0) == compliant
        ends = self._at_ends(obstacles[np.flatnonzero(mine)], (now.p / obstacles.lengths)[mine, None])
        z, k = self._depths(now.u, now.t, compliant)
        acts = np.asarray(np.isfinite(z).all(axis=1))
        on = np.zeros(count, dtype=bool)
        on[self.fine.piece_owner[acts]] = True
        return _Pressing(
            ends=np.where(on[:, None], np.maximum(ends[..., 0], 0.0), 0.0),
            acts=on,
            depth=np.where(acts[:, None], z, 0.0),
            stiffness=np.where(acts[:, None], k, 1.0) if compliant else None,
        )

    def _depths(self, u: Floats, t: float, compliant: bool) -> tuple[Floats, Floats]:
        """The depths (k, 2) of a displacement in obstacles, -inf where there is none, and the stiffness of these."""
        distance, stiffness = (np.full(self.fine.pieces.shape, value) for value in (np.inf, 0.0))
        asked = [obstacle for part in self.oscillation.parts for obstacle in part.obstacles]
        for obstacle in (one for one in asked if (one.compliance > 0).any() == compliant):
            read = self._read(obstacle, obstacle.gap(t))
            known = np.isfinite(read)
            if compliant and (stiffness[known] > 0).any():
                raise SceneError(
                    f"error_bound: there is no bound where {obstacle.subject} and another compliant obstacle share an "
                    "edge; give each its own part of the boundary, or one NormalCompliance for both."
                )
            distance[known] = np.minimum(distance[known], read[known])
            if compliant:
                stiffness[known] = self._read(obstacle, 1.0 / (obstacle.compliance * obstacle.lengths))[known]
        distance[~self._moves(self.edges.units)[self.fine.piece_owner]] = np.inf
        return self._along_edges(self.edges.jumps(u), self.edges.units) - distance, stiffness

    def admitted(self, u: Floats, t: float) -> Floats:
        """The displacement (n_nodes, 2), moved back where it goes beyond rigid obstacles.

        The ends of an edge go back, as far as nothing holds them, until it is nowhere beyond. At corners two edges move
        a node, and in turn.
        """
        ends, units, owner = self.edges.outer_edges, self.edges.units, self.fine.piece_owner
        size = float(np.abs(u).max(initial=0.0)) + EPS * float(np.abs(self.posed.space.mesh.points).max())
        along = np.einsum("beij,bj->bei", free_alone(self.posed.supports.P)[ends], units)
        outward = np.einsum("bei,bi->be", along, units)
        free = outward > SAME
        along = np.divide(along, outward[..., None], out=np.zeros_like(along), where=free[..., None])
        share = self._line(free.astype(float))
        for _ in range(16):
            beyond, depth = np.zeros(len(ends)), self._depths(u, t, False)[0]
            # To be beyond by rounding is no more than data are uncertain by.
            if depth.max(initial=-np.inf) <= 64.0 * EPS * size:
                return u
            back = np.divide(np.maximum(depth, 0.0), share, out=np.zeros_like(depth), where=share > 0.0)
            np.maximum.at(beyond, owner, back.max(axis=1))
            ways = np.zeros((2, *u.shape))
            # The two edges of a node, by their first and by their last end; the longer way counts for both.
            for end in range(2):
                ways[end, ends[:, end]] = beyond[:, None] * along[:, end]
            longer = np.linalg.norm(ways[0], axis=1) >= np.linalg.norm(ways[1], axis=1)
            u = u - np.where(longer[:, None], ways[0], ways[1])
        raise SceneError(
            "error_bound: supports press the body into an obstacle, or nodes at a corner cannot be moved back from two "
            "of them: no displacement is at hand that is admissible, and there is no bound. Give the obstacle a gap of "
            "zero or more next to supports, or refine the mesh at the corner."
        )


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


@dataclass(frozen=True, eq=False)
class _Pressing:
    """The pressure of rigid or of compliant obstacles."""

    ends: Floats
    """(b, 2) p at the ends of edges"""
    acts: Bools
    """(b,) on which edges"""
    depth: Floats
    """(k, 2) z at the ends of pieces"""
    stiffness: Floats | None
    """(k, 2) k; None of rigid ones"""

    @property
    def stored(self) -> Floats:
        """(k,) the mean of k z_+^2 / 2 on pieces, of compliant ones."""
        assert self.stiffness is not None
        into = np.maximum(self.depth, 0.0)
        stored: Floats = 0.5 * self.stiffness.max(axis=1) * products(into, into)
        return stored

    def lacking(self, p: Floats) -> Floats:
        """(k,) the mean of what the law lacks on pieces where pressures are p (k, 2)."""
        if self.stiffness is None:
            return products(p, np.maximum(-self.depth, 0.0))
        lacking: Floats = self.stored + 0.5 * products(p, p) / self.stiffness.min(axis=1) - products(p, self.depth)
        return lacking
