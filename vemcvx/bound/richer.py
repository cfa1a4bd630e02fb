"""The richer displacement v + w, by which errors are bounded from below.

w is quadratic on edges, inside cells what its values there make least energy of, and vanishes where v touches or is
held (:mod:`.hypercircle`). Any such w gives a bound, best the one that takes off most energy:

    S w  =  R,      S the energy of values at vertices and at middles of edges,  R the residual of v.

To factorise S would take longer than all else that is made once a mesh. But the motions m of edges that belong to tau
are nearer to u than v is, and what they lack is local: they jump at vertices. So w begins as m - v, with the mean of
the ends that meet at a vertex, and with the mean of m on each edge, by which no cell changes its volume where those of
m do not: near nu = 1/2 nothing else would do. Then come conjugate gradients, preconditioned by exact solutions on
stars, a vertex with the middles of its edges: displacements without divergence are sums of such on stars (J. Schoberl,
Numer. Math. 84 (1999)). Two or three are enough, but where v is far from u on contact, and w = 0: of triangles that
lock w was a layer of one cell there. So after ALONE of them what balances the residual in the hybrid problem of
:mod:`.equilibrium` joins the stars, one more solve with its factor (the auxiliary space of J. Xu, Computing 56 (1996)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints
from vemcvx.bound.displacement import FanDisplacement
from vemcvx.bound.equilibrium import Edges, Equilibrium, gathered

GRADIENTS, ALONE, LAST_GAIN = 8, 3, 0.01
"""Conjugate gradients at most, those with stars alone, and the part of the energy of w below which one that gains it is
the last."""


@dataclass(frozen=True, eq=False)
class Richer:
    """The displacements w of a mesh, and stars by which the best one is found."""

    equilibrium: Equilibrium
    displacements: tuple[FanDisplacement, ...]
    outlines: tuple[Ints, ...]
    """(c, 4 n) of each chunk of cells the places of vertices and of middles of edges among those of all"""
    free: sp.csr_matrix
    """the projector on values of all that vanish where v touches or is held"""
    stars: tuple[tuple[Ints, Floats], ...]
    """(k, m) the places of stars of equally many edges, and (k, m, m) the inverses of their parts of S"""

    @property
    def size(self) -> int:
        """The number of values at vertices and at middles of edges."""
        return int(self.free.shape[0])

    def best(self, residual: Floats, motion: Floats) -> tuple[Floats, float]:
        """w and the bound of |u - v|_a from below, by the residual and by m - v (4 E,)."""
        left = self.free @ residual
        w = self._near(motion)
        made = self._forces(w)
        part = float(left @ w) / (float(w @ made) or 1.0)
        w, r = part * w, left - part * made
        along, last, before = np.zeros_like(w), np.zeros_like(w), np.inf
        for k in range(GRADIENTS):
            z = self._of_stars(r)
            if k >= ALONE:
                z += self._of_edges(r)
            # Flexible: the preconditioner may change.
            along, before, last = z + float(z @ (r - last)) / before * along, float(z @ r), r
            if before <= 0.0:
                break
            made = self._forces(along)
            length = float(along @ r) / float(along @ made)
            gained = length * float(along @ r)
            w, r = w + length * along, r - length * made
            if gained <= LAST_GAIN * float(left @ w):
                break
        # The last of them is not quite at right angles to the first: the best multiple.
        work, energy = float(left @ w), float(w @ (left - r))
        if work <= 0.0 or energy <= 0.0:
            return 0.0 * w, 0.0
        return work / energy * w, work / float(np.sqrt(energy))

    @cached_property
    def _means(self) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        """Means at vertices (2 nodes, 4 E) of the ends that meet there, and at middles (2 E, 2 nodes) of vertices."""
        ends = self.equilibrium.edges.nodes.ravel()
        places, count = (2 * ends[:, None] + np.arange(2)).ravel(), self.size - len(ends)
        meet = sp.csc_matrix((np.ones(len(places)), places, np.arange(len(places) + 1)), shape=(count, len(places)))
        degree = np.maximum(np.bincount(places, minlength=count), 1)
        of_edges = (2 * np.repeat(np.arange(len(ends) // 2), 2)[:, None] + np.arange(2)).ravel()
        halves = sp.csr_matrix((np.full(len(places), 0.5), (of_edges, places)), shape=(len(ends), count))
        return sp.csr_matrix(self.free[:count, :count] @ sp.diags_array(1.0 / degree) @ meet), halves

    def _near(self, motion: Floats) -> Floats:
        """The values of a motion of edges, as near as they come."""
        (of_ends, of_vertices), x = self._means, motion.reshape(-1, 2, 2)
        vertices = of_ends @ motion
        middles = 0.75 * (x[:, 0] + x[:, 1]).ravel() - 0.5 * (of_vertices @ vertices)
        near: Floats = self.free @ np.concatenate([vertices, middles])
        return near

    def _of_edges(self, r: Floats) -> Floats:
        """The values of the motion of edges that forces r, as near as they come, make in the hybrid problem."""
        of_ends, of_vertices = self._means
        vertices, middles = np.split(r, [of_ends.shape[0]])
        force = of_ends.T @ (vertices - 0.5 * (of_vertices.T @ middles))
        force += 0.75 * np.repeat(middles.reshape(-1, 1, 2), 2, axis=1).ravel()
        P, factor = self.equilibrium.P, self.equilibrium.factor
        return self._near(P @ factor.solve(P.T @ force))

    def _forces(self, w: Floats) -> Floats:
        """S w."""
        each = [one.fans.apply(one.stiffness, w[at]) for one, at in zip(self.displacements, self.outlines, strict=True)]
        forces: Floats = self.free @ gathered(self.outlines, each, self.size)
        return forces

    def _of_stars(self, r: Floats) -> Floats:
        """The sum of the exact solutions on stars."""
        solved = [np.matmul(inverse, r[at][:, :, None])[:, :, 0] for at, inverse in self.stars]
        return gathered([at for at, _ in self.stars], solved, self.size)


def richer(
    equilibrium: Equilibrium, displacements: tuple[FanDisplacement, ...], outlines: tuple[Ints, ...], free: Floats
) -> Richer:
    """The Richer of a mesh, vertices and middles being free along projectors (nodes + E, 2, 2)."""
    each = np.arange(len(free) + 1)
    projector = sp.bsr_matrix((free, each[:-1], each)).tocsr()
    projector.eliminate_zeros()
    stars = _stars(equilibrium.edges, displacements, outlines, free)
    return Richer(equilibrium, displacements, outlines, projector, stars)


def _stars(
    edges: Edges, displacements: Sequence[FanDisplacement], outlines: Sequence[Ints], free: Floats
) -> tuple[tuple[Ints, Floats], ...]:
    """Places and inverses of the stars of all vertices, by their number of edges."""
    count, ends = len(free) - edges.count, edges.nodes.ravel()
    degree, order = np.bincount(ends, minlength=count), np.argsort(ends, kind="stable")
    first = np.cumsum(degree) - degree
    rank = np.empty(len(ends), dtype=np.int64)
    rank[order] = np.arange(len(ends)) - first[ends[order]]
    size = 2 + 2 * degree
    start = np.cumsum(size**2) - size**2
    entries = np.zeros(int((size**2).sum()))
    for one, place in zip(displacements, outlines, strict=True):
        n = one.fans.n
        vertex, after = place[:, : 2 * n : 2] // 2, place[:, 2 * n :: 2] // 2 - count
        # At each corner: its vertex, and the middles of the edges that end and begin there.
        beside = np.stack([np.roll(after, 1, axis=1), after], axis=2)
        last = edges.nodes[beside, 1] == vertex[:, :, None]
        at = np.concatenate([0 * vertex[:, :, None], 1 + rank[2 * beside + last]], axis=2)
        rows = (2 * at[..., None] + np.arange(2)).reshape(*vertex.shape, 6)
        k = np.arange(n)
        own = np.stack([k, n + np.roll(k, 1), n + k], axis=1)
        own = (2 * own[:, :, None] + np.arange(2)).reshape(n, 6)
        values = one.fans.of_cells(one.stiffness[:, own[:, :, None], own[:, None]])
        where = start[vertex][:, :, None, None] + size[vertex][:, :, None, None] * rows[..., None] + rows[:, :, None]
        np.add.at(entries, where.ravel(), values.ravel())
    found = list[tuple[Ints, Floats]]()
    for d in np.unique(degree[degree > 0]):
        some, m = np.flatnonzero(degree == d), 2 + 2 * int(d)
        nodes = np.column_stack([some, count + order[first[some, None] + np.arange(d)] // 2])
        A = entries[start[some, None] + np.arange(m * m)].reshape(-1, m, m)
        places: Ints = (2 * nodes[:, :, None] + np.arange(2)).reshape(-1, m)
        found.append((places, np.asarray(np.linalg.inv(_projected(A, free[nodes])))))
    return tuple(found)


def _projected(A: Floats, free: Floats) -> Floats:
    """Matrices (k, m, m) on what projectors (k, m / 2, 2, 2) leave free, and as much as they are beside it."""
    bound = np.flatnonzero((free != np.eye(2)).any(axis=(1, 2, 3)))
    k, m = len(bound), A.shape[1]
    F = np.zeros((k, m // 2, 2, m // 2, 2))
    every = np.arange(m // 2)
    F[:, every, :, every] = np.moveaxis(free[bound], 1, 0)
    F = F.reshape(k, m, m)
    size = np.trace(A[bound], axis1=1, axis2=2)[:, None, None] / m
    A[bound] = F @ A[bound] @ F + size * (np.eye(m) - F)
    return A
