"""The arc length s along the contact boundary of plane bodies.

The arc length grows counter-clockwise round bodies, and clockwise round holes. On each piece of the contact boundary,
s is 0 at the first node. A closed piece begins at the contact node with the lowest number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.base.arrays import Floats, Ints
from vemcvx.meshes import PolygonMesh
from vemcvx.meshes.polygons import right_of
from vemcvx.results.contact import Contact
from vemcvx.vem.boundary import CURVE_ANGLE

ALONG = float(np.cos(0.5 * CURVE_ANGLE))
"""Smallest cosine of the angle between the normals of a contact node and a contact side."""


@dataclass(frozen=True)
class ContactPath:
    """Contact nodes in order along the boundary."""

    sides: Ints  # (e, 2) nodes of contact sides
    rows: Ints  # (k,) positions in `Contact.nodes`
    pieces: Ints  # (k,) piece of each node, from 0
    s: Floats  # (k,) arc length, from 0 on each piece


def contact_path(mesh: PolygonMesh, contact: Contact) -> ContactPath:
    """Return the contact nodes in order along the boundary."""
    points, normal = mesh.points, np.zeros_like(mesh.points)
    normal[contact.nodes] = contact.normals
    sides = mesh.boundaries["boundary"]
    chord = points[sides[:, 1]] - points[sides[:, 0]]
    outward = right_of(chord) / np.linalg.norm(chord, axis=1)[:, None]
    # At nodes without contact, the normal and the cosine are 0.
    sides = sides[np.einsum("end,ed->en", normal[sides], outward).max(axis=1) > ALONG]
    row = {node: i for i, node in enumerate(contact.nodes.tolist())}
    following = {a: b for a, b in sides.tolist() if a in row and b in row}
    preceded, found, piece = set(following.values()), dict[int, tuple[int, float]](), 0
    # Open curves begin at nodes without a predecessor. Closed curves come last.
    for start in [n for n in row if n not in preceded] + list(row):
        node, s = start, 0.0
        while node not in found:
            found[node] = piece, s
            ahead = following.get(node, node)
            node, s = ahead, s + float(np.linalg.norm(points[ahead] - points[node]))
        piece += found[start][0] == piece
    pieces, lengths = np.array(list(found.values())).reshape(-1, 2).T
    return ContactPath(sides, np.array([row[n] for n in found], dtype=int), pieces.astype(int), lengths)
