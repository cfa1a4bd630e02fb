"""The contact boundary laid out on a line: where each contact node goes, and which part of the line it owns.

A node owns the halves of its edges on Gamma_C. Where Gamma_C lies along an axis the line is that axis;
otherwise it is the arc length, counter-clockwise, part after part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.errors import HistoryError
from vemcvx.meshes import plane_mesh
from vemcvx.meshes.polygons.segments import right_of
from vemcvx.results.results import Results

# An edge that ends in a held node belongs to Gamma_C if it runs along the contact node's tangent; a corner
# flatter than 25 degrees passes for straight, which costs half an edge in a picture.
ALONG = 0.9
FLAT = 1e-9
ROUNDING = 1e-12  # of the largest friction of a history: where contact is open, this is none
ARC = "$s$"


@dataclass(frozen=True)
class ContactLine:
    """Contact nodes in the order of the line."""

    order: Ints
    """(m,) rows of the contact arrays"""
    position: Floats
    """(m,) places on the line"""
    limits: Floats
    """(m, 2) the part of the line that each node owns"""
    tangents: Floats
    """(m, 2) unit vectors towards larger positions"""
    symbol: str
    """what the line measures"""

    @property
    def label(self) -> str:
        """What the line measures, in words."""
        return "arc length $s$" if self.symbol == ARC else self.symbol

    def along(self, vectors: Floats) -> Floats:
        """(..., m) components along the line of vectors (..., m, 2) at the contact nodes, in the line's order."""
        components: Floats = np.einsum("...md,md->...m", vectors[..., self.order, :], self.tangents)
        return components

    @property
    def gaps(self) -> Ints:
        """Nodes between which and their predecessors the line is broken."""
        apart = self.limits[1:, 0] - self.limits[:-1, 1]
        return 1 + np.flatnonzero(apart > FLAT * np.abs(self.limits).max())

    def broken(self, values: Floats) -> tuple[Floats, Floats]:
        """Positions and values (m,), with NaN where the line is broken."""
        return np.insert(self.position, self.gaps, np.nan), np.insert(values, self.gaps, np.nan)

    def spans(self, chosen: Bools) -> Floats:
        """(k, 2) stretches of the line that the chosen nodes (m,), in the line's order, own together."""
        starts = chosen & ~np.append(False, chosen[:-1])
        starts[self.gaps] |= chosen[self.gaps]
        ends = np.append(starts[1:] | ~chosen[1:], True) & chosen
        return np.column_stack([self.limits[starts, 0], self.limits[ends, 1]])


def apart(history: Results, line: ContactLine) -> Bools:
    """(S, m) where contact is open and nothing rubs, along the line: nothing sticks or slips there."""
    contact = history.contact
    traction = np.abs(line.along(contact.traction))
    idle: Bools = ~contact.closed[:, line.order] & (traction <= ROUNDING * traction.max())
    return idle


def contact_line(history: Results, picture: str) -> ContactLine:
    """The contact nodes of a history laid out, or HistoryError if there are none."""
    contact = history.contact
    plane_mesh(history.mesh, picture, "contact_face and friction_disc draw contact in space")
    if len(contact.nodes) == 0:
        raise HistoryError(f"{picture}: this history has no contact nodes; the scene names no contact or friction.")
    edges = _edges(history)
    order, arc = _walk(edges, history)
    half = 0.5 * np.linalg.norm(np.diff(history.mesh.points[edges], axis=1)[:, 0], axis=1)
    before, after = np.zeros(history.mesh.n_nodes), np.zeros(history.mesh.n_nodes)
    after[edges[:, 0]], before[edges[:, 1]] = half, half
    nodes, normals = contact.nodes[order], contact.normals[order]
    limits = np.column_stack([arc - before[nodes], arc + after[nodes]])
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    axis = _axis(contact.points)
    if axis is None:
        return ContactLine(order, arc, limits, tangents, ARC)
    position = contact.points[order, axis]
    sign = float(np.sign(tangents[0, axis]))
    owned = np.sort(position[:, None] + sign * (limits - arc[:, None]), axis=1)
    turn = slice(None, None, int(sign))
    return ContactLine(order[turn], position[turn], owned[turn], (sign * tangents)[turn], f"$x_{axis + 1}$")


def _axis(points: Floats) -> int | None:
    """The axis along which all points lie, if there is one."""
    spread = np.ptp(points, axis=0)
    flat = spread <= FLAT * max(float(spread.max()), float(np.abs(points).max()))
    return int(np.argmin(flat)) if flat.any() else None


def _edges(history: Results) -> Ints:
    """Boundary edges of Gamma_C: both ends in contact, or one, and along its tangent."""
    contact, points = history.contact, history.mesh.points
    normal = np.zeros_like(points)
    normal[contact.nodes] = contact.normals
    edges = history.mesh.boundaries["boundary"]
    chord = points[edges[:, 1]] - points[edges[:, 0]]
    outward = right_of(chord) / np.linalg.norm(chord, axis=1)[:, None]
    cosines = np.einsum("end,ed->en", normal[edges], outward)
    # Nodes without contact have no normal, and cosine 0.
    touching: Bools = cosines.max(axis=1) > ALONG
    return edges[touching]


def _walk(edges: Ints, history: Results) -> tuple[Ints, Floats]:
    """Contact nodes in counter-clockwise order, part after part, and their arc length."""
    points, nodes = history.mesh.points, history.contact.nodes
    row = {int(node): i for i, node in enumerate(nodes)}
    following = {int(a): int(b) for a, b in edges if int(a) in row and int(b) in row}
    preceded = set(following.values())
    order: list[int] = []
    arc: list[float] = []
    here, seen = 0.0, set()
    room = 2.0 * history.mesh.h  # on the line between separate parts: two cells
    # Parts begin where nothing leads; what is left then are closed curves.
    for start in [n for n in row if n not in preceded] + list(row):
        node: int | None = start
        while node is not None and node not in seen:
            seen.add(node)
            order.append(row[node])
            arc.append(here)
            ahead = following.get(node)
            here += float(np.linalg.norm(points[ahead] - points[node])) if ahead is not None else room
            node = ahead
    return np.array(order), np.array(arc)
