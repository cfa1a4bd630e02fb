"""Warnings of singular stress at point loads and at corners of plane bodies.

A free side or open contact is held in no direction, a roller or frictionless contact in one direction, and a clamp or
contact with friction in two directions. Stress may grow without limit as the mesh is refined

- if two sides that are held in the same number of directions meet at more than 180 degrees (a reentrant corner),
- if a held side and a free side meet at more than 45 to 90 degrees, depending on Poisson's ratio.

The source is Williams, *Stress singularities resulting from various boundary conditions in angular corners of plates in
extension*, J. Appl. Mech. 19, 1952. If exactly one of the sides is held in one direction, we double the angle,
because the body and the mirror image have the same stress. At a common corner of bodies, angles are added.
Corners between materials, jumps of loads or displacements, and edges and corners in space are not examined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from vemcvx.base.arrays import Bools, Ints, are_among
from vemcvx.base.outline import ArrayRecord
from vemcvx.effects.effect import Load
from vemcvx.meshes import Mesh, PolygonMesh
from vemcvx.meshes.interfaces import pairs_of
from vemcvx.meshes.polygons import cross, next_corner
from vemcvx.results.contact import Contact
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.rows import ContactRows
from vemcvx.vem.boundary import CURVE_ANGLE

LEAST = np.pi / 4
"""The least angle between a held side and a free side at which stress may be singular."""
WITHOUT_LIMIT = "without limit as the mesh is refined"
SUPPORTED = "free side", "roller", "clamp"
"""The names of sides that the supports hold in 0, 1 and 2 directions."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Sides(ArrayRecord):
    """The supports and the contact of boundary edges, and the nodes with point loads."""

    edges: Annotated[Ints, "sides 2", ""]  # nodes, with the body on the left
    held: Annotated[Ints, "sides", ""]  # number of directions held by supports
    contact: Annotated[Bools, "sides", ""]  # mask of edges with rigid contact
    loaded: Annotated[Ints | None, "loaded", ""] = None  # nodes with point loads

    def beside(self, node: int) -> list[int]:
        """Return a boundary node and the neighbours on the boundary."""
        near = self.edges[(self.edges == node).any(axis=1)]
        return [node, *(other for other in near.ravel().tolist() if other != node)]


def find_sides(posed: PosedScene) -> Sides:
    """Return the sides of a posed scene."""
    mesh, dim = posed.space.mesh, posed.space.dim
    points = [one for one in posed.loads if isinstance(one, Load) and one.cells is None and one.edges is None]
    rows = np.concatenate([np.zeros(0, np.int64), *(load.matrix.tocoo().row for load in points)])
    edges = mesh.boundaries["boundary"] if isinstance(mesh, PolygonMesh) else np.zeros((0, 2), dtype=np.int64)
    free = posed.supports.free_directions(edges.ravel(), np.repeat(np.arange(len(edges)), 2))
    # The pressure of compliant obstacles is bounded, like a load.
    soft = posed.obstacles.compliance > 0
    return Sides(
        edges=edges,
        held=dim - np.round(np.trace(free, axis1=1, axis2=2)).astype(np.int64),
        contact=_owns_end(posed.surface, edges) & ~_owns_end(posed.obstacles, edges, soft),
        loaded=np.unique(rows // dim),
    )


def _owns_end(rows: ContactRows, edges: Ints, some: Bools | slice = slice(None)) -> Bools:
    """Return a mask of the edges with contact rows."""
    return are_among(np.sort(edges, axis=1), np.sort(rows.names[rows.ends[some].indices], axis=1))


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of a body in a run."""

    mesh: Mesh
    contact: Contact
    sides: Sides | None

    def sentence(self, nodes: Sequence[int], row: int) -> str:
        """Return the warning for an extreme value near `nodes` in a row of the history."""
        if self.sides is None:
            return ""
        corners = (self._corner(self.sides, node, row) for node in nodes if node in self.sides.edges)
        found = next((f"{where}: may grow {WITHOUT_LIMIT}" for where in corners if where), "")
        return self.at_load(nodes) or found

    def at_load(self, nodes: Sequence[int]) -> str:
        """Return the warning for an extreme value near a point load, or ""."""
        there = self.sides is not None and self.sides.loaded is not None and np.isin(nodes, self.sides.loaded).any()
        return f"at a point load: grows {WITHOUT_LIMIT}" if there else ""

    def _corner(self, sides: Sides, node: int, row: int) -> str:
        """Return a description of a corner with singular stress, or ""."""
        nodes = self._place(node)
        at = np.flatnonzero(np.isin(sides.edges, nodes).any(axis=1))
        if len(nodes) > 1:  # At the tip of a crack, `nodes` has one node.
            at = at[~self._between_bodies(sides.edges[at])]
        if len(at) != 2:
            return ""
        conditions = (self._condition(sides, edge, nodes, row) for edge in at.tolist())
        (one, first), (other, second) = sorted(conditions, reverse=True)
        angle, held = self._angle(nodes), {one, other}
        if sides.contact[at].all() and abs(angle - np.pi) < CURVE_ANGLE:
            return ""
        if 1 in held and len(held) > 1:
            angle, held = 2.0 * angle, held - {1}
        if angle < (np.pi + CURVE_ANGLE if len(held) < 2 else LEAST):
            return ""
        return "at a reentrant corner" if first == second else f"at a corner of {first} and {second}"

    def _place(self, node: int) -> Ints:
        """Return the nodes of all bodies at the place of a node."""
        nodes, pairs = np.array([node]), pairs_of(self.mesh.interfaces)
        while len(more := np.union1d(nodes, pairs[np.isin(pairs, nodes).any(axis=1)])) > len(nodes):
            nodes = more
        return nodes

    def _between_bodies(self, edges: Ints) -> Bools:
        joined = [side for found in self.mesh.interfaces.values() for side in (found.edges, found.partners)]
        return are_among(np.sort(edges, axis=1), np.sort(np.concatenate(joined), axis=1))

    def _condition(self, sides: Sides, edge: int, nodes: Ints, row: int) -> tuple[int, str]:
        """Return the number of directions in which an edge is held, and the condition in words."""
        held, contact = int(sides.held[edge]), self.contact
        at = np.isin(contact.nodes, np.setdiff1d(sides.edges[edge], nodes))
        touches = held < 2 and sides.contact[edge] and contact.closed[row, at].any()
        if touches and (contact.bound[row, at] > 0).any():
            return 2, "contact with friction"
        if held or not sides.contact[edge]:
            return held, SUPPORTED[held]
        return (1, "contact") if touches else (0, "open contact")

    def _angle(self, nodes: Ints) -> float:
        """Return the sum of the angles of all cells at `nodes`."""
        mesh = self.mesh
        assert isinstance(mesh, PolygonMesh)
        at, following = np.flatnonzero(np.isin(mesh.vertices, nodes)), next_corner(mesh.offsets)
        x, before = mesh.points[mesh.vertices], np.argsort(following)
        out, back = x[following[at]] - x[at], x[before[at]] - x[at]
        return float((np.arctan2(cross(out, back), np.einsum("ka,ka->k", out, back)) % (2.0 * np.pi)).sum())
