"""The arc length s along contact in the plane.

Contact runs along sides of the body that `Contact.nodes` are of, with this body on its left: counter-clockwise round
outer boundaries, clockwise round holes. Where contact has several pieces, s starts anew on each, from 0 at its first
node; on a closed curve that is the contact node of the lowest number. Nodes alone are pieces of no length.
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
"""Cosine between normals above which an edge or face at a contact node belongs to contact, half of the turn of a curve:
a corner flatter than that passes for straight, which costs half an edge in a picture."""


@dataclass(frozen=True)
class ContactPath:
    """The nodes of plane contact in their order along it, piece after piece."""

    sides: Ints  # (e, 2) nodes of the sides of contact
    rows: Ints  # (k,) rows of the contact arrays, one for each node
    pieces: Ints  # (k,) numbers of pieces, from 0
    s: Floats  # (k,) arc length, from 0 on each piece


def contact_path(mesh: PolygonMesh, contact: Contact) -> ContactPath:
    """Return the path along contact, without nodes if there is no contact."""
    points, normal = mesh.points, np.zeros_like(mesh.points)
    normal[contact.nodes] = contact.normals
    sides = mesh.boundaries["boundary"]
    chord = points[sides[:, 1]] - points[sides[:, 0]]
    outward = right_of(chord) / np.linalg.norm(chord, axis=1)[:, None]
    # Nodes without contact have no normal, and cosine 0.
    sides = sides[np.einsum("end,ed->en", normal[sides], outward).max(axis=1) > ALONG]
    row = {node: i for i, node in enumerate(contact.nodes.tolist())}
    following = {a: b for a, b in sides.tolist() if a in row and b in row}
    preceded, found, piece = set(following.values()), dict[int, tuple[int, float]](), 0
    # Pieces begin where nothing leads; what is left then are closed curves.
    for start in [n for n in row if n not in preceded] + list(row):
        node, s = start, 0.0
        while node not in found:
            found[node] = piece, s
            ahead = following.get(node, node)
            node, s = ahead, s + float(np.linalg.norm(points[ahead] - points[node]))
        piece += found[start][0] == piece
    pieces, lengths = np.array(list(found.values())).reshape(-1, 2).T
    return ContactPath(sides, np.array([row[n] for n in found], dtype=int), pieces.astype(int), lengths)
