"""Supports: the free unknowns, and the displacement that the supports prescribe.

Supports prescribe A u = g(t), with one row per direction at a node or a pair of nodes. Elimination gives

    u = P y + H g(t),   A P = 0,   P'P = I,   A H = I,   P'H = 0,

with the free unknowns y and the prescribed displacement u_D = H g. Each row of A has a support
force. The vector f of these forces causes the nodal reactions R = A'f. Then f = H'R.

The supports of rigid parts and bolts prescribe A u = g(t) + M c. The columns of M are called *patterns*, and the
*amplitudes* c are unknown. Then u = P y + H g + H M c. An orthonormal basis of range(H M) is appended to P.

Rows connect nodes. A *site* is a set of connected nodes, or a single node. At each site, Gram-Schmidt gives an
orthonormal frame from four kinds of directions, in this order: prescribed directions, normals of bilateral contact,
normals of friction and obstacles, coordinate axes. The vectors of the last two kinds become columns of P. Each friction
term then has separate unknowns, and a solver can set a slip to exactly zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp
from scipy.linalg import block_diag
from scipy.sparse.csgraph import connected_components

from vemcvx.base.arrays import EPS, SAME, Bools, Floats, Ints, read_only
from vemcvx.base.errors import SceneError
from vemcvx.effects import ContactSurface, Friction, Obstacle, Support
from vemcvx.meshes.polygons import smallest_linked
from vemcvx.scene.rows import jump_rows, pairs_of, repeat_by_row, slices_of
from vemcvx.vem.boundary import DIRECTION_TOLERANCE
from vemcvx.vem.projection import tangents_of

Forces = TypeVar("Forces", Floats, sp.csr_matrix)


@dataclass(frozen=True, kw_only=True)
class Supports:
    """The free unknowns of a body, and the displacement that the supports prescribe."""

    P: sp.csr_matrix  # (n_u, n) orthonormal columns, ordered by site
    owner: Ints  # (n,) site of each free unknown
    sites: Ints  # (n_nodes,) site of each node
    points: Floats
    given: Sequence[Support]  # supports in the order of their rows in A
    A: sp.csr_matrix  # (s, n_u) prescribed components
    H: sp.csr_matrix  # (n_u, s) zero columns for dependent rows
    depends: Bools  # (s,) mask of rows that depend on earlier rows
    reach: Floats  # (s,) distance of each row from the span of earlier rows
    amplitudes: int = 0  # number of amplitudes, which are the last free unknowns

    @cached_property
    def still(self) -> bool:
        """True if every prescribed value is zero at all times."""
        return all(support.value is None for support in self.given)

    @cached_property
    def moved(self) -> Ints:
        """The indices of nodal values at nodes that the supports move."""
        dim, moving = self.points.shape[1], repeat_by_row(self.given, [s.value is not None for s in self.given])
        nodes = np.unique(self.H[:, np.flatnonzero(moving)].nonzero()[0] // dim)
        return (nodes[:, None] * dim + np.arange(dim)).ravel()

    @cached_property
    def linked(self) -> Ints:
        """The site (n_nodes,) of each node, after joining sites with a common amplitude."""
        count, last = len(self.points), self.P.shape[1] - self.amplitudes
        entries = self.P[:, last:].tocoo()
        links = np.column_stack([self.sites[entries.row // self.points.shape[1]], count + entries.col])
        linked: Ints = smallest_linked(links, count + self.amplitudes)[self.sites]
        return linked

    def places(self, nodes: Ints) -> Callable[[int], str]:
        """Return a function that describes node `nodes[i]` in words."""
        return lambda i: f"node {nodes[i]} at {tuple(float(x) for x in np.round(self.points[nodes[i]], 12))}"

    def gather(self, f: Forces) -> Forces:
        """Return P'f, the forces on the free unknowns."""
        return self.P.T @ f

    def on_free(self, rows: sp.csr_matrix) -> sp.csr_matrix:
        """Return rows @ P, with entries near 0, 1 and -1 rounded."""
        B: sp.csr_matrix = rows @ self.P
        B.data[np.abs(B.data) < SAME] = 0.0
        unit = np.abs(np.abs(B.data) - 1.0) < SAME
        B.data[unit] = np.sign(B.data[unit])
        B.eliminate_zeros()
        return B

    def free_directions(self, corners: Ints, side: Ints) -> Floats:
        """Return projectors (b, dim, dim) onto directions that are free at a corner of a side."""
        dim = self.points.shape[1]
        nodes, place = np.unique(corners, return_inverse=True)
        rows = self.P[(dim * nodes[:, None] + np.arange(dim)).ravel(), : self.P.shape[1] - self.amplitudes]
        gram = sp.bsr_matrix(rows @ rows.T, blocksize=(dim, dim)).tocoo()
        own = np.zeros((len(nodes), dim, dim))
        near = gram.row // dim == gram.col // dim
        own[gram.row[near] // dim, gram.row[near] % dim, gram.col[near] % dim] = gram.data[near]
        freedom = np.zeros((int(side.max(initial=-1)) + 1, dim, dim))
        np.add.at(freedom, side, own[place])
        values, vectors = np.linalg.eigh(freedom)
        # Directions with eigenvalues of at most 1e-9 are held at all corners.
        return np.einsum("bik,bk,bjk->bij", vectors, np.where(values > 1e-9, 1.0, 0.0), vectors)

    @cached_property
    def motion(self) -> Callable[[float], Floats]:
        """The function t -> u_D, which raises SceneError if supports contradict each other."""
        return lru_cache(maxsize=1)(self._evaluate)

    def _evaluate(self, t: float) -> Floats:
        each = [np.zeros(len(s.nodes)) if s.value is None else np.asarray(s.value(t)) for s in self.given]
        motion = np.asarray(self.H @ np.concatenate([np.zeros(0), *each]))
        if not self.still:
            self._check(motion, each, t)
        return read_only(motion)

    def _check(self, motion: Floats, each: Sequence[Floats], t: float) -> None:
        present, size = self.A @ motion, np.abs(motion).max(initial=0.0)
        for support, wanted, rows in zip(self.given, each, slices_of(self.given), strict=True):
            missing = np.where(self.depends[rows], np.abs(wanted - present[rows]), 0.0)
            scale = max(np.abs(wanted).max(initial=0.0), np.abs(present[rows]).max(initial=0.0))
            # `reach` allows for nearly dependent rows.
            wrong = missing > SAME * scale + 2.0 * self.reach[rows] * size
            if wrong.any() and not support.contact:
                row = int(np.argmax(wrong * missing))
                node = f"node {support.nodes[row]} at {support.points[row]}"
                raise SceneError(
                    f"{support.subject}: {node} is to move by {wanted[row]:.6g} along {support.directions[row]} at t = "
                    f"{t:.6g}, but other supports already move it by {present[rows][row]:.6g}."
                )


def by_precedence(supports: Sequence[Support]) -> list[Support]:
    """Sort supports so that contact comes last."""
    return sorted(supports, key=lambda s: s.contact)


def check_off_axis(surfaces: Sequence[ContactSurface]) -> None:
    """Raise SceneError if contact acts on the axis of a body of revolution."""
    for surface in surfaces:
        if (surface.lengths == 0.0).any():
            found = f"{surface.subject}: found sides on the axis of the body of revolution, which have no area"
            raise SceneError(f"{found}; name other boundaries. Nodes on the axis are held radially.")


def check_bonds(holds: Sequence[Support], others: Sequence[Friction | Obstacle]) -> None:
    """Raise SceneError if contact or friction acts on a bonded interface."""
    for bond in (support for support in holds if support.patterns is not None and support.partners is not None):
        ends = pairs_of([bond])
        for other in (*holds, *others):
            if other is bond or getattr(other, "bond", False):
                continue
            if np.logical_and(*map(np.isin, pairs_of([other]), ends)).any():
                raise SceneError(
                    f"{other.subject}: it acts on an interface that {bond.subject} bonds. Name only the other "
                    "interfaces, on which the parts may slip or open."
                )


def resolve(supports: Sequence[Support], normals: Sequence[Friction | Obstacle], points: Floats) -> Supports:
    """Return the supports, with held and free directions at every site."""
    dim, given = points.shape[1], by_precedence(supports)
    pairs, across = pairs_of(given), pairs_of(normals)
    site = _sites(np.append(pairs[0], across[0]), np.append(pairs[1], across[1]), len(points))
    directions = np.concatenate([points[:0], *(support.directions for support in given)])
    axes = np.concatenate([points[:0], *(part.normals for part in normals)])
    A = jump_rows(*pairs, directions[:, None], points)
    # If a site has several nodes, tangents come after each normal.
    N = jump_rows(*across, np.concatenate([axes[:, None], tangents_of(axes)], axis=1), points)
    follow = (np.arange(N.shape[0]) % dim == 0) | np.repeat(np.bincount(site)[site[across[0]]] > 1, dim)
    at_site = np.append(site[pairs[0]], np.repeat(site[across[0]], dim)[follow])
    P, H, owner, depends, reach = _split_sites(
        site, sp.vstack([A, N[np.flatnonzero(follow)]]), at_site, A.shape[0], dim
    )
    spanned = _span_amplitudes(given, A, H, reach, points)
    if spanned.shape[1] and P.shape[1] == 0:
        subjects = ", ".join(s.subject for s in given if s.patterns is not None)
        raise SceneError(f"{subjects}: all nodes are held or belong to rigid parts; a part of the body must deform.")
    return Supports(
        P=sp.csr_matrix(sp.hstack([P, spanned])) if spanned.shape[1] else P,
        owner=np.append(owner, np.full(spanned.shape[1], site.max() + 1)),
        sites=site,
        points=points,
        given=given,
        A=A,
        H=H,
        depends=depends,
        reach=reach,
        amplitudes=spanned.shape[1],
    )


def _split_sites(
    site: Ints, rows_of_u: sp.csr_matrix, at_site: Ints, count: int, dim: int
) -> tuple[sp.csr_matrix, sp.csr_matrix, Ints, Bools, Floats]:
    """Return P (without amplitudes), H, owner, depends and reach."""
    # `local` is the index of a nodal value in its site.
    n_nodes = len(site)
    members = np.argsort(site, kind="stable")
    first = np.searchsorted(site[members], np.arange(site.max() + 2))
    local = np.empty((n_nodes, dim), dtype=np.int64)
    local[members] = (np.arange(n_nodes) - first[site[members]])[:, None] * dim + np.arange(dim)
    entries = rows_of_u.tocoo()
    read = np.zeros((len(at_site), dim * int(np.bincount(site).max())))
    read[entries.row, local.ravel()[entries.col]] = entries.data

    depends, reach = np.zeros(count, dtype=bool), np.zeros(count)
    untouched = np.flatnonzero(~np.isin(np.repeat(site, dim), at_site))
    free: list[tuple[Ints, Ints, Floats]] = [(untouched, np.arange(len(untouched)), np.ones(len(untouched)))]
    lifted: list[tuple[Ints, Ints, Any]] = [(untouched[:0], untouched[:0], np.zeros(0))]
    owner, columns = [site[untouched // dim]], len(untouched)
    for nodes, rows, prescribed in _group_sites(members, first, at_site, count):
        values = (nodes[:, :, None] * dim + np.arange(dim)).reshape(len(nodes), -1)
        own = read[rows][:, :, : values.shape[1]]
        frame, axis_of, length = _frames(own)
        depends[rows[:, :prescribed]], reach[rows[:, :prescribed]] = axis_of[:, :prescribed] < 0, length[:, :prescribed]
        place, row = np.nonzero(axis_of[:, :prescribed] >= 0)
        matrix, axis = frame.copy(), axis_of[place, row]
        matrix[place, axis] = own[place, row]
        inverse = np.linalg.inv(matrix)[place, :, axis]
        one, k = np.nonzero(inverse)
        lifted.append((values[place[one], k], rows[place, row][one], inverse[one, k]))
        place, axis = np.nonzero(np.arange(values.shape[1]) >= np.bincount(place, minlength=len(nodes))[:, None])
        one, k = np.nonzero(np.abs(frame[place, axis]) > EPS)  # Entries below EPS are rounding errors.
        free.append((values[place[one], k], columns + one, frame[place[one], axis[one], k]))
        owner.append(site[nodes[place, 0]])
        columns += len(place)
    owners = np.concatenate(owner)
    by_site, column = np.argsort(owners, kind="stable"), np.empty(columns, dtype=np.int64)
    column[by_site] = np.arange(columns)
    value, k, data = map(np.concatenate, zip(*free, strict=True))
    P = sp.csr_matrix((data, (value, column[k])), shape=(dim * n_nodes, columns))
    value, k, data = map(np.concatenate, zip(*lifted, strict=True))
    H = sp.csr_matrix((data, (value, k)), shape=(dim * n_nodes, count))
    return P, H, owners[by_site], depends, reach


def _span_amplitudes(
    given: Sequence[Support], A: sp.csr_matrix, H: sp.csr_matrix, reach: Floats, points: Floats
) -> sp.csr_matrix:
    """Return orthonormal columns that span H M."""
    each = [np.zeros((len(s.nodes), 0)) if s.patterns is None else s.patterns for s in given]
    M = block_diag(np.zeros((0, 0)), *each)
    if M.shape[1] == 0:
        return sp.csr_matrix((H.shape[0], 0))
    motions = H @ M
    off = np.abs(A @ motions - M).max(axis=1) - (SAME + 2.0 * reach) * np.abs(motions).max()
    if off.max() > 0:
        row = int(np.argmax(off))
        own, node = given[repeat_by_row(given, range(len(given)))[row]], pairs_of(given)[0][row]
        at_node = [s.subject for s in given if node in s.nodes or (s.partners is not None and node in s.partners)]
        loose = ", ".join(s.subject for s in given if s.patterns is not None)
        raise SceneError(
            f"{own.subject}: node {node} at {points[node]} is held by {' and '.join(dict.fromkeys(at_node))}, which "
            f"contradicts the free motions of {loose}. Prescribe the motion of the rigid part by motion= of "
            "Rigid, or remove other supports and bilateral contact from its nodes."
        )
    # Unlike Householder QR, Cholesky QR keeps motions of different parts exactly separate.
    for _ in range(2):
        motions /= np.linalg.norm(motions, axis=0)
        motions = motions @ np.linalg.inv(np.linalg.cholesky(motions.T @ motions)).T
    return sp.csr_matrix(motions)


def _sites(nodes: Ints, partners: Ints, n_nodes: int) -> Ints:
    joined = partners >= 0
    if not joined.any():
        return np.arange(n_nodes)
    entries = np.ones(joined.sum()), (nodes[joined], partners[joined])
    label = connected_components(sp.csr_matrix(entries, shape=(n_nodes, n_nodes)), directed=False)[1]
    first, site = np.unique(label, return_index=True, return_inverse=True)[1:]
    return np.argsort(np.argsort(first))[site]


def _group_sites(members: Ints, first: Ints, at_site: Ints, count: int) -> Iterator[tuple[Ints, Ints, int]]:
    """Yield nodes, rows and the number of prescribed rows, for each kind of site."""
    sites, where = np.unique(at_site, return_inverse=True)
    order = np.argsort(at_site, kind="stable")
    begin, held = np.searchsorted(at_site[order], sites), np.bincount(where[:count], minlength=len(sites))
    kinds = np.column_stack([np.diff(first)[sites], np.bincount(where), held])
    for kind in np.unique(kinds, axis=0):
        (n, k, prescribed), mine = kind.tolist(), np.flatnonzero((kinds == kind).all(axis=1))
        nodes, rows = members[first[sites[mine], None] + np.arange(n)], order[begin[mine, None] + np.arange(k)]
        yield nodes, rows, prescribed


def _frames(rows: Floats) -> tuple[Floats, Ints, Floats]:
    """Return orthonormal frames, axis numbers (-1 for dependent rows), and reach."""
    sites, size = len(rows), rows.shape[2]
    frame, filled = np.zeros((sites, size, size)), np.zeros(sites, dtype=np.int64)

    def append(some: Ints, row: Floats) -> tuple[Ints, Floats]:
        rest = row - np.einsum("nki,nkj,nj->ni", frame[some], frame[some], row)
        length, at = np.linalg.norm(rest, axis=1), filled[some]
        new = length > DIRECTION_TOLERANCE
        frame[some[new], at[new]] = rest[new] / length[new, None]
        filled[some[new]] += 1
        return np.where(new, at, -1), length

    axes, lengths = np.full(rows.shape[:2], -1), np.zeros(rows.shape[:2])
    for k in range(rows.shape[1]):
        axes[:, k], lengths[:, k] = append(np.arange(sites), rows[:, k])
    while len(left := np.flatnonzero(filled < size)):
        append(left, np.eye(size)[np.argmin(np.einsum("nki,nki->ni", frame[left], frame[left]), axis=1)])
    return frame, axes, lengths
