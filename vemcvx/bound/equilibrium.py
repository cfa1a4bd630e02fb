"""The stress of least energy in equilibrium with given forces: a hybrid method, its unknowns the motions of edges.

Among all stresses of the fans (:mod:`.stress`) that balance body forces, have the given tractions on free parts of the
boundary and go on from cell to cell, the one that minimises

    |tau|^2 / 2 in C^-1  -  int over held parts of  tau n . u_D  -  (tau, C^-1 sigma_0)

is that of edge motions m, linear on every edge and free to jump at vertices, for which the forces of both cells on
each edge cancel. Every cell answers to its m by G m + b (f): a stiffness matrix, positive definite up to rigid
motions, is added up over the cells, and solved with once a step (equilibrium elements of B. Fraeijs de Veubeke, 1965;
on the split triangle they have no spurious motions). The prestress sigma_0 acts as forces of the edges: tau - sigma_0
is what m strains. Sought is x = m - v, v being the displacement at hand: x is as small as the defect is, so that
rounding is a part of that, and one solve a step suffices where nothing floats.

So no local problem has to be found compatible, and no other stress of these fans is nearer to that of the body: of
tractions made vertex by vertex, bounds were up to a fifth larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, ROUNDING, SAME, Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.bound.fan import Fans
from vemcvx.bound.skeleton import Skeleton
from vemcvx.bound.stress import FanStress
from vemcvx.bound.surface import Boundary
from vemcvx.linear import Factor, choose_linear
from vemcvx.meshes import PolygonMesh
from vemcvx.vem.elasticity import assemble

HALF_DIGITS = float(np.sqrt(EPS))
"""Part of the largest force by which neighbours may differ (at lambda = 1e6 they do by 1e-9)."""


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of a mesh: each with both ends, that of the smaller node number first."""

    count: int
    places: tuple[Ints, ...]
    """of each chunk of cells (c, 4 n): where the motions of its edges stand among all, four an edge"""
    outer: Ints
    """(b, 2, 2) likewise those of boundary edges"""
    nodes: Ints
    """(E, 2) their ends"""

    def outline(self, u: Floats) -> Floats:
        """(2 nodes + 2 E,) a displacement (nodes, 2) at vertices and at middles of edges."""
        return np.concatenate([u, 0.5 * (u[self.nodes[:, 0]] + u[self.nodes[:, 1]])]).ravel()

    def motions(self, outline: Floats) -> Floats:
        """(4 E,) motions of edges on which linear tractions do the work that they do on values like these."""
        values = outline.reshape(-1, 2)
        vertices, middles = np.split(values, [len(values) - self.count])
        ends = vertices[self.nodes]
        motions: Floats = ends + ((middles - ends.mean(axis=1)) / 1.5)[:, None]
        return motions.ravel()


def edges_of(mesh: PolygonMesh, skeleton: Skeleton, fans: Sequence[Fans]) -> Edges:
    """The Edges of a mesh."""
    shared = mesh.shared_edges
    ends = np.argsort(skeleton.sides, axis=1)
    place = 4 * shared.number[:, None, None] + 2 * ends[:, :, None] + np.arange(2)
    of_fans = tuple(place[mesh.offsets[one.cells][:, None] + np.arange(one.n)].reshape(-1, 4 * one.n) for one in fans)
    return Edges(len(shared.first), of_fans, place[skeleton.outer_corners], shared.ends)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """The hybrid problem of a body, factorised."""

    edges: Edges
    stresses: tuple[FanStress, ...]
    P: sp.csr_matrix
    """(4 E, m) motions of all edges from those that are free"""
    springs: Floats
    """(b, 4, 4) of boundary edges"""
    factor: Factor

    def solve(self, given: Floats, largest: float) -> tuple[Floats, Floats]:
        """The free motions x (4 E,) whose forces, and those of springs, are the given ones (4 E,).

        And the squares (n_cells,) of the stresses that they make, x . G x; `largest` is a force of tractions, of which
        rounding is a part.

        Raises
        ------
        SceneError
            Rounding leaves forces of neighbours apart.
        """
        left, x, size, apart, before = given, np.zeros(len(given)), len(given), np.inf, np.inf
        # As long as corrections halve what is left: near nu = 1/2 a digit takes several.
        while ROUNDING * largest < apart <= 0.5 * before:
            before, x = apart, x + self.P @ self.factor.solve(self.P.T @ left)
            local = [x[place] for place in self.edges.places]
            forces = [one.fans.apply(one.stiffness, m) for one, m in zip(self.stresses, local, strict=True)]
            pull = np.einsum("bij,bj->bi", self.springs, x[self.edges.outer].reshape(-1, 4))
            left = given - gathered(self.edges.places, forces, size)
            left -= totals(self.edges.outer.ravel(), pull.ravel(), size)
            apart = float(np.abs(self.P.T @ left).max(initial=0.0))
        if apart > HALF_DIGITS * largest:
            raise SceneError(
                f"error_bound: rounding leaves forces of neighbouring cells {apart / largest:.1e} apart; a bound on "
                "stresses in equilibrium needs better conditioned data, such as a Poisson ratio farther from 1/2, or "
                "less contrast."
            )
        squares = np.zeros(sum(len(one.fans.cells) for one in self.stresses))
        for one, m, force in zip(self.stresses, local, forces, strict=True):
            squares[one.fans.cells] = np.einsum("ci,ci->c", m, force)
        return x, squares


