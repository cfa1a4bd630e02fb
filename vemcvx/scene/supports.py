"""Supports, and the freedom that they leave to contact: directions held, normals, nodes dragged along."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from typing import TypeVar

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.effects import ContactSurface, Friction, Obstacle, Support
from vemcvx.errors import SceneError, VemcvxError
from vemcvx.program.system import DRAG_ROUNDING
from vemcvx.scene.jumps import Jumps, Sites, summing
from vemcvx.vem import tangents_of

# Nodal constraints eliminated: u = P y + u_D(t), with P'P = I and the held part u_D orthogonal to P's range.
#
# At each node the prescribed directions are orthonormalised in a fixed order (Gram-Schmidt): what is prescribed
# first, then the normals of bilateral contact, then those that friction and obstacles refer to; the axes fill the
# frame up. The first two kinds are held, the rest are the free unknowns y. A frame so chosen makes every friction
# term touch its own unknowns alone, and sticking exactly representable: y_i = 0. Nodes that contact between bodies
# joins have a frame together, of jumps and what is orthogonal to them: see :mod:`vemcvx.scene.jumps`.


Forces = TypeVar("Forces", Floats, sp.csr_matrix)

PARALLEL = 1e-9
"""Rounding of unit directions that are one."""
STRAIGHT = 1e-2
"""Directions of several conditions that differ by less are one: no mesh is meant to resolve corners of half a degree,
and straight sides with points of four digits have such."""


@dataclass(frozen=True, kw_only=True)
class Supports:
    """The free unknowns of a body, and the motion of the held ones."""

    P: sp.csr_matrix
    """(n_u, n) orthonormal columns, one a free unknown, ordered by site."""
    sites: Sites
    owner: Ints
    """(n,) the site of each free unknown."""
    columns: Ints | None
    """(n,) positions in u when P merely selects (all frames are along the axes), else None."""
    rows: tuple[_Slot, ...]
    points: Floats
    _last: dict[float, Floats] = field(default_factory=dict, compare=False, repr=False)
    """the motion at the instant that was last asked for: in a step it is asked for half a dozen times"""

    @property
    def still(self) -> bool:
        """True if every held value is zero at all times."""
        return all(slot.still for slot in self.rows)

    @cached_property
    def moved(self) -> Ints:
        """The nodal values that supports move, ascending."""
        dim = self.points.shape[1]
        members = [slot.members.ravel() for slot in self.rows if not slot.still]
        nodes = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *members]))
        values: Ints = (nodes[:, None] * dim + np.arange(dim)).ravel()
        return values

    def moves(self, t: float) -> Floats:
        """Their motion at the instant `t`."""
        return self.motion(t)[self.moved]

    def holding(self, nodes: Ints) -> Holding:
        """The directions that hold the sites of k nodes."""
        sites, dim = self.sites.of_node[nodes], self.points.shape[1]
        members = self.sites.members(sites)
        size = members.shape[1] * dim
        each, place = np.unique(sites, return_inverse=True)
        held, contact = np.zeros((len(each), size, size)), np.zeros((len(each), size), dtype=bool)
        filled = np.zeros(len(each), dtype=np.int64)
        for slot in self.rows:
            mine = np.searchsorted(each, slot.sites)
            new = (mine < len(each)) & slot.adds
            new[new] = each[mine[new]] == slot.sites[new]
            if not new.any():
                continue
            at = mine[new]
            held[at, filled[at], : slot.rows.shape[1]] = slot.rows[new, :size]
            contact[at, filled[at]] = slot.support.contact
            filled[at] += 1
        return Holding(members, held[place], contact[place])

    def places(self, nodes: Ints) -> Callable[[int], str]:
        """The place of the i-th of these nodes, in words."""
        return lambda i: f"node {nodes[i]} at {tuple(float(x) for x in np.round(self.points[nodes[i]], 12))}"

    def gather(self, f: Forces) -> Forces:
        """P'f, forces on the free unknowns: a vector (n_u,), or a sparse matrix (n_u, q)."""
        return self.P.T @ f if self.columns is None else f[self.columns]

    def motion(self, t: float) -> Floats:
        """The held displacement u_D (n_u,) at the instant `t`, read-only.

        Raises
        ------
        SceneError
            Two prescriptions at one node contradict each other.
        """
        motion = self._last.get(t)
        if motion is None:
            at_nodes = np.zeros(self.points.shape)
            for slot in self.rows:
                slot.add(at_nodes, t)
            motion = at_nodes.ravel()
            motion.flags.writeable = False
            self._last.clear()
            self._last[t] = motion
        return motion


