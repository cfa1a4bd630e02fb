"""The norm terms of friction, and the surface of contact, over all nodal values.

A friction effect brings one row a node and distinct normal; rows of one node with one normal are one term, whose
weights add up, and a term that no free unknown can move is dropped. Over u its matrix is B^ (orthonormal
tangents); over the free unknowns it is B = B^ P.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.effects import ContactSurface, Friction
from vemcvx.errors import SceneWarning
from vemcvx.scene.supports import PARALLEL, Supports

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Terms:
    """The norm terms of a posed scene, over all nodal values."""

    rows: sp.csr_matrix
    """(m * (dim - 1), n_u) B^, orthonormal tangents"""
    nodes: Ints
    lengths: Floats
    """(m,) integrals of the nodal basis functions over the edges with friction"""
    weights: Callable[[float], Floats]
    pressed: Callable[[float, Sequence[Floats]], Floats] | None = None
    """(t, normal forces of every friction's rows) -> (m,), the weights where some depend on the pressure"""
    frictions: Sequence[Friction] = ()
    bias: Callable[[float], Floats] | None = None
    """t -> (m,), along the tangent of each row; None if there is none"""


def friction_terms(frictions: Sequence[Friction], supports: Supports, points: Floats) -> Terms:
    """The terms of all frictions where something can slip; equal node and normal make one term."""
    dim = points.shape[1]
    if not frictions:
        none = np.zeros(0)
        return Terms(sp.csr_matrix((0, points.size)), none.astype(np.int64), none, lambda t: none)
    nodes = np.concatenate([f.nodes for f in frictions])
    normals = np.concatenate([f.normals for f in frictions])
    first, term = _merge(nodes, normals)
    rows = tangential_rows(nodes[first], normals[first], points)
    slides = np.diff(on_free(rows, supports).indptr).reshape(len(first), dim - 1).any(axis=1)
    gather = sp.csr_matrix((np.ones(len(term)), (term, np.arange(len(term)))), shape=(len(first), len(term)))
    gather = gather[np.flatnonzero(slides)]
    lengths = np.zeros(len(first))
    np.maximum.at(lengths, term, np.concatenate([f.lengths for f in frictions]))

    def weights(t: float) -> Floats:
        return gather @ np.concatenate([f.weights(t) for f in frictions])

    def pressed(t: float, forces: Sequence[Floats]) -> Floats:
        parts = [
            f.weights(t) if f.law is None else f.weights(t) + f.law(t, P)
            for f, P in zip(frictions, forces, strict=True)
        ]
        return gather @ np.concatenate(parts)

    along = np.einsum("ij,ij->i", normals, normals[first][term])

    def bias(t: float) -> Floats:
        each = [np.zeros(len(f.nodes)) if f.bias is None else f.bias(t) for f in frictions]
        return gather @ (np.sign(along) * np.concatenate(each))

    kept = np.flatnonzero(np.repeat(slides, dim - 1))
    depends = pressed if any(f.law is not None for f in frictions) else None
    tilts = bias if any(f.bias is not None for f in frictions) else None
    return Terms(sp.csr_matrix(rows[kept]), nodes[first][slides], lengths[slides], weights, depends, frictions, tilts)


def warn_of_loose_normals(frictions: Sequence[Friction], supports: Supports, stopped: Ints, points: Floats) -> None:
    """Friction where nothing holds the normal is a body rubbing on air: almost always a forgotten contact."""
    dim = points.shape[1]
    for friction in frictions:
        if friction.law is not None:
            continue
        k = len(friction.nodes)
        columns = (friction.nodes[:, None] * dim + np.arange(dim)).ravel()
        normal = sp.csr_matrix(
            (friction.normals.ravel(), columns, np.arange(0, k * dim + 1, dim)), shape=(k, points.size)
        )
        free = abs(sp.csr_matrix(normal @ supports.P)).max(axis=1).toarray().ravel() > PARALLEL
        free &= ~np.isin(friction.nodes, stopped)
        if free.any():
            warnings.warn(
                f"{friction.subject}: at {free.sum()} of {k} places nothing holds the body in the normal direction; "
                "add BilateralContact on the same boundary, unless it is meant to slide on air.",
                SceneWarning,
                stacklevel=2,
            )


def on_free(rows: sp.csr_matrix, supports: Supports) -> sp.csr_matrix:
    """B = B^ P without the rounding of t . n = 0 and t . t = 1."""
    B = sp.csr_matrix(rows @ supports.P)
    B.data[np.abs(B.data) < PARALLEL] = 0.0
    unit = np.abs(np.abs(B.data) - 1.0) < PARALLEL
    B.data[unit] = np.sign(B.data[unit])
    B.eliminate_zeros()
    return B


def tangential_rows(nodes: Ints, normals: Floats, points: Floats) -> sp.csr_matrix:
    """(m * (dim - 1), n_u) orthonormal tangents of each row."""
    m, dim = normals.shape
    # The right singular vectors beyond the first span the plane across the normal.
    tangents = _across(normals)
    columns = np.repeat(nodes[:, None] * dim + np.arange(dim), dim - 1, axis=0)
    indptr = np.arange(0, m * (dim - 1) * dim + 1, dim)
    return sp.csr_matrix((tangents.reshape(-1), columns.ravel(), indptr), shape=(m * (dim - 1), points.size))


def _merge(nodes: Ints, normals: Floats) -> tuple[Ints, Ints]:
    """Rows of one node with one normal (up to sign) are one term: its first row, and the term of every row."""
    term = np.full(len(nodes), -1)
    first: list[Ints] = []
    while (term < 0).any():
        left = np.flatnonzero(term < 0)
        lead = left[np.unique(nodes[left], return_index=True)[1]]
        leader = np.full(nodes.max() + 1, -1)
        leader[nodes[lead]] = np.arange(len(lead))
        mine = leader[nodes[left]]
        reference = normals[lead[mine]]
        along = np.einsum("ij,ij->i", normals[left], reference)
        apart = np.linalg.norm(normals[left] - along[:, None] * reference, axis=1)
        same = apart < PARALLEL
        term[left[same]] = mine[same] + sum(map(len, first))
        first.append(lead)
    return np.concatenate(first), term


def _across(normals: Floats) -> Floats:
    """(m, dim - 1, dim) orthonormal vectors across each normal; exact where the normal is an axis."""
    dim = normals.shape[1]
    if dim == 2:
        return np.stack([-normals[:, 1], normals[:, 0]], axis=1)[:, None, :]
    return np.linalg.svd(normals[:, None, :])[2][:, 1:, :]


def contact_surface(
    surfaces: Sequence[ContactSurface], supports: Supports, points: Floats
) -> tuple[Ints, Floats, Floats]:
    """Contact nodes that are not held otherwise (m,), their outward normals (m, dim) and int phi_i (m,)."""
    dim = points.shape[1]
    if not surfaces:
        return np.zeros(0, dtype=np.int64), np.zeros((0, dim)), np.zeros(0)
    nodes = np.concatenate([s.nodes for s in surfaces])
    normals = np.concatenate([s.normals for s in surfaces])
    first, term = _merge(nodes, normals)
    # Effects on one boundary bring the same edges: their lengths are one length, not a sum.
    lengths = np.zeros(len(first))
    np.maximum.at(lengths, term, np.concatenate([s.lengths for s in surfaces]))
    rows = tangential_rows(nodes[first], normals[first], points)
    slides = np.diff(on_free(rows, supports).indptr).reshape(len(first), dim - 1).any(axis=1)
    free, place = np.unique(nodes[first][slides], return_inverse=True)
    normal, length = np.zeros((len(free), dim)), np.zeros(len(free))
    np.add.at(normal, place, (lengths[:, None] * normals[first])[slides])
    np.add.at(length, place, lengths[slides])
    return free, normal / np.linalg.norm(normal, axis=1)[:, None], length
