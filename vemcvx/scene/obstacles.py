"""One-sided contact: its limits, over all nodal values and for a System, and the surface that pressure is read off."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import EPS, Floats, Ints
from vemcvx.effects import ContactSurface, Friction, Obstacle
from vemcvx.errors import SceneError
from vemcvx.program.terms import Limits
from vemcvx.scene.freedom import freedom, merged, normal_is_free, normal_rows, on_free
from vemcvx.scene.friction import FrictionLaw, Terms
from vemcvx.scene.jumps import Jumps, edge_ends, ends_of_groups, force_shares, lengths_of, summing
from vemcvx.scene.supports import Supports

# The surface of contact: its nodes, normals and lengths, and how to read the pressure of contact off nodal forces.


@dataclass(frozen=True)
class Surface:
    """The nodes of contact that are not held otherwise; at a corner, all that follows is of both sides together."""

    jumps: Jumps
    """(m,) those of one node ordered by partner"""
    normals: Floats
    """(m, dim) outward, averaged by length at corners"""
    lengths: Floats
    """(m,) int phi_i over the edges of contact"""
    normal_reaction: sp.csr_matrix
    """(m, n_u) with what supports and bilateral contact exert on nodes, R, contact presses with the force -g . R"""

    @property
    def nodes(self) -> Ints:
        """(m,) the nodes; contact presses on their partners the other way."""
        return self.jumps.nodes


def contact_surface(
    surfaces: Sequence[ContactSurface | Friction | Obstacle],
    terms: Terms,
    supports: Supports,
    times: Sequence[float] = (),
) -> Surface:
    """The surface of contact, wherever something says so, rubs or stops; edges that several parts bring count once.

    A node that supports drag, or ground that moves, belongs to it where it rubs, so where it has a term of `terms`.
    """
    dim = supports.points.shape[1]
    jumps, normals = Jumps.of(surfaces), np.concatenate([supports.points[:0], *(s.normals for s in surfaces)])
    first, row = merged(jumps, normals)
    held = freedom(jumps[first], normals[first], supports, times)
    drawn = np.zeros(len(first), dtype=bool)
    moves = [np.full(len(s.nodes), isinstance(s, Friction) and s.ground is not None) for s in surfaces]
    np.logical_or.at(drawn, row, np.concatenate([drawn[:0], *moves]))
    rubs = (held.dragged | drawn) & (terms.jumps[terms.acting :].find(jumps[first]) >= 0)
    kept = np.flatnonzero(held.slides | held.normal_only | rubs)
    lengths = lengths_of(ends_of_groups(edge_ends(surfaces)[0], row))[kept]
    at, there = jumps[first][kept], normals[first][kept]
    lead, place = at.distinct
    normal, length = np.zeros((len(lead), dim)), np.zeros(len(lead))
    np.add.at(normal, place, lengths[:, None] * there)
    np.add.at(length, place, lengths)
    normal_reaction = sp.csr_matrix(summing(place, len(lead)) @ held.normal_reaction[kept])
    return Surface(at[lead], normal / np.linalg.norm(normal, axis=1)[:, None], length, normal_reaction)


# The limits of one-sided contact, over all nodal values and for a System; what presses on friction.
#
# Rigid obstacles that meet at a node with one normal are one limit, at the smallest of their gaps, which acts on all
# their edges; compliant obstacles each act with a force of their own.


GAP_ROUNDINGS = 4
"""Gaps are differences of lengths as large as coordinates, each rounded, and so are they: 3/2 EPS of these, and as much
again for what lengths are computed from. Gaps that are negative by no more than this are zero."""


@dataclass(frozen=True, kw_only=True)
class Obstacles:
    """The limits of a posed scene."""

    rows: sp.csr_matrix
    """(r, n_u) D^, unit normals"""
    jumps: Jumps
    normals: Floats
    lengths: Floats
    """(r,) integrals of the nodal basis functions over the edges of each limit"""
    compliance: Floats
    gap: Callable[[float], Floats]
    """t -> (r,)"""
    ends: sp.csr_matrix
    """(r, e) the ends of edges that each limit acts on: see :mod:`vemcvx.scene.jumps`"""
    names: Ints
    """(e, 2) of each end its node, and the other node of its edge"""
    subjects: tuple[str, ...] = ()
    """whose they are, in words"""
    prescribed: Obstacles | None = None
    """those that supports alone move nodes towards or away from: no limits, but whether they are met is known"""

    @property
    def nodes(self) -> Ints:
        """(r,) the nodes that are stopped, against their partners if they have some."""
        return self.jumps.nodes


def gathered(obstacles: Sequence[Obstacle], owns: tuple[sp.csr_matrix, Ints], supports: Supports) -> Obstacles:
    """The limits of all obstacles, whose rows own ends of edges (with their names), where something can move."""
    points, (ends, names) = supports.points, owns
    jumps, normals = Jumps.of(obstacles), np.concatenate([points[:0], *(o.normals for o in obstacles)])
    compliance = np.concatenate([np.zeros(0), *(o.compliance for o in obstacles)])
    first, limit = _limits(jumps, normals, compliance)
    rows = normal_rows(jumps[first], normals[first], points)
    moves = np.diff(on_free(rows, supports).indptr) > 0
    ends, rounding = ends_of_groups(ends, limit), GAP_ROUNDINGS * EPS * float(np.abs(points).max())

    def those(chosen: Ints) -> Obstacles:
        def gap(t: float) -> Floats:
            nearest = np.full(len(first), np.inf)
            np.minimum.at(nearest, limit, np.concatenate([nearest[:0], *(o.gap(t) for o in obstacles)]))
            return np.where((-rounding <= nearest) & (nearest < 0), 0.0, nearest)[chosen]

        kept = first[chosen]
        return Obstacles(
            rows=sp.csr_matrix(rows[chosen]),
            jumps=jumps[kept],
            normals=normals[kept],
            lengths=lengths_of(ends[chosen]),
            compliance=compliance[kept],
            gap=gap,
            ends=ends[chosen],
            names=names,
            subjects=tuple(o.subject for o in obstacles),
        )

    return replace(those(np.flatnonzero(moves)), prescribed=those(np.flatnonzero(~moves)))


def _limits(jumps: Jumps, normals: Floats, compliance: Floats) -> tuple[Ints, Ints]:
    """The first row of every limit, in order, and the limit of every row."""
    rigid = np.flatnonzero(compliance == 0)
    first, limit = np.arange(len(jumps)), np.arange(len(jumps))
    if len(rigid):
        leads, mine = merged(jumps[rigid], normals[rigid], signed=True)
        first[rigid] = rigid[leads][mine]
    first, limit = np.unique(first, return_inverse=True)
    return first, limit


def pressing(obstacles: Obstacles, friction: Friction, ends: sp.csr_matrix, supports: Supports) -> sp.csr_matrix:
    """(rows of `friction`, r) which limits press on which rows, each with the share of its edges that rub there, too.

    Raises
    ------
    SceneError
        Nothing presses where friction depends on the pressure and the node is free to move.
    """
    k, r = len(friction.nodes), len(obstacles.nodes)
    M = force_shares(ends, obstacles.ends)
    free = normal_is_free(Jumps.of([friction]), friction.normals, supports)
    bare = (np.diff(M.indptr) == 0) & (free | (r == 0))
    if bare.any():
        raise SceneError(
            f"{friction.subject}: no pressure is known at {bare.sum()} of {k} places; it needs UnilateralContact or "
            "NormalCompliance on the same boundary (with BilateralContact, TrescaFriction without while_closed)."
        )
    return M


def limits(obstacles: Obstacles, supports: Supports) -> Limits | None:
    """The limits of obstacles, over the free unknowns."""
    if len(obstacles.nodes) == 0:
        return None
    rows, places = on_free(obstacles.rows, supports), supports.places(obstacles.nodes)
    return Limits(rows, obstacles.gap, obstacles.compliance, places)


def friction_law(terms: Terms, obstacles: Obstacles, ends: sp.csr_matrix, supports: Supports) -> FrictionLaw | None:
    """How weights follow the forces of the limits, or the slip, if some do."""
    if not any(f.dependent for f in terms.frictions) or len(terms.nodes) == 0:
        return None
    starts = np.cumsum([len(f.nodes) for f in terms.frictions])[:-1]
    own = np.split(np.arange(ends.shape[0]), starts)
    each = [
        sp.csr_matrix((len(rows), len(obstacles.nodes)))
        if not f.reads_forces
        else pressing(obstacles, f, ends[rows], supports)
        for f, rows in zip(terms.frictions, own, strict=True)
    ]
    return FrictionLaw(terms.frictions, terms.gather, sp.csr_matrix(sp.vstack(each)))


def out_of_reach(terms: Terms, obstacles: Sequence[Obstacle], supports: Supports) -> list[str]:
    """A sentence for each friction and obstacle none of whose nodes can move, or is moved: it does nothing."""
    moving = np.arange(len(terms.nodes)) < terms.acting
    if terms.dragged is not None:
        moving = moving | terms.dragged
    held = [f.subject for f in terms.frictions if not np.isin(f.nodes, terms.nodes[moving]).any()]
    held += [o.subject for o in obstacles if not normal_is_free(Jumps.of([o]), o.normals, supports).any()]
    return [f"{subject}: all its nodes are held otherwise" for subject in held]
