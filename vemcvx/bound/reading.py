"""Data as bounds read them: loads and bounds of friction that are linear on edges and in cells, and what is left.

Tractions are fitted by linear functions on every edge, from their means on pieces of it; bounds of friction likewise,
from their values there; body forces by linear functions in every cell, from values at the points of
:mod:`vemcvx.bound.data_oscillation`. Gaps and motions of the ground are linear between nodes. For such data bounds are
theorems. For others they are theorems for the data *as read*, and what is left of the data is estimated: e(w), the work
of loads that is not read on a displacement w, by

    SAFETY times what a second reading of fewer points gives otherwise: works on w, or the answer of the body to it;
    what is left beside the linear functions: by the energies of :mod:`vemcvx.bound.data_oscillation`, cell by cell.

Answers are no farther apart than eta = sup e(w) / |w|, also with friction and contact, and what a step minimises no
farther than |e(v)| + eta |u - v| + eta^2 / 2. What is narrower than the distance of the points may be missed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Floats, Ints, totals
from vemcvx.bound.data_oscillation import POINCARE, SPACING, DataOscillation, SamplePoints, in_cells
from vemcvx.bound.fan import FORCES, Fans
from vemcvx.bound.skeleton import Instant
from vemcvx.meshes import plane_mesh

SAFETY = 2.0
"""What two readings differ by is taken for so many times as large."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Least squares, part by part, of values at points."""

    owner: Ints
    """(q,) the part of each point"""
    basis: Floats
    """(q, j) functions there"""
    weights: Floats
    """(q,)"""
    count: int
    """of parts"""

    @cached_property
    def matrix(self) -> sp.csr_matrix:
        """(count * j, q) coefficients from values."""
        q, j = self.basis.shape
        gram = np.zeros((self.count, j, j))
        np.add.at(gram, self.owner, self.weights[:, None, None] * self.basis[:, :, None] * self.basis[:, None])
        gram[np.bincount(self.owner, self.weights, self.count) == 0.0] = np.eye(j)
        entries = np.einsum("qij,qj->qi", np.linalg.inv(gram)[self.owner], self.basis) * self.weights[:, None]
        rows = self.owner[:, None] * j + np.arange(j)
        return sp.csr_matrix((entries.ravel(), (rows.ravel(), np.repeat(np.arange(q), j))), shape=(self.count * j, q))

    def of(self, values: Floats) -> Floats:
        """(count, j, d) the coefficients of values (q, d)."""
        return np.asarray(self.matrix @ values).reshape(self.count, self.basis.shape[1], -1)

    def at_points(self, coefficients: Floats) -> Floats:
        """(q, d) the values of coefficients (count, j, d) at the points."""
        values: Floats = np.einsum("qj,qjd->qd", self.basis, coefficients[self.owner])
        return values

    @cached_property
    def of_every_other(self) -> Fit:
        """The fit that every other point counts three times in: of these alone it would differ twice as much."""
        return replace(self, weights=np.where(np.arange(len(self.owner)) % 2 == 0, 1.5, 0.5) * self.weights)

    def read(self, values: Floats) -> tuple[Floats, Floats, Floats]:
        """Coefficients, by how much those of every other point differ, and what is left (q, d); rounding is zero."""
        found = self.of(values)
        apart, left = 2.0 * (self.of_every_other.of(values) - found), values - self.at_points(found)
        return found, *_without_rounding(values, apart, left)


