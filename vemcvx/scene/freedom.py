"""What supports leave of contact: which rows, nodes with normals, slide, open, are dragged, and what presses on them.

A node belongs to contact unless it is held otherwise: where its tangent is free, where its normal is (the axis of a
half model, whose tangent a support holds), where contact itself holds its normal and a support its tangent, and where
supports drag it along against friction.

The forces of the d_k that hold a node, R = sum_k r_k d_k, are told apart by their dual basis, r_k = g_k . R. What
contact has of them is that along its own normal; a single support that moves a node along the normal of contact (an
obstacle that moves) counts as contact, too. All else is the supports'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.errors import VemcvxError
from vemcvx.scene.supports import PARALLEL, Supports

STILL = 16 * float(np.finfo(float).eps)
"""Positions that differ by less, relative to the largest, are one: what rounding leaves of a datum drags nothing."""


@dataclass(frozen=True)
class Freedom:
    """How the rows of contact are held, (k,) each."""

    slides: Bools
    """whether some free unknown moves the node along the boundary"""
    opens: Bools
    """whether some free unknown moves it along the normal"""
    dragged: Bools
    """whether it does not slide, and supports move it along the boundary"""
    leans: Bools
    """whether contact holds the normal, and supports all the rest"""
    grips: Floats
    """(k, dim) g, the force with which contact holds the normal being -g . R; zero where it does not hold it"""

    @property
    def beside(self) -> Bools:
        """Rows whose tangent is held, and which belong to contact nevertheless for what they press."""
        return ~self.slides & (self.opens | self.leans)


def freedom(nodes: Ints, normals: Floats, supports: Supports, times: Sequence[float]) -> Freedom:
    """How these rows are held; whether supports drag them is looked up at all of `times`, if there are any."""
    k, dim = normals.shape
    tangents, across = tangential_rows(nodes, normals, supports.points), normal_rows(nodes, normals, supports.points)
    slides = np.asarray(np.diff(on_free(tangents, supports).indptr).reshape(k, dim - 1).any(axis=1))
    opens = np.diff(on_free(across, supports).indptr) > 0
    held = np.flatnonzero(~slides)
    dragged = np.zeros(k, dtype=bool)
    dragged[held] = _dragged(tangents[_blocks(held, dim - 1)], nodes[held], supports, times)
    return Freedom(slides, opens, dragged, *_grips(nodes, normals, supports))


def _dragged(tangents: sp.csr_matrix, nodes: Ints, supports: Supports, times: Sequence[float]) -> Bools:
    """Whether supports move each of these rows along its tangents between any two instants, (k,)."""
    dragged = np.zeros(len(nodes), dtype=bool)
    if len(nodes) == 0 or supports.still:
        return dragged
    if len(times) == 0:
        return np.isin(nodes, np.concatenate([slot.support.nodes for slot in supports.rows if not slot.still]))
    start = None
    for t in times:
        try:
            at = tangents @ supports.motion(float(t))
        except VemcvxError:
            return ~dragged  # The step that needs the datum says what is wrong with it.
        start = at if start is None else start
        size = max(np.abs(at).max(), np.abs(start).max())
        dragged |= (np.abs(at - start) > STILL * size).reshape(len(nodes), -1).any(axis=1)
        if dragged.all():
            break
    return dragged


def _grips(nodes: Ints, normals: Floats, supports: Supports) -> tuple[Bools, Floats]:
    """Of each row, whether it leans, and g."""
    each, at = np.unique(nodes, return_inverse=True)
    held, contact = supports.directions(each)
    count = held.any(axis=2).sum(axis=1)
    along = np.einsum("ikd,id->ik", held[at], normals)
    same = np.linalg.norm(held[at] - along[:, :, None] * normals[:, None, :], axis=2) < PARALLEL
    same &= held[at].any(axis=2)
    mine = same & (contact[at] | (count[at] == 1)[:, None])
    dual = np.linalg.pinv(held).transpose(0, 2, 1)
    grips = np.einsum("ik,ik,ikd->id", mine.astype(float), along, dual[at])
    # Where contact alone holds a node altogether, at its corners, the node is no place of contact.
    leans = (same & contact[at]).any(axis=1) & (contact.sum(axis=1) == 1)[at] & (count == normals.shape[1])[at]
    return leans, grips


def on_free(rows: sp.csr_matrix, supports: Supports) -> sp.csr_matrix:
    """B = B^ P without the rounding of t . n = 0 and t . t = 1."""
    B = sp.csr_matrix(rows @ supports.P)
    B.data[np.abs(B.data) < PARALLEL] = 0.0
    unit = np.abs(np.abs(B.data) - 1.0) < PARALLEL
    B.data[unit] = np.sign(B.data[unit])
    B.eliminate_zeros()
    return B


def normal_rows(nodes: Ints, normals: Floats, points: Floats) -> sp.csr_matrix:
    """(k, n_u) the matrix of n . u(node), row by row."""
    k, dim = normals.shape
    columns = (nodes[:, None] * dim + np.arange(dim)).ravel()
    return sp.csr_matrix((normals.ravel(), columns, np.arange(0, k * dim + 1, dim)), shape=(k, points.size))


def tangential_rows(nodes: Ints, normals: Floats, points: Floats) -> sp.csr_matrix:
    """(k * (dim - 1), n_u) orthonormal tangents of each row."""
    k, dim = normals.shape
    # The right singular vectors beyond the first span the plane across the normal.
    tangents = _across(normals)
    columns = np.repeat(nodes[:, None] * dim + np.arange(dim), dim - 1, axis=0)
    indptr = np.arange(0, k * (dim - 1) * dim + 1, dim)
    return sp.csr_matrix((tangents.reshape(-1), columns.ravel(), indptr), shape=(k * (dim - 1), points.size))


def _across(normals: Floats) -> Floats:
    """(k, dim - 1, dim) orthonormal vectors across each normal; exact where the normal is an axis."""
    dim = normals.shape[1]
    if dim == 2:
        return np.stack([-normals[:, 1], normals[:, 0]], axis=1)[:, None, :]
    return np.linalg.svd(normals[:, None, :])[2][:, 1:, :]


def _blocks(rows: Ints, block: int) -> Ints:
    """The positions of blocks of rows."""
    return (rows[:, None] * block + np.arange(block)).ravel()
