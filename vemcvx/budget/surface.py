"""Forces per length that act on boundary edges: loads, friction, pressure of contact, springs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vemcvx.budget.skeleton import Skeleton
from vemcvx.meshes.topology import edge_keys
from vemcvx.scene.composition import InitialStresses
from vemcvx.scene.pose import Posed

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ALONG = 1e-6
"""Normals of an edge and of a term at one of its ends that agree to this are those of one side."""


def surface_forces(posed: Posed, edges: Skeleton, t: float, u: Floats, lam: Floats, p: Floats) -> Floats:
    """Force (b, 2) on each boundary edge of the skeleton, in the state u with multipliers lam (m, block) and p (r,)."""
    total = _loads(posed, edges, t)
    terms, obstacles = posed.terms, posed.obstacles
    if len(terms.nodes):
        tangents = terms.rows.data.reshape(len(terms.nodes), -1, 2)
        traction = -np.einsum("mb,mbd->md", lam, tangents) / terms.lengths[:, None]
        normals = np.column_stack([tangents[:, 0, 1], -tangents[:, 0, 0]])
        total += _spread(edges, terms.nodes, normals, traction)
    if obstacles is not None and len(obstacles.nodes):
        traction = -(p / obstacles.lengths)[:, None] * obstacles.normals
        total += _spread(edges, obstacles.nodes, obstacles.normals, traction)
    if posed.springs is not None:
        total += _springs(posed, edges, u)
    return total


def _loads(posed: Posed, edges: Skeleton, t: float) -> Floats:
    n = posed.space.mesh.n_nodes
    keys = edge_keys(*edges.outer_edges.T, n)
    order = np.argsort(keys)
    total = np.zeros((len(keys), 2))
    for load in posed.loads:
        if isinstance(load, InitialStresses) or load.edges is None:
            continue
        at = order[np.searchsorted(keys, edge_keys(*load.edges.T, n), sorter=order)]
        np.add.at(total, at, load.forces(t))
    return total


def _spread(edges: Skeleton, nodes: Ints, normals: Floats, traction: Floats) -> Floats:
    """Integrals over edges of tractions given at nodes and sides, linear between them."""
    size = edges.outer_edges.max() + 1
    near = nodes < size
    length = np.linalg.norm(edges.outer_normals, axis=1)
    total = np.zeros(edges.outer_normals.shape)
    order = np.argsort(nodes, kind="stable")
    order = order[near[order]]
    for side in range(2):
        ends = edges.outer_edges[:, side]
        start, stop = (np.searchsorted(nodes[order], ends, side=how) for how in ("left", "right"))
        for k in range(int((stop - start).max(initial=0))):
            has = np.flatnonzero(start + k < stop)
            row = order[start[has] + k]
            cosine = np.einsum("bd,bd->b", normals[row], edges.outer_normals[has]) / length[has]
            same = np.abs(cosine) > 1 - ALONG
            total[has[same]] += 0.5 * length[has[same], None] * traction[row[same]]
    return total


def _springs(posed: Posed, edges: Skeleton, u: Floats) -> Floats:
    """Springs pull where both ends of an edge have some."""
    stiff = posed.springs.diagonal().reshape(-1, 2).max(axis=1) > 0
    sprung = stiff[edges.outer_edges].all(axis=1)
    length = np.linalg.norm(edges.outer_normals, axis=1)
    share = np.bincount(
        edges.outer_edges[sprung].ravel(), np.repeat(0.5 * length[sprung], 2), minlength=posed.space.mesh.n_nodes
    )
    pull = -(posed.springs @ u.ravel()).reshape(-1, 2) / np.where(share > 0, share, 1.0)[:, None]
    total = np.zeros(edges.outer_normals.shape)
    total[sprung] = 0.5 * length[sprung, None] * pull[edges.outer_edges[sprung]].sum(axis=1)
    return total
