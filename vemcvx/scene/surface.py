"""The surface of contact: its nodes, normals and lengths, and how to read the pressure of contact off nodal forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.effects import ContactSurface, Friction, Obstacle
from vemcvx.scene.edges import lengths_of, owned, united
from vemcvx.scene.freedom import freedom
from vemcvx.scene.supports import Supports
from vemcvx.scene.terms import Terms, merged


@dataclass(frozen=True)
class Surface:
    """The nodes of contact that are not held otherwise; at a corner, all that follows is of both sides together."""

    nodes: Ints
    """(m,)"""
    normals: Floats
    """(m, dim) outward, averaged by length at corners"""
    lengths: Floats
    """(m,) int phi_i over the edges of contact"""
    grips: Floats
    """(m, dim) with what supports and bilateral contact exert on a node, R, contact presses with the force -g . R"""


def contact_surface(
    surfaces: Sequence[ContactSurface | Friction | Obstacle],
    terms: Terms,
    supports: Supports,
    times: Sequence[float] = (),
) -> Surface:
    """The surface of contact, wherever something says so, rubs or stops; edges that several parts bring count once.

    A node that supports drag belongs to it where it rubs, so where it has a term of `terms`.
    """
    dim = supports.points.shape[1]
    if not surfaces:
        return Surface(np.zeros(0, dtype=np.int64), np.zeros((0, dim)), np.zeros(0), np.zeros((0, dim)))
    nodes = np.concatenate([s.nodes for s in surfaces])
    normals = np.concatenate([s.normals for s in surfaces])
    first, row = merged(nodes, normals)
    held = freedom(nodes[first], normals[first], supports, times)
    rubs = held.dragged & np.isin(nodes[first], terms.nodes[terms.acting :])
    kept = np.flatnonzero(held.slides | held.beside | rubs)
    lengths = lengths_of(united(owned(surfaces)[0], row))[kept]
    free, place = np.unique(nodes[first][kept], return_inverse=True)
    normal, length, grips = np.zeros((len(free), dim)), np.zeros(len(free)), np.zeros((len(free), dim))
    np.add.at(normal, place, lengths[:, None] * normals[first][kept])
    np.add.at(length, place, lengths)
    np.add.at(grips, place, held.grips[kept])
    return Surface(free, normal / np.linalg.norm(normal, axis=1)[:, None], length, grips)