@dataclass(frozen=True, eq=False)
class Reading:
    """The data at an instant."""

    reader: Reader
    tractions: Floats
    """(b, 2, 2) at the ends of edges"""
    friction: Floats
    """(b, 2) bounds of friction there, where they are given"""
    body: Floats
    """(n_cells, 6) of body forces that are linear in cells, as :class:`.fan.Fans` has them"""
    tractions_apart: Floats
    body_apart: Floats
    """by how much a second reading differs"""
    on_pieces: Floats
    """(k, 2) what is left of tractions"""
    in_cells: Floats
    """(q, 2) and of body forces"""
    others: Floats
    """(n_cells,) energies of what is left of bounds of friction, gaps and motions of the ground"""

    @property
    def exact(self) -> bool:
        """True where data are linear as far as points tell."""
        left = self.tractions_apart, self.body_apart, self.on_pieces, self.in_cells, self.others
        return not any(one.any() for one in left)

    def __sub__(self, other: Reading) -> Reading:
        """The part that is new since another instant."""
        names = "tractions", "friction", "body", "tractions_apart", "body_apart", "on_pieces", "in_cells"
        new = {name: getattr(self, name) - getattr(other, name) for name in names}
        return replace(self, **new, others=np.abs(self.others - other.others))

    @cached_property
    def local(self) -> Floats:
        """(n_cells,) energies of what is left in cells and on their edges."""
        oscillation, fine = self.reader.oscillation, self.reader.oscillation.fine
        edges, inside = oscillation.edges, oscillation.inside
        n, lengths = len(edges.areas), self.reader.pieces.weights
        in_cells = np.zeros(n)
        if len(self.in_cells):
            in_cells = totals(inside.owner, inside.weights * np.sum(self.in_cells**2, axis=1), n)
        on_edges = totals(fine.piece_owner, lengths * np.sum(self.on_pieces**2, axis=1), len(edges.outer))
        # What is orthogonal to linear functions has half of the constants of what is so to constants alone.
        in_cells *= 0.5 * POINCARE * edges.sizes**2 / edges.shear
        return in_cells + totals(edges.outer, 0.5 * oscillation.compliances * on_edges, n) + self.others

    @property
    def energy(self) -> float:
        """eta."""
        if self.exact:
            return 0.0
        edges, oscillation = self.reader.oscillation.edges, self.reader.oscillation
        on_edges = edges.lengths[:, None] * self.tractions_apart.mean(axis=1)
        apart = oscillation.of_the_body(on_edges, self.reader.totals_of(self.body_apart))
        return float(np.sqrt(self.local.sum()) + SAFETY * np.sqrt(apart.sum()))


