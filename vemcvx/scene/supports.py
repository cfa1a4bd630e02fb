"""Conditions at nodes: rows that read them, supports that hold some, and the freedom that these leave to contact.

A row reads the displacement of a node, or its jump to a node of another body at the same place: n . u(i) against an
obstacle, n . (u(i) - u(j)) between bodies, with n the outward normal of the first; likewise along tangents.

A row owns ends of edges at its node, each with half the edge's length: int phi_i over that edge. Parts of the
boundary meet at nodes, overlap, and end inside each other. Rows of several parts that make one term own the union of
their ends, an edge that two parts share counts once, and a row bears the part of another's force that is the share
of the other's length that both own.

Supports prescribe A u = g(t), a row a node (or a pair of nodes) and direction. Eliminated,

    u = P y + H g(t),   A P = 0,   P'P = I,   A H = I,   P'H = 0:

y are the free unknowns, u_D = H g is the held displacement, and H'R the force that each row takes of reactions R.

Nodes that rows join, directly or by way of others, make a *site*; elsewhere every node is a site of its own. A, P
and H are found site by site: Gram-Schmidt makes an orthonormal frame of what is prescribed first, then of the
normals of bilateral contact, then of those that friction and obstacles refer to, and axes fill it up. Rows that
depend on earlier ones are no rows of A. The first two kinds are held, the rest are columns of P: each friction term
so touches its own unknowns alone, and sticking is represented exactly, by y_i = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from vemcvx.arrays import EPS, SAME, Bools, Floats, Ints
from vemcvx.effects import ContactSurface, Friction, Obstacle, Support
from vemcvx.errors import SceneError, VemcvxError
from vemcvx.meshes.polygons import all_found_in, found_in
from vemcvx.program.system import DRAG_ROUNDING
from vemcvx.vem import tangents_of
from vemcvx.vem.boundary import STRAIGHT

Part = TypeVar("Part", Friction, Obstacle, ContactSurface)


def pairs_of(parts: Sequence[Friction | Obstacle | ContactSurface | Support]) -> tuple[Ints, Ints]:
    """The nodes (m,) of the rows of all parts, one part after the other, and their partners (m,), or -1."""
    none = np.zeros(0, dtype=np.int64)
    alone = [np.full(len(part.nodes), -1) if part.partners is None else part.partners for part in parts]
    return np.concatenate([none, *(part.nodes for part in parts)]), np.concatenate([none, *alone])


def pair_numbers(nodes: Ints, partners: Ints, largest: int) -> Ints:
    """One number (m,) for each pair of node and partner, ordered by node; `largest` is that of all nodes."""
    return nodes * (largest + 2) + partners + 1


def distinct_pairs(nodes: Ints, partners: Ints) -> tuple[Ints, Ints]:
    """The first row of each pair of node and partner, ordered by node, and the pair of each row (m,)."""
    numbers = pair_numbers(nodes, partners, int(partners.max(initial=0)))
    _, first, pair = np.unique(numbers, return_index=True, return_inverse=True)
    return first, pair


def jump_rows(nodes: Ints, partners: Ints, directions: Floats, points: Floats) -> sp.csr_matrix:
    """(m * q, n_u) the matrix of d . jump, for q directions (m, q, dim) a row."""
    m, q, dim = directions.shape
    columns = np.repeat(nodes[:, None] * dim + np.arange(dim), q, axis=0).ravel()
    indptr = np.arange(0, m * q * dim + 1, dim)
    own = sp.csr_matrix((directions.ravel(), columns, indptr), shape=(m * q, points.size))
    joined = np.flatnonzero(partners >= 0)
    if len(joined) == 0:
        return own
    other = jump_rows(partners[joined], np.full(len(joined), -1), directions[joined], points)
    return sp.csr_matrix(own - summing((joined[:, None] * q + np.arange(q)).ravel(), m * q) @ other)


def summing(group: Ints, count: int) -> sp.csr_matrix:
    """(count, k) the matrix that adds up rows (k, ...) of one group, their number below `count`."""
    return sp.csr_matrix((np.ones(len(group)), (group, np.arange(len(group)))), shape=(count, len(group)))


@dataclass(frozen=True, kw_only=True)
class ContactRows:
    """Rows of contact.

    One table has the rows of all surfaces, frictions and obstacles of a scene. Terms of friction, limits and the
    surface that is reported are rows of it that were joined, where they are one, and picked, where something can move.
    """

    nodes: Ints  # (m,) the nodes on which rows act; on their partners they act the other way
    partners: Ints  # (m,) nodes of other bodies; -1 where a row reads its node alone
    normals: Floats  # (m, dim) outward unit normals
    ends: sp.csr_matrix  # (m, e) the half lengths of the ends of edges that each row owns
    names: Ints  # (e, 2) of each end its node, and the other node of its edge; -1 for all of a part without `ends`

    @classmethod
    def of(cls, parts: Sequence[Friction | Obstacle | ContactSurface], dim: int) -> ContactRows:
        """The rows of all parts, one after the other."""
        nodes, partners = pairs_of(parts)
        row, beyond, half, first = [nodes[:0]], [nodes[:0]], [np.zeros(0)], 0
        for part in parts:
            own = part.ends
            row.append(first + (np.arange(len(part.nodes)) if own is None else own.row))
            beyond.append(np.full(len(part.nodes), -1) if own is None else own.beyond)
            half.append(part.lengths if own is None else own.lengths)
            first += len(part.nodes)
        rows = np.concatenate(row)
        names = np.column_stack([nodes[rows], np.concatenate(beyond)])
        names, column = np.unique(names, axis=0, return_inverse=True)
        ends = sp.csr_matrix((np.concatenate(half), (rows, column.ravel())), shape=(len(nodes), len(names)))
        normals = np.concatenate([np.zeros((0, dim)), *(part.normals for part in parts)])
        return cls(nodes=nodes, partners=partners, normals=normals, ends=ends, names=names)

    def __len__(self) -> int:
        return len(self.nodes)

    def __getitem__(self, rows: Ints | slice) -> ContactRows:
        picked = {name: column if name == "names" else column[rows] for name, column in self.columns.items()}
        return ContactRows(**picked)

    def owners(self, of: Ints) -> Ints:
        """(e,) the number in `of` (m,) of the row that owns each end; -1 where none of these rows does."""
        each, found = self.ends.tocoo(), np.full(len(self.names), -1)
        found[each.col] = of[each.row]
        return found

    @property
    def columns(self) -> dict[str, Any]:
        """The columns of the table, of which records of terms and limits are made."""
        return {name: getattr(self, name) for name in ("nodes", "partners", "normals", "ends", "names")}

    @cached_property
    def lengths(self) -> Floats:
        """(m,) integrals of the nodal basis functions over the edges of each row: of all parts that meet in it."""
        return np.asarray(self.ends.sum(axis=1)).ravel().astype(float)

    @property
    def distinct(self) -> tuple[Ints, Ints]:
        """The first row of each pair of node and partner, ordered by node, and the pair of each row (m,)."""
        return distinct_pairs(self.nodes, self.partners)

    def find(self, rows: ContactRows) -> Ints:
        """A row (k,) with the node and partner of each of the k `rows`; -1 where there is none."""
        largest = int(max(self.partners.max(initial=0), rows.partners.max(initial=0)))
        known, wanted = (pair_numbers(table.nodes, table.partners, largest) for table in (self, rows))
        return found_in(known, wanted)

    def matrix(self, directions: Floats, points: Floats) -> sp.csr_matrix:
        """(m * q, n_u) the matrix of d . jump, for q directions (m, q, dim) a row."""
        return jump_rows(self.nodes, self.partners, directions, points)

    def joined(self, first: Ints, group: Ints) -> ContactRows:
        """One row a group, with the node and normal of its `first` row; ends that several rows own count once."""
        each, (count, width) = self.ends.tocoo(), (len(first), self.ends.shape[1])
        key, place = np.unique(group[each.row] * width + each.col, return_inverse=True)
        length = np.zeros(len(key))
        np.maximum.at(length, place, each.data)
        ends = sp.csr_matrix((length, np.divmod(key, max(width, 1))), shape=(count, width))
        return replace(self[first], ends=ends)

    def shares(self, of: ContactRows) -> sp.csr_matrix:
        """(m, r) which share of a force on each of r rows the edges of these rows bear."""
        common = sp.csr_matrix((self.ends > 0).astype(float) @ of.ends.T)
        return sp.csr_matrix(common @ sp.diags_array(1.0 / of.lengths))


def merged(
    pairs: tuple[Ints, Ints], normals: Floats, signed: bool = False, kinds: Ints | None = None, within: float = SAME
) -> tuple[Ints, Ints]:
    """Rows of one pair, kind and normal (up to sign) are one term: its first row, and the term of every row."""
    place = distinct_pairs(*pairs)[1]
    term, first = np.full(len(place), -1), [np.zeros(0, dtype=np.int64)]
    while (left := np.flatnonzero(term < 0)).size:
        # The first row left of each pair leads; the rows that are as it is follow.
        lead, mine = np.unique(place[left], return_index=True, return_inverse=True)[1:]
        leader = left[lead][mine]
        cosine = np.einsum("ij,ij->i", normals[left], normals[leader])
        apart = np.linalg.norm(normals[left] - cosine[:, None] * normals[leader], axis=1)
        same = (apart < within) & ((cosine > 0) | (not signed))
        if kinds is not None:
            same &= kinds[left] == kinds[leader]
        term[left[same]] = mine[same] + sum(map(len, first))
        first.append(left[lead])
    return np.concatenate(first), term


def straightened(earlier: Sequence[Support | Friction | Obstacle], parts: Sequence[Part]) -> tuple[Part, ...]:
    """The parts, with the directions of earlier ones at the same nodes where their normals are nearly these.

    Supports are first among these. Those that hold a node altogether give it none: theirs are axes, as a rule, and
    along these a node that is lifted off a floor half a degree askew would rub on it by a hundredth of the way.
    """
    if not parts:
        return ()
    everything = (*earlier, *parts)
    each = np.concatenate([part.directions if isinstance(part, Support) else part.normals for part in everything])
    pairs, given = pairs_of(everything), sum(len(part.nodes) for part in earlier if isinstance(part, Support))
    place, lead = distinct_pairs(*pairs)[1], merged(pairs, each, within=STRAIGHT)[0]
    altogether = np.bincount(place[lead[lead < given]], minlength=len(place)) >= each.shape[1]
    of_those = np.where(np.arange(len(place)) < given, altogether[place], 0)
    first, group = merged(pairs, each, kinds=of_those, within=STRAIGHT)
    straight = each[first][group]
    straight *= np.sign(np.einsum("ij,ij->i", each, straight))[:, None]
    turned = np.linalg.norm(each - straight, axis=1) > SAME
    normals = np.split(np.where(turned[:, None], straight, each), np.cumsum([len(part.nodes) for part in everything]))
    return tuple(replace(part, normals=own) for part, own in zip(parts, normals[len(earlier) :], strict=False))


Forces = TypeVar("Forces", Floats, sp.csr_matrix)


@dataclass(frozen=True, kw_only=True)
class Supports:
    """The free unknowns of a body, and the motion of the held ones."""

    P: sp.csr_matrix  # (n_u, n) orthonormal columns, one a free unknown, ordered by site
    columns: Ints | None  # (n,) positions in u where P merely selects (all frames are along the axes), else None
    owner: Ints  # (n,) the site of each free unknown
    sites: Ints  # (n_nodes,) the site of every node, numbered by their first nodes
    points: Floats
    given: Sequence[Support]  # those that make the rows of A, one after the other
    A: sp.csr_matrix  # (s, n_u) what is prescribed
    H: sp.csr_matrix  # (n_u, s) displacements that hold one row at 1, others at 0; zero for rows that depend on others
    depends: Bools  # (s,) which rows depend on earlier ones
    reach: Floats  # (s,) the length of a row's part across earlier ones
    _last: dict[float, Floats] = field(default_factory=dict, compare=False, repr=False)
    """the motion at the instant that was last asked for: in a step it is asked for half a dozen times"""

    @cached_property
    def still(self) -> bool:
        """True if every held value is zero at all times."""
        return all(support.value is None for support in self.given)

    @cached_property
    def moved(self) -> Ints:
        """The nodal values at nodes that supports move, ascending."""
        dim, moving = self.points.shape[1], self._of_rows([support.value is not None for support in self.given])
        nodes = np.unique(self.H[:, np.flatnonzero(moving)].nonzero()[0] // dim)
        return (nodes[:, None] * dim + np.arange(dim)).ravel()

    @cached_property
    def contact(self) -> Bools:
        """(s,) which rows are contact's."""
        return self._of_rows([support.contact for support in self.given])

    def _of_rows(self, flags: Sequence[bool]) -> Bools:
        return np.repeat(np.array(flags, dtype=bool), [len(support.nodes) for support in self.given])

    def places(self, nodes: Ints) -> Callable[[int], str]:
        """The place of the i-th of these nodes, in words."""
        return lambda i: f"node {nodes[i]} at {tuple(float(x) for x in np.round(self.points[nodes[i]], 12))}"

    def gather(self, f: Forces) -> Forces:
        """P'f, forces on the free unknowns: a vector (n_u,), or a sparse matrix (n_u, q)."""
        return self.P.T @ f if self.columns is None else f[self.columns]

    def motion(self, t: float) -> Floats:
        """The held displacement u_D (n_u,) at an instant, read-only; SceneError for contradicting prescriptions."""
        motion = self._last.get(t)
        if motion is None:
            none = [np.zeros(0)]
            each = [np.zeros(len(s.nodes)) if s.value is None else np.asarray(s.value(t)) for s in self.given]
            motion = np.asarray(self.H @ np.concatenate([*none, *each]))
            if not self.still:
                self._check(motion, each, t)
            motion.flags.writeable = False
            self._last.clear()
            self._last[t] = motion
        return motion

    def _check(self, motion: Floats, each: Sequence[Floats], t: float) -> None:
        """Raise SceneError if a row that depends on others reads another value than its own."""
        present, size, first = self.A @ motion, np.abs(motion).max(initial=0.0), 0
        for support, wanted in zip(self.given, each, strict=True):
            rows = slice(first, first := first + len(wanted))
            missing = np.where(self.depends[rows], np.abs(wanted - present[rows]), 0.0)
            scale = max(np.abs(wanted).max(initial=0.0), np.abs(present[rows]).max(initial=0.0))
            # A row that is not quite along earlier ones reads what moves across them, too.
            wrong = missing > SAME * scale + 2.0 * self.reach[rows] * size
            if wrong.any() and not support.contact:
                row = int(np.argmax(wrong * missing))
                raise SceneError(
                    f"{support.subject}: node {support.nodes[row]} at {support.points[row]} is to move by "
                    f"{wanted[row]:.6g} along {support.directions[row]} at t = {t:.6g}, but other supports already "
                    f"move it by {present[rows][row]:.6g}. Prescribe each direction of a node once."
                )