@dataclass(frozen=True)
class Holding:
    """The directions that hold k sites of up to D / dim nodes; smaller sites are padded with zeros."""

    members: Ints
    """(k, D / dim) the nodes of the site; -1 where it has none left"""
    rows: Floats
    """(k, D, D) the held directions over the values of these nodes, zeros last"""
    contact: Bools
    """(k, D) which of them are contact's"""


@dataclass(frozen=True, kw_only=True)
class _Slot:
    """The k-th constraint of every site that has one: a triangular system site by site."""

    support: Support
    chosen: Ints
    """rows of `support` that fall into this slot"""
    sites: Ints
    """(m,) their sites"""
    members: Ints
    """(m, k) the nodes of these"""
    rows: Floats
    """(m, k dim) what each row reads of the values of these"""
    unit: Floats
    """(m, k dim) the orthonormal direction it adds; zero where it is dependent on earlier ones"""
    length: Floats
    """(m,) what remains of the row after projection"""

    @property
    def adds(self) -> Bools:
        """(m,) which rows are not dependent on earlier ones."""
        return self.length > STRAIGHT

    @property
    def still(self) -> bool:
        return self.support.value is None

    def add(self, motion: Floats, t: float) -> None:
        now = motion[self.members]
        if self.still and not now.any():
            return
        wanted = np.zeros(len(self.chosen)) if self.support.value is None else self.support.value(t)[self.chosen]
        present = np.einsum("ij,ij->i", self.rows, now.reshape(self.rows.shape))
        missing = wanted - present
        new = self.adds
        scale = max(np.abs(wanted).max(initial=0.0), np.abs(present).max(initial=0.0))
        # What is not along earlier directions by no more than that reads motions across them.
        across = 2.0 * self.length * np.abs(now).max(initial=0.0)
        wrong = ~new & (np.abs(missing) > PARALLEL * scale + across)
        if wrong.any() and not self.support.contact:
            row = int(np.argmax(wrong * np.abs(missing)))
            nodes, directions = self.support.nodes[self.chosen], self.support.directions[self.chosen]
            raise SceneError(
                f"{self.support.subject}: node {nodes[row]} at {self.support.points[self.chosen][row]} is to move by "
                f"{wanted[row]:.6g} along {directions[row]} at t = {t:.6g}, but other supports already move it by "
                f"{present[row]:.6g}. Prescribe each direction of a node once."
            )
        step = (missing[new] / self.length[new])[:, None] * self.unit[new]
        motion[self.members[new]] += step.reshape(now[new].shape)


def by_precedence(supports: Sequence[Support]) -> list[Support]:
    """Supports in canonical order, those of contact last: it yields to prescribed displacements."""
    return sorted(supports, key=lambda s: s.contact)


def resolve(supports: Sequence[Support], normals: Sequence[Friction | Obstacle], points: Floats) -> Supports:
    """Choose the frame of every site and split it into held and free directions.

    Parameters
    ----------
    supports, normals
        In canonical order. Of the second, the normals become axes, and the tangents of jumps.
    points : (n_nodes, dim) array
    """
    sites = Sites.joined_by(Jumps.of([*supports, *normals]), len(points))
    ordered = by_precedence(supports)
    frames = [_frames(sites, members, ordered, normals, points) for members in sites.sizes]
    return _free(sites, frames, points)


@dataclass(frozen=True)
class _Frames:
    """The frames of all sites of one size."""

    members: Ints
    """(s, k)"""
    axes: Floats
    """(s, k dim, k dim)"""
    held: Ints
    """(s,) how many of the axes are held, the first ones"""
    slots: list[_Slot]


def _frames(
    sites: Sites, members: Ints, supports: Sequence[Support], normals: Sequence[Friction | Obstacle], points: Floats
) -> _Frames:
    size = members.shape[1] * points.shape[1]
    frame, filled = np.zeros((len(members), size, size)), np.zeros(len(members), dtype=np.int64)
    number = sites.of_node[members[:, 0]]
    place = np.full(len(points), -1)
    place[number] = np.arange(len(members))
    slots: list[_Slot] = []
    for support in supports:
        for chosen, site, jumps in _layers(support, place[sites.of_node]):
            rows = jumps.over(members[site], support.directions[chosen])
            unit, length = _append(frame, filled, site, rows)
            slots.append(
                _Slot(
                    support=support,
                    chosen=chosen,
                    sites=number[site],
                    members=members[site],
                    rows=rows,
                    unit=unit,
                    length=length,
                )
            )
    held = filled.copy()
    for surface in normals:
        for chosen, site, jumps in _layers(surface, place[sites.of_node]):
            _append(frame, filled, site, jumps.over(members[site], surface.normals[chosen]))
            if members.shape[1] > 1:
                for tangents in tangents_of(surface.normals[chosen]).swapaxes(0, 1):
                    _append(frame, filled, site, jumps.over(members[site], tangents))
    _fill_with_axes(frame, filled)
    return _Frames(members, frame, held, slots)


