"""Stresses of least energy in equilibrium with given forces, by a hybrid method (B. Fraeijs de Veubeke, 1965).

Let u_D be the displacement of the supports, n the outward normal, sigma_0 the prestress, C the elastic tensor, and
(., .) the integral of a product. The stress tau of :mod:`.stress` is in equilibrium with all loads, and minimises

    (tau, C^-1 tau) / 2  -  int over the supports of  tau n . u_D  -  (tau, C^-1 sigma_0).

The unknowns are edge motions m, linear on edges, with jumps at vertices. A cell with the matrix G exerts the forces G m
on edges, and further forces due to the loads and sigma_0. On every edge, the forces of both cells cancel.

Let v be the computed displacement. A matrix L maps v to edge motions L v. Linear tractions do the same work on L v as
on v. We compute x = m - L v, which has smaller rounding errors than m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, ROUNDING, SAME, Floats, Ints
from vemcvx.base.errors import SceneError
from vemcvx.bound.fan import Fans, gather
from vemcvx.bound.skeleton import Skeleton
from vemcvx.bound.surface import Boundary
from vemcvx.linear import Factor, choose_linear
from vemcvx.meshes import PolygonMesh

HALF_DIGITS = float(np.sqrt(EPS))
"""Largest accepted difference between forces of neighbouring cells, relative to the largest force."""


@dataclass(frozen=True, eq=False)
class Edges:
    """The E edges of a mesh."""

    count: int
    places: tuple[Ints, ...]  # positions (c, 4 n) of edge motions, for each chunk of c cells with n edges
    outer: Ints  # (b, 2, 2) positions of motions of boundary edges
    nodes: Ints  # (E, 2) ends of each edge, in increasing order

    def outline(self, u: Floats) -> Floats:
        """Return u at vertices, then u at the middles of edges."""
        return np.concatenate([u, 0.5 * (u[self.nodes[:, 0]] + u[self.nodes[:, 1]])]).ravel()

    @cached_property
    def motions(self) -> sp.csr_matrix:
        """The matrix L from an `outline` to edge motions (:func:`.displacement.to_edges`)."""
        vertices, edge = int(self.nodes.max()) + 1, np.arange(self.count)
        own, other, middle = self.nodes.ravel(), self.nodes[:, ::-1].ravel(), vertices + np.repeat(edge, 2)
        entries = np.repeat([2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0], len(own))
        places = np.tile(np.arange(len(own)), 3), np.concatenate([own, other, middle])
        ends = sp.csr_matrix((entries, places), shape=(len(own), vertices + self.count))
        return sp.csr_matrix(sp.kron(ends, sp.eye_array(2)))


def edges_of(mesh: PolygonMesh, skeleton: Skeleton, fans: Sequence[Fans]) -> Edges:
    """Return the edges of a mesh."""
    shared = mesh.shared_edges
    ends = np.argsort(skeleton.sides, axis=1)
    place = 4 * shared.number[:, None, None] + 2 * ends[:, :, None] + np.arange(2)
    places = tuple(place[mesh.offsets[one.cells][:, None] + np.arange(one.n)].reshape(-1, 4 * one.n) for one in fans)
    return Edges(len(shared.first), places, place[skeleton.outer_corners], shared.ends)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """The hybrid problem of a body, factorised."""

    edges: Edges
    fans: tuple[Fans, ...]
    stiffness: tuple[Floats, ...]  # matrices G (k, 4 n, 4 n), for each chunk of cells
    P: sp.csr_matrix  # matrix from free motions to all 4 E edge motions
    factor: Factor

    def solve(self, given: Floats, largest: float) -> Floats:
        """Return x = P y with P' G x = P' f for the given forces f."""
        left, x, apart, before = given, np.zeros(len(given)), np.inf, np.inf
        # Stop if a correction does not halve the residual.
        while ROUNDING * largest < apart <= 0.5 * before:
            before, x = apart, x + self.P @ self.factor.solve(self.P.T @ left)
            left = given - self.forces(x)
            apart = float(np.abs(self.P.T @ left).max(initial=0.0))
        if apart > HALF_DIGITS * largest:
            raise SceneError(
                "error_bound: rounding errors make the forces of neighbouring cells differ by "
                f"{apart / largest:.1e} of the largest force. The bound needs better conditioned data, such as a "
                "Poisson ratio farther from 1/2, or less contrast between materials."
            )
        return x

    def forces(self, x: Floats) -> Floats:
        """Return the forces G x, summed over cells."""
        each = [one.apply(G, x[at]) for one, G, at in zip(self.fans, self.stiffness, self.edges.places, strict=True)]
        return gather(self.edges.places, each, len(x))


def equilibrium(edges: Edges, fans: tuple[Fans, ...], stiffness: tuple[Floats, ...], boundary: Boundary) -> Equilibrium:
    """Return the factorised hybrid problem."""
    P = _free_motions(edges, boundary)
    each = [one.expand(G) for one, G in zip(fans, stiffness, strict=True)]
    K = sp.csr_matrix(P.T @ assemble(edges.places, each, P.shape[0]) @ P)
    # A floating body has a singular matrix K. We increase its diagonal, and `solve` corrects the error.
    floats = boundary.motions.shape[1] or boundary.posed.pins
    K = K + sp.diags_array(SAME * K.diagonal()) if floats else K
    factor = choose_linear(K.shape[0]).factorise(K)
    return Equilibrium(edges=edges, fans=fans, stiffness=stiffness, P=P, factor=factor)


def assemble(places: Sequence[Ints], matrices: Sequence[Floats], size: int) -> sp.csr_matrix:
    """Assemble chunks of cell matrices into one matrix."""
    rows, columns = (
        np.concatenate([np.broadcast_to(np.expand_dims(at, axis), (*at.shape, at.shape[1])).ravel() for at in places])
        for axis in (2, 1)
    )
    return sp.csr_matrix((np.concatenate([one.ravel() for one in matrices]), (rows, columns)), shape=(size, size))


def _free_motions(edges: Edges, boundary: Boundary) -> sp.csr_matrix:
    inner, joints, own = np.ones(4 * edges.count, dtype=bool), boundary.edges.joints, boundary.free.copy()
    inner[edges.outer] = False
    alone = np.flatnonzero(inner)
    # Opposite edges of an interface have the same motions in bonded directions.
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
    """Return projector indices (k,), and unit vectors (k, d) that span the ranges."""
    values, vectors = np.linalg.eigh(projectors)
    which, axis = np.nonzero(values > 0.5)
    return which, vectors[which, :, axis]