def by_precedence(supports: Sequence[Support]) -> list[Support]:
    """Supports in canonical order, those of contact last: it yields to prescribed displacements."""
    return sorted(supports, key=lambda s: s.contact)


def resolve(supports: Sequence[Support], normals: Sequence[Friction | Obstacle], points: Floats) -> Supports:
    """Choose the frame of every site and split it into held and free directions.

    Supports and normals are in canonical order; the normals become axes, and the tangents of jumps.
    """
    dim, given = points.shape[1], by_precedence(supports)
    pairs, across = pairs_of(given), pairs_of(normals)
    site = _sites(np.append(pairs[0], across[0]), np.append(pairs[1], across[1]), len(points))
    directions = np.concatenate([points[:0], *(support.directions for support in given)])
    axes = np.concatenate([points[:0], *(part.normals for part in normals)])
    A = jump_rows(*pairs, directions[:, None], points)
    # Of jumps the tangents follow the normal.
    N = jump_rows(*across, np.concatenate([axes[:, None], tangents_of(axes)], axis=1), points)
    follow = (np.arange(N.shape[0]) % dim == 0) | np.repeat(np.bincount(site)[site[across[0]]] > 1, dim)

    chosen, place = np.unique(site[np.append(pairs[0], across[0])], return_inverse=True)
    members = _members(site, chosen, dim)
    frames = _Frames(np.eye(members.shape[1]) * (members < 0)[:, :, None], (members >= 0).sum(axis=1))
    local = np.zeros(points.size, dtype=np.int64)
    local[members[members >= 0]] = np.nonzero(members >= 0)[1]
    read = _dense(A, local, members.shape[1])
    at, reach = frames.append(place[: len(pairs[0])], read)
    held = frames.filled.copy()
    several = np.flatnonzero(follow)
    frames.append(np.repeat(place[len(pairs[0]) :], dim)[several], _dense(N[several], local, members.shape[1]))
    frames.fill_with_axes()
    new = np.flatnonzero(at >= 0)
    P, owner = _free_axes(frames, held, members, site, points)
    by_columns = sp.csc_matrix(P)
    selects = by_columns.nnz == by_columns.shape[1] and (by_columns.data == 1.0).all()
    return Supports(
        P=P,
        columns=by_columns.indices.astype(np.int64) if selects else None,
        owner=owner,
        sites=site,
        points=points,
        given=given,
        A=A,
        H=_holding(frames, members, (place[new], at[new], new), read, A.shape),
        depends=at < 0,
        reach=reach,
    )