def _layers(part: Support | Friction | Obstacle, place_of_node: Ints) -> list[tuple[Ints, Ints, Jumps]]:
    """Rows of sites that have a place, in layers in which no place occurs twice: which rows, their places, their jumps.

    Of nodes elsewhere the place is -1. The order of the rows of a place is kept.
    """
    jumps = Jumps.of([part])
    place = place_of_node[jumps.nodes]
    order = np.argsort(place, kind="stable")
    order = order[np.searchsorted(place[order], 0) :]
    ranked = place[order]
    start = np.concatenate([[True], ranked[1:] != ranked[:-1]]) if len(order) else np.zeros(0, dtype=bool)
    rank = np.arange(len(order)) - np.maximum.accumulate(np.where(start, np.arange(len(order)), 0))
    layers = [order[rank == k] for k in range(rank.max(initial=-1) + 1)]
    return [(chosen, place[chosen], jumps[chosen]) for chosen in layers]


def _append(frame: Floats, filled: Ints, sites: Ints, rows: Floats) -> tuple[Floats, Floats]:
    """One Gram-Schmidt step at each of `sites` (distinct); returns the new unit vectors and what remains of rows."""
    rest = rows - np.einsum("nki,nkj,nj->ni", frame[sites], frame[sites], rows)
    length = np.linalg.norm(rest, axis=1)
    new = length > STRAIGHT
    unit = np.zeros_like(rest)
    unit[new] = rest[new] / length[new, None]
    frame[sites[new], filled[sites[new]]] = unit[new]
    filled[sites[new]] += 1
    return unit, length


def _fill_with_axes(frame: Floats, filled: Ints) -> None:
    """Complete every frame by the axes least represented in it, so that axis-aligned frames stay exact."""
    size = frame.shape[1]
    empty = filled == 0
    frame[empty] = np.eye(size)
    filled[empty] = size
    for _ in range(size - 1):
        sites = np.flatnonzero(filled < size)
        if len(sites) == 0:
            return
        least = np.argmin(np.einsum("nki,nki->ni", frame[sites], frame[sites]), axis=1)
        _append(frame, filled, sites, np.eye(size)[least])


def _free(sites: Sites, frames: Sequence[_Frames], points: Floats) -> Supports:
    dim, owner, counts, rows, data, place = points.shape[1], [], [], [], [], []
    for frame in frames:
        size = frame.axes.shape[1]
        site, k = np.nonzero(np.arange(size)[None, :] >= frame.held[:, None])
        owner.append(sites.of_node[frame.members[site, 0]])
        counts.append(np.full(len(site), size))
        at = (frame.members[site][:, :, None] * dim + np.arange(dim)).reshape(len(site), size)
        axes = frame.axes[site, k]
        rows.append(at.ravel())
        data.append(axes.ravel())
        # Column by column: reductions over two or three entries take six times as long.
        along_axes = (reduce(np.maximum, np.abs(axes.T)) == 1.0) & (reduce(np.add, axes.T) == 1.0)
        place.append(np.where(along_axes, at[np.arange(len(at)), np.argmax(axes, axis=1)], -1))
    by_site = np.argsort(np.concatenate(owner), kind="stable")
    column = np.empty(len(by_site), dtype=np.int64)
    column[by_site] = np.arange(len(by_site))
    entries = np.concatenate(rows), np.repeat(column, np.concatenate(counts))
    P = sp.coo_matrix((np.concatenate(data), entries), shape=(points.size, len(by_site))).tocsr()
    P.eliminate_zeros()
    columns = np.concatenate(place)[by_site]
    return Supports(
        P=P,
        sites=sites,
        owner=np.concatenate(owner)[by_site],
        columns=columns if (columns >= 0).all() else None,
        rows=tuple(slot for frame in frames for slot in frame.slots),
        points=points,
    )


# What supports leave of contact: normals that are one, nodes that slide, open, or are dragged along.


Part = TypeVar("Part", Friction, Obstacle, ContactSurface)


