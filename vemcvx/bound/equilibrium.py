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
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, ROUNDING, SAME, Floats, Ints, totals
from vemcvx.base.errors import SceneError
from vemcvx.bound.fan import Fans, gathered
from vemcvx.bound.skeleton import Skeleton
from vemcvx.bound.surface import Boundary
from vemcvx.linear import Factor, choose_linear
from vemcvx.meshes import PolygonMesh

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

    @cached_property
    def motions(self) -> sp.csr_matrix:
        """(4 E, 2 nodes + 2 E) motions of edges on which linear tractions do the work that they do on such values."""
        vertices, edge = int(self.nodes.max()) + 1, np.arange(self.count)
        own, other, middle = self.nodes.ravel(), self.nodes[:, ::-1].ravel(), vertices + np.repeat(edge, 2)
        entries = np.repeat([2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0], len(own))
        places = np.tile(np.arange(len(own)), 3), np.concatenate([own, other, middle])
        ends = sp.csr_matrix((entries, places), shape=(len(own), vertices + self.count))
        return sp.csr_matrix(sp.kron(ends, sp.eye_array(2)))


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
    fans: tuple[Fans, ...]
    stiffness: tuple[Floats, ...]
    """(k, 4 n, 4 n) of each chunk of cells"""
    P: sp.csr_matrix
    """(4 E, m) motions of all edges from those that are free"""
    springs: Floats
    """(b, 4, 4) of boundary edges"""
    factor: Factor

    def solve(self, given: Floats, largest: float) -> Floats:
        """The free motions x (4 E,) whose forces, and those of springs, are the given ones (4 E,).

        `largest` is a force of tractions, of which rounding is a part.

        Raises
        ------
        SceneError
            Rounding leaves forces of neighbours apart.
        """
        left, x, apart, before = given, np.zeros(len(given)), np.inf, np.inf
        # As long as corrections halve what is left: near nu = 1/2 a digit takes several.
        while ROUNDING * largest < apart <= 0.5 * before:
            before, x = apart, x + self.P @ self.factor.solve(self.P.T @ left)
            left = given - self.forces(x)
            apart = float(np.abs(self.P.T @ left).max(initial=0.0))
        if apart > HALF_DIGITS * largest:
            raise SceneError(
                f"error_bound: rounding leaves forces of neighbouring cells {apart / largest:.1e} apart; a bound on "
                "stresses in equilibrium needs better conditioned data, such as a Poisson ratio farther from 1/2, or "
                "less contrast."
            )
        return x

    def forces(self, x: Floats) -> Floats:
        """(4 E,) the forces of motions (4 E,) of edges, of cells and of springs."""
        each = [one.apply(G, x[at]) for one, G, at in zip(self.fans, self.stiffness, self.edges.places, strict=True)]
        pull = np.einsum("bij,bj->bi", self.springs, x[self.edges.outer].reshape(-1, 4))
        outer = self.edges.outer.ravel()
        return gathered(self.edges.places, each, len(x)) + totals(outer, pull.ravel(), len(x))


def equilibrium(edges: Edges, fans: tuple[Fans, ...], stiffness: tuple[Floats, ...], boundary: Boundary) -> Equilibrium:
    """The hybrid problem of what supports, springs and bonds on the boundary hold.

    A body that floats is anchored by a little of the diagonal; forces that balance then need a few corrections.
    """
    P = _free_motions(edges, boundary)
    places = [*edges.places, edges.outer.reshape(-1, 4)]
    each = [*(one.of_cells(G) for one, G in zip(fans, stiffness, strict=True)), boundary.springs]
    K = sp.csr_matrix(P.T @ assembled(places, each, P.shape[0]) @ P)
    # With this much a correction leaves 1e-5 of the error on a body of a thousand cells.
    floats = boundary.motions.shape[1] or boundary.posed.pins
    K = K + sp.diags_array(SAME * K.diagonal()) if floats else K
    factor = choose_linear(K.shape[0]).factorise(K)
    return Equilibrium(edges=edges, fans=fans, stiffness=stiffness, P=P, springs=boundary.springs, factor=factor)


def assembled(places: Sequence[Ints], matrices: Sequence[Floats], size: int) -> sp.csr_matrix:
    """(size, size) the sum of matrices (c, m, m) of chunks of cells at places (c, m)."""
    rows, columns = (
        np.concatenate([np.broadcast_to(np.expand_dims(at, axis), (*at.shape, at.shape[1])).ravel() for at in places])
        for axis in (2, 1)
    )
    return sp.csr_matrix((np.concatenate([one.ravel() for one in matrices]), (rows, columns)), shape=(size, size))


def _free_motions(edges: Edges, boundary: Boundary) -> sp.csr_matrix:
    """(4 E, m) columns: all motions but those that are held."""
    inner, joints, own = np.ones(4 * edges.count, dtype=bool), boundary.edges.joints, boundary.free.copy()
    inner[edges.outer] = False
    alone = np.flatnonzero(inner)
    # Directions in which two edges move alike belong to both.
    for side in (joints.first, joints.second):
        own[side] -= boundary.bonds
    (one, axes), (joint, common) = axes_of(own), axes_of(boundary.bonds)
    first, second = edges.outer[joints.first[joint]], edges.outer[joints.second[joint], ::-1]
    rows = [alone, edges.outer[one].ravel(), first.ravel(), second.ravel()]
    entries = [np.ones(len(alone)), *(np.repeat(v, 2, axis=0).ravel() for v in (axes, common, common))]
    counts = len(alone), 2 * len(one), 2 * len(joint)
    single, of_own, of_both = np.split(np.arange(sum(counts)), np.cumsum(counts)[:2])
    columns = [single, *(np.repeat(each, 2) for each in (of_own, of_both, of_both))]
    shape = (len(inner), sum(counts))
    return sp.csr_matrix((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=shape)


def axes_of(projectors: Floats) -> tuple[Ints, Floats]:
    """The projectors (b, 2, 2) that have axes, once each, and these (k, 2)."""
    values, vectors = np.linalg.eigh(projectors)
    which, axis = np.nonzero(values > 0.5)
    return which, vectors[which, :, axis]
