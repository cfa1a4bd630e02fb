"""Forces per length that act on boundary edges: loads, friction, pressure of contact, springs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, totals
from vemcvx.estimate.budget.skeleton import Skeleton
from vemcvx.history import History
from vemcvx.meshes.polygons.segments import right_of
from vemcvx.meshes.polygons.topology import positions
from vemcvx.scene.composition import InitialStresses
from vemcvx.scene.obstacles import Obstacles
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.terms import Terms

ALONG = 1e-6
"""Normals of an edge and of a term of an effect that names no edges agree to this."""


@dataclass(frozen=True)
class Instant:
    """The state at an instant."""

    t: float
    u: Floats
    """(n_nodes, 2)"""
    lam: Floats
    """(m, block) multipliers of norm terms"""
    p: Floats
    """(r,) multipliers of limits"""
    weights: Floats
    """(m,) bounds of norm terms"""
    worn: Floats
    """(m,) their work since the initial instant"""


def instant(history: History, row: int) -> Instant:
    """The state of a row of a history's arrays."""
    run = history.trajectory
    parts = run.multipliers[row], run.pressures[row], run.weights[row], run.worn[row]
    return Instant(float(history.times[row]), history.displacement[row], *parts)


def surface_forces(posed: PosedScene, edges: Skeleton, now: Instant) -> Floats:
    """Force (b, 2) on each boundary edge of the skeleton."""
    contact = _contact(posed, edges, now)
    total = _loads(posed, edges, now.t) + contact + edges.joints.reaction(contact)
    if posed.springs is not None:
        total += _springs(posed.springs, edges, now.u)
    return total


def _contact(posed: PosedScene, edges: Skeleton, now: Instant) -> Floats:
    """Friction and pressure (b, 2) on the edges of the bodies whose normals they refer to."""
    total = np.zeros(edges.outer_normals.shape)
    terms, obstacles = posed.terms, posed.obstacles
    if len(terms.nodes):
        traction = -np.einsum("mb,mbd->md", now.lam, terms.tangents) / terms.lengths[:, None]
        total += _spread(edges, terms, traction)
    if obstacles is not None and len(obstacles.nodes):
        traction = -(now.p / obstacles.lengths)[:, None] * obstacles.normals
        total += _spread(edges, obstacles, traction)
    return total


def pressures_at_ends(posed: PosedScene, edges: Skeleton, now: Instant) -> Floats:
    """Pressure of obstacles (b, 2) at the two ends of each boundary edge, force per length."""
    obstacles = posed.obstacles
    if obstacles is None or len(obstacles.nodes) == 0:
        return np.zeros((len(edges.outer), 2))
    return at_ends(edges, obstacles, (now.p / obstacles.lengths)[:, None])[..., 0]


def _loads(posed: PosedScene, edges: Skeleton, t: float) -> Floats:
    total = np.zeros((len(edges.outer), 2))
    for load in posed.loads:
        if not isinstance(load, InitialStresses) and load.edges is not None:
            np.add.at(total, positions(load.edges, edges.outer_edges, posed.space.mesh.n_nodes), load.forces(t))
    return total


def _spread(edges: Skeleton, rows: Terms | Obstacles, traction: Floats) -> Floats:
    """Integrals over edges of tractions given at nodes and sides, linear between them."""
    force: Floats = 0.5 * edges.lengths[:, None] * at_ends(edges, rows, traction).sum(axis=1)
    return force


def at_ends(edges: Skeleton, rows: Terms | Obstacles, values: Floats) -> Floats:
    """(b, 2, k) values (m, k), given at nodes and sides, at the two ends of each edge; zero where there is none.

    An edge counts for a row that owns its end or, of an effect that does not name its edges, has its normal, and has
    the same body across. Where supports hold an end of an interface they bear what acts there, whatever it is: it is
    taken to be as at the other end.
    """
    nodes, partners = rows.jumps.nodes, rows.jumps.partners
    normals = right_of(rows.tangents[:, 0]) if isinstance(rows, Terms) else rows.normals
    size = int(max(nodes.max(initial=0), edges.outer_edges.max())) + 1
    owner, end = rows.ends.nonzero()
    beyond = rows.names[end, 1]
    owned, nameless = np.sort(owner[beyond >= 0] * size + beyond[beyond >= 0]), np.zeros(len(nodes), dtype=bool)
    nameless[owner[beyond < 0]] = True
    found = np.zeros((len(edges.outer), 2, values.shape[1]))
    known = edges.joints.across < 0
    order = np.argsort(nodes, kind="stable")
    for side in range(2):
        ends, others = edges.outer_edges[:, side], edges.outer_edges[:, 1 - side]
        start, stop = (np.searchsorted(nodes[order], ends, side=how) for how in ("left", "right"))
        for k in range(int((stop - start).max(initial=0))):
            has = np.flatnonzero(start + k < stop)
            row = order[start[has] + k]
            cosine = np.einsum("bd,bd->b", normals[row], edges.outer_normals[has]) / edges.lengths[has]
            along = np.where(nameless[row], np.abs(cosine) > 1 - ALONG, np.isin(row * size + others[has], owned))
            same = along & (partners[row] == edges.joints.across[has, side])
            found[has[same], side] += values[row[same]]
            known[has[same], side] = True
    for side in range(2):
        bare = known[:, 1 - side] & ~known[:, side]
        found[bare, side] = found[bare, 1 - side]
    return found


def _springs(springs: sp.csr_matrix, edges: Skeleton, u: Floats) -> Floats:
    """Springs pull where both ends of an edge have some."""
    stiff = springs.diagonal().reshape(-1, 2).max(axis=1) > 0
    sprung = stiff[edges.outer_edges].all(axis=1)
    half = 0.5 * edges.lengths[sprung]
    share = totals(edges.outer_edges[sprung].ravel(), np.repeat(half, 2), len(u))
    traction = -(springs @ u.ravel()).reshape(-1, 2) / np.where(share > 0, share, 1.0)[:, None]
    total = np.zeros(edges.outer_normals.shape)
    total[sprung] = half[:, None] * traction[edges.outer_edges[sprung]].sum(axis=1)
    return total