def _sites(nodes: Ints, partners: Ints, n_nodes: int) -> Ints:
    """The site of every node (n_nodes,), numbered by their first nodes."""
    joined = partners >= 0
    if not joined.any():
        return np.arange(n_nodes)
    entries = np.ones(joined.sum()), (nodes[joined], partners[joined])
    label = connected_components(sp.csr_matrix(entries, shape=(n_nodes, n_nodes)), directed=False)[1]
    first, site = np.unique(label, return_index=True, return_inverse=True)[1:]
    return np.argsort(np.argsort(first))[site]


def _members(site: Ints, chosen: Ints, dim: int) -> Ints:
    """The nodal values (S, D) of the chosen of the sites (n_nodes,); -1 where a site has none left."""
    place = np.full(site.max() + 1, -1)
    place[chosen] = np.arange(len(chosen))
    node = np.flatnonzero(place[site] >= 0)
    node = node[np.argsort(place[site[node]], kind="stable")]
    row = place[site[node]]
    column = np.arange(len(node)) - np.searchsorted(row, row)
    members = np.full((len(chosen), int(column.max(initial=0)) + 1, dim), -1)
    members[row, column] = node[:, None] * dim + np.arange(dim)
    return members.reshape(len(chosen), dim * members.shape[1])


def _dense(rows: sp.csr_matrix, local: Ints, size: int) -> Floats:
    """Rows (m, D) over the values of their sites, from rows over all."""
    entries, read = rows.tocoo(), np.zeros((rows.shape[0], size))
    read[entries.row, local[entries.col]] = entries.data
    return read