def merged(
    jumps: Jumps, normals: Floats, signed: bool = False, kinds: Ints | None = None, within: float = PARALLEL
) -> tuple[Ints, Ints]:
    """Rows of one jump, kind and normal (up to sign) are one term: its first row, and the term of every row."""
    pairs, term = jumps.distinct[1], np.full(len(jumps), -1)
    first = [term[:0]]
    while (term < 0).any():
        left = np.flatnonzero(term < 0)
        lead = left[np.unique(pairs[left], return_index=True)[1]]
        leader = np.full(pairs.max() + 1, -1)
        leader[pairs[lead]] = np.arange(len(lead))
        mine = leader[pairs[left]]
        reference = normals[lead[mine]]
        cosine = np.einsum("ij,ij->i", normals[left], reference)
        apart = np.linalg.norm(normals[left] - cosine[:, None] * reference, axis=1)
        same = (apart < within) & ((cosine > 0) | (not signed))
        if kinds is not None:
            same &= kinds[left] == kinds[lead[mine]]
        term[left[same]] = mine[same] + sum(map(len, first))
        first.append(lead)
    return np.concatenate(first), term


def straightened(
    earlier: Sequence[Support | Friction | Obstacle | ContactSurface], parts: Sequence[Part]
) -> tuple[Part, ...]:
    """The parts, with the directions of earlier ones at the same nodes where their normals are nearly these."""
    if not parts:
        return ()
    jumps, everything = Jumps.of([*earlier, *parts]), (*earlier, *parts)
    each = np.concatenate([part.directions if isinstance(part, Support) else part.normals for part in everything])
    first, group = merged(jumps, each, within=STRAIGHT)
    straight = each[first][group]
    straight *= np.sign(np.einsum("ij,ij->i", each, straight))[:, None]
    turned = np.linalg.norm(each - straight, axis=1) > PARALLEL
    normals = np.split(np.where(turned[:, None], straight, each), np.cumsum([len(part.nodes) for part in everything]))
    return tuple(replace(part, normals=own) for part, own in zip(parts, normals[len(earlier) :], strict=False))


# What supports leave of contact: which rows, nodes with normals, slide, open, are dragged, and what presses on them.
#
# A node belongs to contact unless it is held otherwise: where its tangent is free, where its normal is (the axis of a
# half model, whose tangent a support holds), where contact itself holds its normal and a support its tangent, and
# where supports drag it along against friction.
#
# The forces of the d_k that hold a node, R = sum_k r_k d_k, are told apart by their dual basis, r_k = g_k . R. What
# contact has of them is that along its own normal; a single support that moves a node along the normal of contact (an
# obstacle that moves) counts as contact, too. All else is the supports'.


Moving = Callable[[float], Floats]
"""Of t: displacements (k, dim) of what k rows rub on, or their components along the rows."""


@dataclass(frozen=True)
class Freedom:
    """The freedom that supports leave to rows of contact, as arrays (k,)."""

    slides: Bools
    """True if some free unknown moves the node along the boundary"""
    opens: Bools
    """True if some free unknown moves it along the normal"""
    dragged: Bools
    """True if it does not slide, in some direction, and supports move it along the boundary, or the ground under it"""
    held_by_contact: Bools
    """True if contact, and no support, holds the normal; where the node does not slide, supports hold the tangent"""
    normal_reaction: sp.csr_matrix
    """(k, n_u) g, the force with which contact holds the normal being -g . R; zero where it does not hold it"""

    @property
    def normal_only(self) -> Bools:
        """Rows whose tangent is held, and which belong to contact nevertheless for what they press."""
        return ~self.slides & (self.opens | self.held_by_contact)


def freedom(
    jumps: Jumps, normals: Floats, supports: Supports, times: Sequence[float], ground: Moving | None = None
) -> Freedom:
    """The freedom of these rows; whether supports drag them is decided at all of `times`, if there are any.

    Where there is a `ground`, t -> (k, dim), it is their motion relative to it that counts.
    """
    k, dim = normals.shape
    tangents = jumps.matrix(tangents_of(normals), supports.points)
    B = on_free(tangents, supports)
    slides = np.asarray(np.diff(B.indptr).reshape(k, dim - 1).any(axis=1))
    opens = normal_is_free(jumps, normals, supports)
    held = np.flatnonzero(~slides | _rank_deficient(B, dim - 1))
    dragged = np.zeros(k, dtype=bool)
    under = None if ground is None else (lambda t: along(tangents_of(normals[held]), ground(t)[held]))
    dragged[held] = _dragged(tangents[_blocks(held, dim - 1)], jumps[held], supports, times, under)
    return Freedom(slides, opens, dragged, *_normal_reactions(jumps, normals, supports))