@dataclass(frozen=True, eq=False)
class Reader:
    """The points of a mesh at which loads are read."""

    oscillation: DataOscillation
    fans: tuple[Fans, ...]

    @cached_property
    def pieces(self) -> Fit:
        """Of the means on pieces of boundary edges, by functions that are linear from either end."""
        fine, lengths = self.oscillation.fine, self.oscillation.edges.lengths
        counts = np.bincount(fine.piece_owner)
        place = np.arange(len(fine.piece_owner)) - (np.cumsum(counts) - counts)[fine.piece_owner]
        s = (place + 0.5) / counts[fine.piece_owner]
        weights = (lengths / counts)[fine.piece_owner]
        return Fit(fine.piece_owner, np.column_stack([1.0 - s, s]), weights, len(lengths))

    @cached_property
    def nodes(self) -> Fit:
        """Of values at new nodes of boundary edges."""
        fine = self.oscillation.fine
        return Fit(
            fine.owner, np.column_stack([1.0 - fine.along, fine.along]), fine.lengths, len(self.oscillation.edges.outer)
        )

    @cached_property
    def _scales(self) -> Floats:
        """(n_cells, 3) by which coefficients about the centres of fans are those of scaled coordinates."""
        h = np.sqrt(self.oscillation.edges.areas)
        return np.column_stack([np.ones(len(h)), 1.0 / h, 1.0 / h])

    @cached_property
    def cells(self) -> Fit:
        """Of values at points of cells."""
        return self._about_centres(self.oscillation.inside)

    @cached_property
    def _coarse(self) -> tuple[SamplePoints, Fit]:
        """Fewer points of cells, for a second reading, and their fit."""
        mesh = plane_mesh(self.oscillation.posed.space.mesh, "error_bound")
        inside = in_cells(mesh, 0.75 * SPACING)
        return inside, self._about_centres(inside)

    def _about_centres(self, inside: SamplePoints) -> Fit:
        centres = np.zeros((len(self._scales), 2))
        for fans in self.fans:
            centres[fans.cells] = fans.centres
        about = (inside.x - centres[inside.owner]) * self._scales[inside.owner, 1:]
        return Fit(inside.owner, np.column_stack([np.ones(len(about)), about]), inside.weights, len(centres))

    def totals_of(self, body: Floats) -> Floats:
        """(n_cells, 2) the force of a body force (n_cells, 6) in each cell."""
        forces = np.zeros((len(body), 2))
        for fans in self.fans:
            each = np.einsum("ctij,cj->cti", fans.of_cells(fans.shapes.forces), body[fans.cells])
            forces[fans.cells] = each.reshape(*each.shape[:2], 3, 2).sum(axis=(1, 2))
        return forces

    def body(self, t: float) -> tuple[Floats, Floats, Floats]:
        """Body forces (n_cells, 6), how a second reading differs, and what is left of them (q, 2) at the points."""
        loads, count = self.oscillation.body_loads, len(self._scales)
        if not loads:
            return np.zeros((count, FORCES)), np.zeros((count, FORCES)), np.zeros((0, 2))
        inside, (coarse, fit) = self.oscillation.inside, self._coarse
        f, second = (np.sum([load.at(x, t) for load in loads], axis=0) for x in (inside.x, coarse.x))
        found = self.cells.of(f)
        apart, left = _without_rounding(f, fit.of(second) - found, f - self.cells.at_points(found))
        body, body_apart = ((one * self._scales[..., None]).reshape(count, FORCES) for one in (found, apart))
        return body, body_apart, left

    def at(self, now: Instant) -> Reading:
        """The data at an instant."""
        tractions, apart, on_pieces = self.pieces.read(self.oscillation.on_pieces(now.t))
        body, body_apart, in_cells = self.body(now.t)
        friction, others = self._friction(now)
        return Reading(
            reader=self,
            tractions=tractions,
            friction=friction,
            body=body,
            tractions_apart=apart,
            body_apart=body_apart,
            on_pieces=on_pieces,
            in_cells=in_cells,
            others=others,
        )

    def _friction(self, now: Instant) -> tuple[Floats, Floats]:
        """Bounds of friction (b, 2) at the ends of edges, and the energies (n_cells,) of what else is not linear."""
        oscillation, fine = self.oscillation, self.oscillation.fine
        g, squares = np.zeros((len(fine.owner), 1)), np.zeros(len(oscillation.edges.outer))
        for friction in oscillation.frictions:
            if friction.law is None:
                at, bound, _ = fine.read(friction, (friction.weights(now.t) / friction.lengths)[:, None])
                g[at] += bound
            if friction.ground is not None:
                at, moved, line = fine.read(friction, friction.ground.vector(now.t))
                squares += oscillation.of_motion(at, moved - line)
        for obstacle in oscillation.obstacles:
            _, gap, line = fine.read(obstacle, obstacle.gap(now.t)[:, None])
            squares += 0.0 if np.array_equal(gap, line) else oscillation.of_obstacle(obstacle, now)
        found, _, left = self.nodes.read(g)
        squares += 0.5 * oscillation.compliances * totals(fine.owner, fine.lengths * left[:, 0] ** 2, len(squares))
        return np.maximum(found[..., 0], 0.0), totals(oscillation.edges.outer, squares, len(self._scales))


def _without_rounding(values: Floats, apart: Floats, left: Floats) -> tuple[Floats, Floats]:
    """Differences of values, zero where they are rounding."""
    rounding = SAME * np.abs(values).max(initial=0.0)
    return np.where(np.abs(apart) <= rounding, 0.0, apart), np.where(np.abs(left) <= rounding, 0.0, left)


def misread(reading: Reading, works: Sequence[Floats], bent: Floats) -> float:
    """|e(w)| of w, by the works of what a second reading gives otherwise, and its energies (n_cells,) beside strains.

    What is left beside linear functions does no work on what is linear in a cell.
    """
    left = np.sum(np.sqrt(reading.local * np.maximum(bent, 0.0)))
    return float(SAFETY * sum(np.abs(one).sum() for one in works) + left)