class _Frames:
    """Orthonormal frames of S sites as they are built, row by row."""

    def __init__(self, axes: Floats, sizes: Ints):
        self.axes, self.sizes, self.filled = axes, sizes, np.zeros(len(sizes), dtype=np.int64)

    def append(self, place: Ints, read: Floats) -> tuple[Ints, Floats]:
        """Append rows (m, D) in turn to the frames of their sites: which axis each gave, -1 for none; and its reach."""
        order, turn = np.argsort(place, kind="stable"), np.empty_like(place)
        turn[order] = np.arange(len(place)) - np.searchsorted(place[order], place[order])
        at, reach = np.full(len(place), -1), np.zeros(len(place))
        for k in range(int(turn.max(initial=-1)) + 1):
            mine = np.flatnonzero(turn == k)
            at[mine], reach[mine] = self._append(place[mine], read[mine])
        return at, reach

    def _append(self, site: Ints, read: Floats) -> tuple[Ints, Floats]:
        """One Gram-Schmidt step at sites that differ."""
        frame = self.axes[site]
        rest = read - np.einsum("nki,nkj,nj->ni", frame, frame, read)
        length, at = np.linalg.norm(rest, axis=1), self.filled[site]
        new = length > STRAIGHT
        self.axes[site[new], at[new]] = rest[new] / length[new, None]
        self.filled[site[new]] += 1
        return np.where(new, at, -1), length

    def fill_with_axes(self) -> None:
        """Complete every frame by the axes least represented in it, so that axis-aligned frames stay exact."""
        while len(left := np.flatnonzero(self.filled < self.sizes)):
            least = np.argmin(np.einsum("nki,nki->ni", self.axes[left], self.axes[left]), axis=1)
            self._append(left, np.eye(self.axes.shape[1])[least])