def normal_is_free(jumps: Jumps, normals: Floats, supports: Supports) -> Bools:
    """Return True if some free unknown moves the node along the normal, (k,)."""
    free: Bools = np.diff(on_free(normal_rows(jumps, normals, supports.points), supports).indptr) > 0
    return free


def _rank_deficient(B: sp.csr_matrix, block: int) -> Bools:
    """Return True if the free unknowns move a row along fewer than `block` directions, (k,)."""
    rows = [B[axis::block] for axis in range(block)]
    products = np.array([[np.asarray(one.multiply(other).sum(axis=1)).ravel() for other in rows] for one in rows])
    each = np.linalg.eigvalsh(products.transpose(2, 0, 1))
    lean: Bools = each[:, 0] < PARALLEL * each[:, -1]
    return lean


def _dragged(
    tangents: sp.csr_matrix, jumps: Jumps, supports: Supports, times: Sequence[float], ground: Moving | None
) -> Bools:
    """Return True if supports move each of these rows along its tangents between any two instants, (k,)."""
    dragged = np.zeros(len(jumps), dtype=bool)
    if len(jumps) == 0 or (supports.still and ground is None):
        return dragged
    if len(times) == 0:
        if ground is not None:
            return ~dragged
        moved = np.concatenate([slot.support.nodes for slot in supports.rows if not slot.still])
        return np.isin(jumps.nodes, moved) | np.isin(jumps.partners, moved)
    start = None
    for t in times:
        try:
            at = tangents @ supports.motion(float(t))
            at = at if ground is None else at - ground(float(t))
        except VemcvxError:
            return ~dragged  # The step that needs the datum says what is wrong with it.
        start = at if start is None else start
        size = max(np.abs(at).max(), np.abs(start).max())
        dragged |= (np.abs(at - start) > DRAG_ROUNDING * size).reshape(len(jumps), -1).any(axis=1)
        if dragged.all():
            break
    return dragged


def _normal_reactions(jumps: Jumps, normals: Floats, supports: Supports) -> tuple[Bools, sp.csr_matrix]:
    """For each row, True where contact alone holds its normal, and g."""
    holding, points = supports.holding(jumps.nodes), supports.points
    held, contact, count = holding.rows, holding.contact, holding.rows.any(axis=2).sum(axis=1)
    row = jumps.over(holding.members, normals)
    cosine = np.einsum("ikd,id->ik", held, row) / jumps.counts[:, None]
    same = np.linalg.norm(held - cosine[:, :, None] * row[:, None, :], axis=2) < PARALLEL
    same &= held.any(axis=2)
    mine = same & (contact | (count == 1)[:, None])
    dual = np.linalg.pinv(held).transpose(0, 2, 1)
    dual_rows = np.einsum("ik,ik,ikd->id", mine.astype(float), cosine, dual)
    dual_rows = dual_rows.reshape(*holding.members.shape, points.shape[1])
    # Where contact alone holds a node altogether, at its corners, the node is no place of contact.
    held_by_contact = (same & contact).any(axis=1) & (contact.sum(axis=1) == 1)
    at, member = np.nonzero(dual_rows.any(axis=2))
    force = Jumps(holding.members[at, member], np.full(len(at), -1)).matrix(dual_rows[at, member][:, None, :], points)
    return held_by_contact, sp.csr_matrix(summing(at, len(jumps)) @ force)


def on_free(rows: sp.csr_matrix, supports: Supports) -> sp.csr_matrix:
    """B = B^ P without the rounding of t . n = 0 and t . t = 1."""
    B = sp.csr_matrix(rows @ supports.P)
    B.data[np.abs(B.data) < PARALLEL] = 0.0
    unit = np.abs(np.abs(B.data) - 1.0) < PARALLEL
    B.data[unit] = np.sign(B.data[unit])
    B.eliminate_zeros()
    return B


def normal_rows(jumps: Jumps, normals: Floats, points: Floats) -> sp.csr_matrix:
    """(k, n_u) the matrix of n . jump, row by row."""
    return jumps.matrix(normals[:, None, :], points)


def along(tangents: Floats, vectors: Floats) -> Floats:
    """(k * (dim - 1),) the components of vectors (k, dim) along the tangents (k, dim - 1, dim) of each row."""
    components: Floats = np.einsum("kbd,kd->kb", tangents, vectors).ravel()
    return components


def _blocks(rows: Ints, block: int) -> Ints:
    """The positions of blocks of rows."""
    return (rows[:, None] * block + np.arange(block)).ravel()