def gathered(places: Sequence[Ints], values: Sequence[Floats], size: int) -> Floats:
    """(size,) the sum of values (c, m) of chunks of cells at places (c, m)."""
    where, what = (np.concatenate([one.ravel() for one in each]) for each in (places, values))
    return totals(where, what, size)


def equilibrium(edges: Edges, stresses: tuple[FanStress, ...], boundary: Boundary) -> Equilibrium:
    """The hybrid problem of what supports, springs and bonds on the boundary hold.

    A body that floats is anchored by a little of the diagonal; forces that balance then need a few corrections.
    """
    P = _free_motions(edges, boundary)
    K = _assembled(edges, stresses, boundary.springs, P)
    # With this much a correction leaves 1e-5 of the error on a body of a thousand cells.
    K = K + sp.diags_array(SAME * K.diagonal()) if boundary.motions.shape[1] else K
    return Equilibrium(edges, stresses, P, boundary.springs, choose_linear(K.shape[0]).factorise(K))


def _assembled(edges: Edges, stresses: Sequence[FanStress], springs: Floats, P: sp.csr_matrix) -> sp.csr_matrix:
    """P' G P: of cells inside the body as K is assembled, by ends of edges; P is a product on those at the boundary."""
    size = P.shape[0]
    inner = np.ones(size // 2, dtype=bool)
    inner[edges.outer[..., 0].ravel() // 2] = False
    number = np.cumsum(inner) - 1
    nodes, blocks, which, first = list[Ints](), list[Floats](), list[Ints](), 0
    rows, values = [edges.outer.reshape(-1, 4)], [springs]
    for one, place in zip(stresses, edges.places, strict=True):
        ends, same = place[:, ::2] // 2, one.fans.alike[1]
        within, m = inner[ends].all(axis=1), ends.shape[1]
        nodes.append(number[ends[within]])
        blocks.append(one.stiffness.reshape(-1, m, 2, m, 2).swapaxes(2, 3).reshape(-1, 4))
        which.append((first + m * m * same[within][:, None] + np.arange(m * m)).astype(np.int32).ravel())
        rows.append(place[~within])
        values.append(one.stiffness[same[~within]])
        first += len(blocks[-1])
    K = assemble(nodes, np.concatenate(blocks), np.concatenate(which), int(inner.sum()))
    count = P.shape[1]
    K = sp.csr_matrix((K.data, K.indices, np.pad(K.indptr, (0, count - K.shape[0]), mode="edge")), shape=(count, count))
    i, j = (
        np.concatenate([np.broadcast_to(np.expand_dims(at, axis), (*at.shape, at.shape[1])).ravel() for at in rows])
        for axis in (2, 1)
    )
    G = sp.csr_matrix((np.concatenate([one.ravel() for one in values]), (i, j)), shape=(size, size))
    return sp.csr_matrix(K + P.T @ G @ P)


def _free_motions(edges: Edges, boundary: Boundary) -> sp.csr_matrix:
    """(4 E, m) columns: all motions but those that are held."""
    inner, joints, own = np.ones(4 * edges.count, dtype=bool), boundary.edges.joints, boundary.free.copy()
    inner[edges.outer] = False
    alone = np.flatnonzero(inner)
    # Directions in which two edges move alike belong to both.
    for side in (joints.first, joints.second):
        own[side] -= boundary.bonds
    (one, axes), (joint, common) = _axes(own), _axes(boundary.bonds)
    first, second = edges.outer[joints.first[joint]], edges.outer[joints.second[joint], ::-1]
    rows = [alone, edges.outer[one].ravel(), first.ravel(), second.ravel()]
    entries = [np.ones(len(alone)), *(np.repeat(v, 2, axis=0).ravel() for v in (axes, common, common))]
    counts = len(alone), 2 * len(one), 2 * len(joint)
    single, of_own, of_both = np.split(np.arange(sum(counts)), np.cumsum(counts)[:2])
    columns = [single, *(np.repeat(each, 2) for each in (of_own, of_both, of_both))]
    shape = (len(inner), sum(counts))
    return sp.csr_matrix((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=shape)


def _axes(projectors: Floats) -> tuple[Ints, Floats]:
    """The projectors (b, 2, 2) that have axes, once each, and these (k, 2)."""
    values, vectors = np.linalg.eigh(projectors)
    which, axis = np.nonzero(values > 0.5)
    return which, vectors[which, :, axis]