def _free_axes(frames: _Frames, held: Ints, members: Ints, site: Ints, points: Floats) -> tuple[sp.csr_matrix, Ints]:
    """P, of the axes of frames that are not held, and those of nodes that no row reads; the site of each column."""
    dim, among = points.shape[1], np.zeros(points.size, dtype=bool)
    among[members[members >= 0]] = True
    others = np.flatnonzero(~among)
    place, axis = np.nonzero((np.arange(members.shape[1]) >= held[:, None]) & (members >= 0))
    owner = site[np.concatenate([members[place, 0], others]) // dim]
    order, column = np.argsort(owner, kind="stable"), np.empty(len(owner), dtype=np.int64)
    column[order] = np.arange(len(order))
    entries = frames.axes[place, axis]
    row, k = np.nonzero(np.abs(entries) > EPS)  # Entries of unit vectors below EPS are rounding.
    data = np.append(entries[row, k], np.ones(len(others)))
    where = np.append(members[place[row], k], others), np.append(column[row], column[len(place) :])
    return sp.csr_matrix((data, where), shape=(points.size, len(owner))), owner[order]


def _holding(
    frames: _Frames, members: Ints, held: tuple[Ints, Ints, Ints], read: Floats, shape: tuple[int, int]
) -> sp.csr_matrix:
    """H, from the place, the axis and the number of each row of A that holds."""
    place, at, row = held
    rows = frames.axes.copy()
    rows[place, at] = read[row]
    # Axes that are not held are across all rows, and so to the inverse.
    lifted = np.linalg.inv(rows)[place, :, at]
    one, k = np.nonzero((lifted != 0) & (members[place] >= 0))
    return sp.csr_matrix((lifted[one, k], (members[place[one], k], row[one])), shape=shape[::-1])


# The freedom of contact: which rows, nodes with normals, slide, open or are dragged, and which forces press on them.
#
# A node belongs to contact unless it is held otherwise: where its tangent is free, where its normal is (the axis of a
# half model, whose tangent a support holds), where contact itself holds its normal and a support its tangent, and
# where supports drag it along against friction.
#
# Of the forces H'R that hold a node, the part along the normal of contact is contact's; a single support that moves a
# node along that normal (an obstacle that moves) counts as contact, too. All other parts are the supports'.


Moving = Callable[[float], Floats]
"""t -> displacements (k, dim) of the ground under k rows, or their components along the rows."""


@dataclass(frozen=True)
class Freedom:
    """The freedom that supports leave to rows of contact, as arrays (k,)."""

    slides: Bools  # True if some free unknown moves the node along the boundary
    dragged: Bools  # if it does not slide, in some direction, and supports or the ground move along the boundary
    normal_only: Bools  # if its tangent is held, but its normal is contact's: it has a pressure


def freedom(
    rows: ContactRows,
    supports: Supports,
    times: Sequence[float],
    ground: Moving | None = None,
    *,
    tangents: Floats | None = None,
) -> Freedom:
    """The freedom of these rows; they are dragged if supports move them between any two of `times`.

    With a `ground`, t -> (k, dim), motions are relative to it. Rows of friction slide along `tangents` (k, dim - 1,
    dim), by default those of their normals.
    """
    k, dim = rows.normals.shape
    tangents = tangents_of(rows.normals) if tangents is None else tangents
    reads = rows.matrix(tangents, supports.points)
    B = on_free(reads, supports)
    # How much free unknowns move each row along its tangents: eigenvalues (k, dim - 1), ascending; zero where not.
    parts = [B[axis :: dim - 1] for axis in range(dim - 1)]
    products = np.array([[np.asarray(one.multiply(other).sum(axis=1)).ravel() for other in parts] for one in parts])
    each = np.linalg.eigvalsh(products.transpose(2, 0, 1))
    slides, held = each[:, -1] > 0, np.flatnonzero(each[:, 0] <= SAME * each[:, -1])
    dragged = np.zeros(k, dtype=bool)
    if len(held) and not (supports.still and ground is None):
        under = None if ground is None else (lambda t: along(tangents[held], ground(t)[held]))
        of_held = (held[:, None] * (dim - 1) + np.arange(dim - 1)).ravel()
        dragged[held] = _dragged(reads[of_held], rows[held], supports, times, under)
    normal_only = np.zeros(k, dtype=bool)
    if not slides.all():
        normal_only = ~slides & (normal_is_free(rows, supports) | _held_normals(rows, supports)[0])
    return Freedom(slides, dragged, normal_only)


def normal_is_free(rows: ContactRows, supports: Supports) -> Bools:
    """Return True if some free unknown moves the node along the normal, (k,)."""
    return np.diff(on_free(normal_rows(rows, supports.points), supports).indptr) > 0


def _dragged(
    tangents: sp.csr_matrix, rows: ContactRows, supports: Supports, times: Sequence[float], ground: Moving | None
) -> Bools:
    """Return True if supports move each of these rows along its tangents between any two instants, (k,)."""
    dragged = np.zeros(len(rows), dtype=bool)
    if len(times) == 0:
        moved = supports.moved // supports.points.shape[1]
        return ~dragged if ground is not None else np.isin(rows.nodes, moved) | np.isin(rows.partners, moved)
    start = None
    for t in times:
        try:
            at = tangents @ supports.motion(float(t))
            at = at if ground is None else at - ground(float(t))
        except VemcvxError:
            return ~dragged  # The step that needs the datum says what is wrong with it.
        start = at if start is None else start
        size = max(np.abs(at).max(), np.abs(start).max())
        dragged |= (np.abs(at - start) > DRAG_ROUNDING * size).reshape(len(rows), -1).any(axis=1)
        if dragged.all():
            break
    return dragged


def normal_reactions(rows: ContactRows, supports: Supports) -> sp.csr_matrix:
    """g (k, n_u): contact holds the normal of each of k rows with the force -g . R of reactions R; zero elsewhere."""
    entries, places = _held_normals(rows, supports)[1:]
    return sp.csr_matrix(sp.csr_matrix((entries, places), shape=(len(rows), len(supports.depends))) @ supports.H.T)


def _held_normals(rows: ContactRows, supports: Supports) -> tuple[Bools, Floats, tuple[Ints, Ints]]:
    """True where contact alone holds the normal of a row, (k,).

    Besides, the cosines between the normals of rows and those rows of A by which contact holds them, and their places.
    """
    (nodes, partners), holds = pairs_of(supports.given), np.flatnonzero(~supports.depends)
    directions = np.concatenate([supports.points[:0], *(support.directions for support in supports.given)])[holds]
    nodes, partners, contact = nodes[holds], partners[holds], supports.contact[holds]
    # The pairs of a row and what holds its node, or its node and partner, whichever of these is named first.
    wanted, known = (
        pair_numbers(np.maximum(*pair), np.minimum(*pair), len(supports.points))
        for pair in ((rows.nodes, rows.partners), (nodes, partners))
    )
    row, col = all_found_in(known, wanted)
    cosine = np.einsum("ij,ij->i", directions[col], rows.normals[row])
    same = np.linalg.norm(directions[col] - cosine[:, None] * rows.normals[row], axis=1) < SAME
    row, col, cosine = row[same], col[same], cosine[same] * np.where(nodes[col] == rows.nodes[row], 1.0, -1.0)[same]
    # How many rows hold the site of each row, and how many of these are contact's.
    site, mine, size = supports.sites[nodes], supports.sites[rows.nodes], len(supports.sites)
    count, of_contact = np.bincount(site, minlength=size)[mine], np.bincount(site[contact], minlength=size)[mine]
    held_by_contact = np.zeros(len(rows), dtype=bool)
    # Where contact alone holds a node altogether, at its corners, the node is no place of contact.
    held_by_contact[row[contact[col]]] = True
    takes = contact[col] | (count[row] == 1)
    return held_by_contact & (of_contact == 1), cosine[takes], (row[takes], holds[col[takes]])


def on_free(rows: sp.csr_matrix, supports: Supports) -> sp.csr_matrix:
    """B = B^ P without the rounding of t . n = 0 and t . t = 1."""
    B: sp.csr_matrix = rows @ supports.P
    B.data[np.abs(B.data) < SAME] = 0.0
    unit = np.abs(np.abs(B.data) - 1.0) < SAME
    B.data[unit] = np.sign(B.data[unit])
    B.eliminate_zeros()
    return B


def normal_rows(rows: ContactRows, points: Floats) -> sp.csr_matrix:
    """(k, n_u) the matrix of n . jump, row by row."""
    return rows.matrix(rows.normals[:, None, :], points)


def along(tangents: Floats, vectors: Floats) -> Floats:
    """(k * (dim - 1),) the components of vectors (k, dim) along the tangents (k, dim - 1, dim) of each row."""
    return np.einsum("kbd,kd->kb", tangents, vectors).ravel()


def free_directions(P: sp.csr_matrix, corners: Ints, side: Ints, dim: int) -> Floats:
    """(b, dim, dim) projectors on the span of what is free at the corners of each side, nodes (c,) of sides (c,)."""
    nodes, place = np.unique(corners, return_inverse=True)
    rows = P[(dim * nodes[:, None] + np.arange(dim)).ravel()]
    gram = sp.bsr_matrix(rows @ rows.T, blocksize=(dim, dim)).tocoo()
    own = np.zeros((len(nodes), dim, dim))
    near = gram.row // dim == gram.col // dim
    own[gram.row[near] // dim, gram.row[near] % dim, gram.col[near] % dim] = gram.data[near]
    freedom = np.zeros((int(side.max(initial=-1)) + 1, dim, dim))
    np.add.at(freedom, side, own[place])
    values, vectors = np.linalg.eigh(freedom)
    # A direction in which all corners of a side move by less than this part of their freedom is held.
    kept = np.where(values > 1e-9, 1.0, 0.0)
    return np.einsum("bik,bk,bjk->bij", vectors, kept, vectors)
