"""The limits of one-sided contact, over all nodal values: D^ with one normal a row, and what obstacles leave free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.effects import Friction, Obstacle
from vemcvx.errors import SceneError
from vemcvx.scene.supports import PARALLEL, Supports
from vemcvx.scene.terms import on_free

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Obstacles:
    """The limits of a posed scene."""

    rows: sp.csr_matrix
    """(r, n_u) D^, unit normals"""
    nodes: Ints
    normals: Floats
    lengths: Floats
    """(r,) integrals of the nodal basis functions"""
    softness: Floats
    gap: Callable[[float], Floats]
    """t -> (r,)"""
    subjects: tuple[str, ...] = ()
    """whose they are, in words"""


def gathered(obstacles: Sequence[Obstacle], supports: Supports, points: Floats) -> Obstacles:
    """The limits of all obstacles where something can move towards them."""
    if not obstacles:
        none = np.zeros(0)
        flat = np.zeros((0, points.shape[1]))
        return Obstacles(sp.csr_matrix((0, points.size)), none.astype(np.int64), flat, none, none, lambda t: none)
    nodes = np.concatenate([o.nodes for o in obstacles])
    normals = np.concatenate([o.normals for o in obstacles])
    rows = normal_rows(nodes, normals, points)
    moves = np.flatnonzero(abs(on_free(rows, supports)).max(axis=1).toarray().ravel() > PARALLEL)

    def gap(t: float) -> Floats:
        return np.concatenate([o.gap(t) for o in obstacles])[moves]

    lengths = np.concatenate([o.lengths for o in obstacles])[moves]
    softness = np.concatenate([o.softness for o in obstacles])[moves]
    subjects = tuple(o.subject for o in obstacles)
    return Obstacles(sp.csr_matrix(rows[moves]), nodes[moves], normals[moves], lengths, softness, gap, subjects)


def pressing(obstacles: Obstacles, friction: Friction, supports: Supports) -> sp.csr_matrix:
    """(rows of `friction`, r) which limits press on which rows: those of the same node and normal.

    Raises
    ------
    SceneError
        Nothing presses where friction depends on the pressure and the node is free to move.
    """
    k, r = len(friction.nodes), len(obstacles.nodes)
    which = [np.flatnonzero(friction.nodes == node) for node in obstacles.nodes]
    pairs = [(i, j) for j, rows in enumerate(which) for i in rows]
    i, j = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    same = np.einsum("pd,pd->p", friction.normals[i], obstacles.normals[j]) > 1 - PARALLEL
    M = sp.csr_matrix((np.ones(same.sum()), (i[same], j[same])), shape=(k, r))
    moves = abs(on_free(normal_rows(friction.nodes, friction.normals, supports.points), supports))
    free = moves.max(axis=1).toarray().ravel() > PARALLEL
    bare = (np.diff(M.indptr) == 0) & (free | (r == 0))
    if bare.any():
        raise SceneError(
            f"{friction.subject}: no pressure is known at {bare.sum()} of {k} places; it needs UnilateralContact or "
            "NormalCompliance on the same boundary (with BilateralContact, use TrescaFriction)."
        )
    return M


def normal_rows(nodes: Ints, normals: Floats, points: Floats) -> sp.csr_matrix:
    """(k, n_u) the matrix of n . u(node), row by row."""
    k, dim = normals.shape
    columns = (nodes[:, None] * dim + np.arange(dim)).ravel()
    return sp.csr_matrix((normals.ravel(), columns, np.arange(0, k * dim + 1, dim)), shape=(k, points.size))
