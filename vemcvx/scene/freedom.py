"""What supports leave of contact: normals that are one, nodes that slide, open, or are dragged along."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.effects import ContactSurface, Friction, Obstacle, Support
from vemcvx.errors import VemcvxError
from vemcvx.program.system import DRAG_ROUNDING
from vemcvx.scene.jumps import Jumps, summing
from vemcvx.scene.supports import PARALLEL, STRAIGHT, Supports
from vemcvx.vem import tangents_of

# Which rows of contact have one normal: those of one node, or pair of nodes, up to rounding.
#
# Parts of a side that are named apart have normals of their own at the node where they meet, which differ by what the
# points of a straight side are rounded.


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
    """How the rows of contact are held, (k,) each."""

    slides: Bools
    """whether some free unknown moves the node along the boundary"""
    opens: Bools
    """whether some free unknown moves it along the normal"""
    dragged: Bools
    """whether it does not slide, in some direction, and supports move it along the boundary, or the ground under it"""
    held_by_contact: Bools
    """whether contact, and no support, holds the normal; where the node does not slide, supports hold the tangent"""
    normal_reaction: sp.csr_matrix
    """(k, n_u) g, the force with which contact holds the normal being -g . R; zero where it does not hold it"""

    @property
    def normal_only(self) -> Bools:
        """Rows whose tangent is held, and which belong to contact nevertheless for what they press."""
        return ~self.slides & (self.opens | self.held_by_contact)


def freedom(
    jumps: Jumps, normals: Floats, supports: Supports, times: Sequence[float], ground: Moving | None = None
) -> Freedom:
    """How these rows are held; whether supports drag them is looked up at all of `times`, if there are any.

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
    """Whether some free unknown moves the node along the normal, (k,)."""
    free: Bools = np.diff(on_free(normal_rows(jumps, normals, supports.points), supports).indptr) > 0
    return free


def _rank_deficient(B: sp.csr_matrix, block: int) -> Bools:
    """Whether the free unknowns move a row along fewer than `block` directions, (k,)."""
    rows = [B[axis::block] for axis in range(block)]
    products = np.array([[np.asarray(one.multiply(other).sum(axis=1)).ravel() for other in rows] for one in rows])
    each = np.linalg.eigvalsh(products.transpose(2, 0, 1))
    lean: Bools = each[:, 0] < PARALLEL * each[:, -1]
    return lean


def _dragged(
    tangents: sp.csr_matrix, jumps: Jumps, supports: Supports, times: Sequence[float], ground: Moving | None
) -> Bools:
    """Whether supports move each of these rows along its tangents between any two instants, (k,)."""
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
    """Of each row, whether contact alone holds its normal, and g."""
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
