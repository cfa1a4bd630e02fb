"""The stress of least energy in equilibrium with given forces: a hybrid method, its unknowns the motions of edges.

Among all stresses of the fans (:mod:`.stress`) that balance body forces, have the given tractions on free parts of the
boundary and go on from cell to cell, the one that minimises

    |tau|^2 / 2 in C^-1  -  int over held parts of  tau n . u_D  -  (tau, C^-1 sigma_0)

is that of edge motions m, linear on every edge and free to jump at vertices, for which the forces of both cells on
each edge cancel. Every cell answers to its m by G m + b (f): a stiffness matrix, positive definite up to rigid
motions, is added up over the cells, and solved with once a step (equilibrium elements of B. Fraeijs de Veubeke, 1965;
on the split triangle they have no spurious motions). The prestress sigma_0 acts as forces of the edges: tau - sigma_0
is what m strains.

So no local problem has to be found compatible, and no other stress of these fans is nearer to that of the body: of
tractions made vertex by vertex, bounds were up to a fifth larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints, totals
from vemcvx.bound.fan import Fans, assembled
from vemcvx.bound.skeleton import Skeleton
from vemcvx.bound.stress import VOIGT, FanStress, stresses_at_stations
from vemcvx.errors import SceneError
from vemcvx.linear import Factor, choose_linear
from vemcvx.meshes import PolygonMesh

UNBALANCED, ROUNDING, CORRECTIONS = 1e-7, 1e-13, 4
"""Parts of the largest force by which neighbours may differ, and below which they do by rounding (at lambda = 1e6 that
is 1e-9); and how often it is solved."""


ANCHOR = 1e-9
"""Parts of the diagonal that anchor what floats: of a body of a thousand cells a correction loses all but 1e-5."""


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of a mesh: each with both ends, that of the smaller node number first."""

    count: int
    places: tuple[Ints, ...]
    """of each chunk of cells (c, 4 n): where the motions of its edges stand among all, four an edge"""
    outer: Ints
    """(b, 2, 2) likewise those of boundary edges"""


def edges_of(mesh: PolygonMesh, skeleton: Skeleton, fans: Sequence[Fans]) -> Edges:
    """The Edges of a mesh."""
    shared = mesh.shared_edges
    number = np.empty(len(mesh.vertices), dtype=np.int64)
    number[shared.corners] = np.repeat(np.arange(len(shared.first)), shared.counts)
    turned = skeleton.sides[:, 0] > skeleton.sides[:, 1]
    ends = np.where(turned[:, None], [1, 0], [0, 1])
    place = 4 * number[:, None, None] + 2 * ends[:, :, None] + np.arange(2)
    of_fans = tuple(place[mesh.offsets[one.cells][:, None] + np.arange(one.n)].reshape(-1, 4 * one.n) for one in fans)
    return Edges(len(shared.first), of_fans, place[skeleton.outer_corners])


@dataclass(frozen=True, eq=False)
class Bonds:
    """Pairs of boundary edges (j,) in one place, of two bodies that move alike along some directions."""

    first: Ints
    second: Ints
    directions: Floats
    """(j, 2, 2) projectors on these"""


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

    def solve(
        self, held: Floats, outer: Floats, force: Sequence[Floats | None], prestress: Floats
    ) -> tuple[tuple[Floats, ...], Floats]:
        """The stresses (c, n, 18, 3) of each chunk of cells at its stations, and the motions (b, 2, 2) of the boundary.

        Parameters
        ----------
        held : (b, 2, 2) array
            Motions of the ends of boundary edges where they are held, zero else.
        outer : (b, 2, 2) array
            Forces int t phi on the ends of boundary edges; read where these are free.
        force : (c, 6 n) arrays, one a chunk, or None
            int f lambda_k on the triangles.
        prestress : (n_cells, 3) array
            Stresses at zero strain.

        Raises
        ------
        SceneError
            Rounding leaves forces of neighbours apart.
        """
        size = 4 * self.edges.count
        given, motion = np.zeros(size), np.zeros(size)
        np.add.at(given, self.edges.outer, outer)
        motion[self.edges.outer] = held
        for one, place in zip(self.stresses, self.edges.places, strict=True):
            given -= totals(place.ravel(), edge_forces(one.fans, prestress[one.fans.cells]).ravel(), size)
        chunks = list(zip(self.stresses, self.edges.places, force, strict=True))
        largest = float(np.abs(given).max(initial=0.0))
        for _ in range(CORRECTIONS):
            tractions, left = [one.tractions(motion[place], f) for one, place, f in chunks], given.copy()
            for (one, place, _), found in zip(chunks, tractions, strict=True):
                left -= totals(place.ravel(), found[:, 4 * one.fans.n :].ravel(), size)
                largest = max(largest, float(np.abs(found).max(initial=0.0)))
            pull = np.einsum("bij,bj->bi", self.springs, motion[self.edges.outer].reshape(-1, 4))
            left -= totals(self.edges.outer.ravel(), pull.ravel(), size)
            unbalanced = self.P.T @ left
            apart = float(np.abs(unbalanced).max(initial=0.0))
            if apart <= ROUNDING * largest:
                break
            motion = motion + self.P @ self.factor.solve(unbalanced)
        if apart > UNBALANCED * largest:
            raise SceneError(
                f"error_bound: rounding leaves forces of neighbouring cells {apart / largest:.1e} apart; a bound on "
                "stresses in equilibrium needs better conditioned data, such as a Poisson ratio farther from 1/2, or "
                "less contrast."
            )
        stresses = tuple(
            stresses_at_stations(one.fans, forces, f) + prestress[one.fans.cells][:, None, None]
            for (one, _, f), forces in zip(chunks, tractions, strict=True)
        )
        return stresses, motion[self.edges.outer]


