"""Corners of plane bodies, and point loads, at which stress may have no limit: a sentence from angle and conditions.

A side is held in no direction (a free side, or contact that is open), in one (a roller, or contact without friction),
or in both (a clamp, or contact with friction). Behind a side that is held in one direction a body goes on as its mirror
image, and the angle counts twice. Then stress grows without limit as the mesh is refined (Williams, *Stress
singularities resulting from various boundary conditions in angular corners of plates in extension*, J. Appl. Mech. 19,
1952)

    between two sides alike                     beyond 180 degrees, a reentrant corner,
    between a side that is held and a free one  beyond 45 to 90 degrees, by Poisson's ratio.

Whether it does depends on the load, too, and on whether contact with friction slips: the sentence says "may". Bodies
that meet at a place are one of all their angles together. Where contact opens along a smooth side, stress is bounded
and nothing is said. Materials that meet, and loads and displacements that jump,
are not looked at, nor edges and corners of bodies in space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from vemcvx.base.arrays import Bools, Ints
from vemcvx.base.outline import ArrayRecord
from vemcvx.effects.effect import Load
from vemcvx.meshes import Mesh, PolygonMesh
from vemcvx.meshes.interfaces import pairs_of
from vemcvx.meshes.polygons import cross, next_corner
from vemcvx.results.contact import Contact
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.rows import ContactRows, pair_numbers
from vemcvx.vem.boundary import CURVE_ANGLE

LEAST = np.pi / 4
"""The angle from which a held side beside a free one may be singular: that of incompressible bodies."""
WITHOUT_LIMIT = "without limit as the mesh is refined"
SUPPORTED = "free side", "roller", "clamp"
"""A side that supports hold in no, one or two directions."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Sides(ArrayRecord):
    """The conditions on the edges of the boundary, of which bodies in space have none, and point loads.

    Attributes
    ----------
    edges : (b, 2) int
        Each with the body on its left.
    held : (b,) int
        In how many directions supports hold both ends.
    contact : (b,) bool
        True where the edge touches, or may touch, something rigid, or is the first body's at an interface.
    loaded : (q,) int or None
        The nodes on which forces act as on points.
    """

    edges: Annotated[Ints, "sides 2", ""]
    held: Annotated[Ints, "sides", ""]
    contact: Annotated[Bools, "sides", ""]
    loaded: Annotated[Ints | None, "loaded", ""] = None

    def beside(self, node: int) -> list[int]:
        """Return a node of the boundary and those next to it."""
        near = self.edges[(self.edges == node).any(axis=1)]
        return [node, *(other for other in near.ravel().tolist() if other != node)]


def sides_of(posed: PosedScene) -> Sides:
    """Return the sides of a posed scene."""
    mesh, dim = posed.space.mesh, posed.space.dim
    points = [one for one in posed.loads if isinstance(one, Load) and one.cells is None and one.edges is None]
    rows = np.concatenate([np.zeros(0, np.int64), *(load.matrix.tocoo().row for load in points)])
    edges = mesh.boundaries["boundary"] if isinstance(mesh, PolygonMesh) else np.zeros((0, 2), dtype=np.int64)
    free = posed.supports.free_directions(edges.ravel(), np.repeat(np.arange(len(edges)), 2))
    # What gives way presses with a force that has a limit, as a load.
    soft = posed.obstacles.compliance > 0
    return Sides(
        edges=edges,
        held=dim - np.round(np.trace(free, axis1=1, axis2=2)).astype(np.int64),
        contact=_owned(posed.surface, edges) & ~_owned(posed.obstacles, edges, soft),
        loaded=np.unique(rows // dim),
    )


def _owned(rows: ContactRows, edges: Ints, some: Bools | slice = slice(None)) -> Bools:
    """Return True for each edge of which one of some rows owns an end."""
    names, most = rows.names[rows.ends[some].indices], int(edges.max(initial=0))
    known, wanted = (pair_numbers(pairs.min(axis=1), pairs.max(axis=1), most) for pairs in (names, edges))
    return np.isin(wanted, known)


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of a body with the contact of a run; none where sides are not known."""

    mesh: Mesh
    contact: Contact
    sides: Sides | None

    def sentence(self, nodes: Sequence[int], row: int) -> str:
        """Return what is to be said of a stress, or force of contact, near these nodes at a row of the arrays."""
        return self.at_load(nodes) or self.at_corner(nodes, row)

    def at_load(self, nodes: Sequence[int]) -> str:
        """Return what is to be said of an extreme near these nodes because of a point load; "" without any."""
        there = self.sides is not None and self.sides.loaded is not None and np.isin(nodes, self.sides.loaded).any()
        return f"at a point load: grows {WITHOUT_LIMIT}" if there else ""

    def at_corner(self, nodes: Sequence[int], row: int) -> str:
        """Return what is to be said near these nodes because of a corner; "" without any."""
        if self.sides is None:
            return ""
        told = (self._corner(self.sides, node, row) for node in nodes if node in self.sides.edges)
        return next((f"{where}: may grow {WITHOUT_LIMIT}" for where in told if where), "")

    def _corner(self, sides: Sides, node: int, row: int) -> str:
        """Return the corner at a node in words; "" where stress has a limit."""
        nodes = self._place(node)
        at = np.flatnonzero(np.isin(sides.edges, nodes).any(axis=1))
        if len(nodes) > 1:  # Between bodies there is no side; at the tip of a crack there are two.
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
        """Return True for edges (k, 2) of interfaces, of either body."""
        joined = [side for found in self.mesh.interfaces.values() for side in (found.edges, found.partners)]
        own, known = (np.sort(pairs, axis=1) @ [self.mesh.n_nodes, 1] for pairs in (edges, np.concatenate(joined)))
        return np.isin(own, known)

    def _condition(self, sides: Sides, edge: int, nodes: Ints, row: int) -> tuple[int, str]:
        """Return in how many directions a side is held beside a place, and what it is; contact by the next node."""
        held, contact = int(sides.held[edge]), self.contact
        at = np.isin(contact.nodes, np.setdiff1d(sides.edges[edge], nodes))
        touches = held < 2 and sides.contact[edge] and contact.closed[row, at].any()
        if touches and (contact.bound[row, at] > 0).any():
            return 2, "contact with friction"
        if held or not sides.contact[edge]:
            return held, SUPPORTED[held]
        return (1, "contact") if touches else (0, "open contact")

    def _angle(self, nodes: Ints) -> float:
        """Return the angle of all cells at a place together."""
        mesh = self.mesh
        assert isinstance(mesh, PolygonMesh)
        at, following = np.flatnonzero(np.isin(mesh.vertices, nodes)), next_corner(mesh.offsets)
        x, before = mesh.points[mesh.vertices], np.argsort(following)
        out, back = x[following[at]] - x[at], x[before[at]] - x[at]
        return float((np.arctan2(cross(out, back), np.einsum("ka,ka->k", out, back)) % (2.0 * np.pi)).sum())
