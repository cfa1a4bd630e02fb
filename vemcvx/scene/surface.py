"""The surface of contact: its nodes, normals and lengths, and how to read the pressure of contact off nodal forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats, Ints
from vemcvx.effects import ContactSurface, Friction, Obstacle
from vemcvx.scene.edges import edge_ends, ends_of_groups, lengths_of
from vemcvx.scene.freedom import freedom
from vemcvx.scene.jumps import Jumps, summing
from vemcvx.scene.normals import merged
from vemcvx.scene.supports import Supports
from vemcvx.scene.terms import Terms


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