def edge_forces(fans: Fans, stress: Floats) -> Floats:
    """(c, 4 n) int tau n phi at both ends of the outer edges, of constant stresses (c, 3)."""
    along = np.roll(fans.corners, -1, axis=1) - fans.corners
    normals = np.stack([along[..., 1], -along[..., 0]], axis=2)
    half = 0.5 * np.einsum("abk,ck,cnb->cna", VOIGT, stress, normals)
    return np.repeat(half[:, :, None], 2, axis=2).reshape(len(stress), 4 * fans.n)


def equilibrium(
    edges: Edges, stresses: tuple[FanStress, ...], free: Floats, bonds: Bonds, *, springs: Floats, floats: bool
) -> Equilibrium:
    """The hybrid problem, boundary edges being free along projectors (b, 2, 2) and on springs (b, 4, 4).

    A body that `floats` is anchored by a little of the diagonal; forces that balance then need one or two corrections.
    """
    fans = [one.fans for one in stresses]
    G = assembled(fans, [one.stiffness for one in stresses], edges.places, 4 * edges.count)
    places = edges.outer.reshape(-1, 4)
    where = np.repeat(places, 4, axis=1).ravel(), np.tile(places, (1, 4)).ravel()
    G = G + sp.csr_matrix((springs.ravel(), where), shape=G.shape)
    P = _free_motions(edges, free, bonds)
    K = sp.csr_matrix(P.T @ G @ P)
    K = K + sp.diags_array(ANCHOR * K.diagonal()) if floats else K
    return Equilibrium(edges, stresses, P, springs, choose_linear(K.shape[0]).factorise(K))


def _free_motions(edges: Edges, free: Floats, bonds: Bonds) -> sp.csr_matrix:
    """(4 E, m) columns: all motions but those that are held."""
    inner = np.ones(4 * edges.count, dtype=bool)
    inner[edges.outer] = False
    alone = np.flatnonzero(inner)
    # Directions in which two edges move alike belong to both, if both are free.
    own = free.copy()
    for side in (bonds.first, bonds.second):
        own[side] -= bonds.directions
    one, axis, vectors = _axes(own)
    joint, shared, common = _axes(bonds.directions)
    both = [common[joint, :, shared], common[joint, :, shared]]
    first, second = edges.outer[bonds.first[joint]], edges.outer[bonds.second[joint], ::-1]
    rows = [alone, edges.outer[one].ravel(), first.ravel(), second.ravel()]
    entries = [np.ones(len(alone)), *(np.repeat(v, 2, axis=0).ravel() for v in (vectors[one, :, axis], *both))]
    start = len(alone) + np.array([0, 2 * len(one)])
    of_own, of_both = (
        begin + np.repeat(np.arange(2 * n), 2) for begin, n in zip(start, (len(one), len(joint)), strict=True)
    )
    columns = [np.arange(len(alone)), of_own, of_both, of_both]
    shape = (len(inner), len(alone) + 2 * len(one) + 2 * len(joint))
    return sp.csr_matrix((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=shape)


def _axes(projectors: Floats) -> tuple[Ints, Ints, Floats]:
    """The projectors (b, 2, 2) and numbers of their axes, and all eigenvectors."""
    values, vectors = np.linalg.eigh(projectors)
    which, axis = np.nonzero(values > 0.5)
    return which, axis, vectors
