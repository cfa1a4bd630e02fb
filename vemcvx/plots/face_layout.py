"""The face of contact of a body in space laid out in a plane, and the part of it that each contact node owns.

It is seen along its mean normal. A node owns of every face at it the quadrilateral between itself, the middles of the
two edges there and the centre of the face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.errors import HistoryError
from vemcvx.meshes import PolyhedralMesh
from vemcvx.results.contact import Contact
from vemcvx.results.results import Results

ALONG = 0.9
"""A face belongs to contact if the cosine between its normal and that of a contact node at it is larger."""
SEEN = 0.5
"""Length of the mean of unit normals below which contact goes round the body, and nobody sees all of it."""
AXIS = 1.0 - 1e-9


@dataclass(frozen=True)
class FaceLayout:
    """Contact nodes in the plane of the picture."""

    frame: Floats
    """(2, 3) unit vectors to the right and up"""
    labels: tuple[str, str]
    """what they measure"""
    places: Floats
    """(m, 2) of the contact nodes"""
    corners: Floats
    """(k, 4, 2) quadrilaterals that make up the face"""
    owners: Ints
    """(k,) rows of the contact arrays, of the nodes that own them"""

    def flat(self, vectors: Floats) -> Floats:
        """Vectors (..., 3) in the picture, (..., 2)."""
        return vectors @ self.frame.T


def face_layout(history: Results, picture: str) -> FaceLayout:
    """The contact nodes of a history laid out.

    Raises
    ------
    HistoryError
        There are none, the body is plane, or contact goes round it.
    """
    contact, mesh = history.contact, history.mesh
    if not isinstance(mesh, PolyhedralMesh):
        raise HistoryError(f"{picture}: this body is plane; friction_traction and stick_slip_map draw its contact.")
    if len(contact.nodes) == 0:
        raise HistoryError(f"{picture}: this history has no contact nodes; the scene names no contact or friction.")
    if not seen(contact):
        raise HistoryError(hidden(picture))
    frame, labels = _frame(contact.normals.mean(axis=0))
    corners, owners = _parts(contact, mesh)
    return FaceLayout(frame, labels, contact.points @ frame.T, corners @ frame.T, owners)


def apart(history: Results) -> Bools:
    """(S, m) where contact is open and nothing rubs."""
    contact = history.contact
    traction = np.linalg.norm(contact.traction, axis=2)
    idle: Bools = ~contact.closed & (traction <= 1e-12 * traction.max())
    return idle


def seen(contact: Contact) -> bool:
    """Whether contact is on one side of the body, so that one view shows it."""
    return bool(np.linalg.norm(contact.normals.mean(axis=0)) >= SEEN)


def hidden(picture: str) -> str:
    """The sentence that refuses a picture of contact on all sides."""
    return f"{picture}: contact goes round the body, and no view shows all of it; look at the VTU files of the history"


def _frame(mean: Floats) -> tuple[Floats, tuple[str, str]]:
    """Right and up, across the mean normal: axes where it is one, then as if looked at from inside the body."""
    length = np.linalg.norm(mean)
    axis = int(np.argmax(np.abs(mean)))
    right, up = (k for k in range(3) if k != axis)
    if abs(mean[axis]) > AXIS * length:
        return np.eye(3)[[right, up]], (f"$x_{right + 1}$", f"$x_{up + 1}$")
    along = np.eye(3)[right] - mean[right] / length**2 * mean
    along /= np.linalg.norm(along)
    return np.stack([along, np.cross(mean / length, along)]), ("right", "up")


def _parts(contact: Contact, mesh: PolyhedralMesh) -> tuple[Floats, Ints]:
    """Quadrilaterals (k, 4, 3) of the faces of contact, and their owners (k,)."""
    normal, row = np.zeros_like(mesh.points), np.full(mesh.n_nodes, -1)
    normal[contact.nodes], row[contact.nodes] = contact.normals, np.arange(len(contact.nodes))
    corners, owners = [], []
    for face in mesh.boundaries["boundary"]:
        nodes = mesh.face_vertices[mesh.face_offsets[face] : mesh.face_offsets[face + 1]]
        # Nodes without contact have no normal, and cosine 0.
        if (normal[nodes] @ mesh.face_normals[face]).max() <= ALONG:
            continue
        x = mesh.points[nodes]
        after, before = 0.5 * (x + np.roll(x, -1, axis=0)), 0.5 * (x + np.roll(x, 1, axis=0))
        corners.append(np.stack([x, after, np.broadcast_to(mesh.face_centroids[face], x.shape), before], axis=1))
        owners.append(row[nodes])
    held, quadrilaterals = np.concatenate(owners), np.concatenate(corners)
    return quadrilaterals[held >= 0], held[held >= 0]
