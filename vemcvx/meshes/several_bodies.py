"""Several bodies in one mesh: coincident boundaries become interfaces, names and data get the names of the bodies.

The meshes are laid side by side in one list of nodes and cells. Nodes of different bodies within the tolerance of each
other are in one place: that of the node of the first body. A node within the tolerance of an edge of another body
becomes a hanging vertex of it, where the node is; but a node of a later body that is off an edge of an earlier one, by
more than rounding, first moves to the nearest point of it. So the earlier body keeps its outline, the later one takes
it, and both have the same nodes along the common part.

Outlines without the edges that two bodies have in one place, in opposite directions, bound all bodies together, and
what is true of the boundary of one mesh must be true of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Floats, Ints, brief, is_real
from vemcvx.errors import MeshError
from vemcvx.meshes.box import WHOLE, check_boundaries, check_cell_data, check_name
from vemcvx.meshes.checks.plane import NARROW_BETWEEN_BODIES, Misfit, check_cells, covering, misfit_of, shortest_edges
from vemcvx.meshes.interfaces import Interface, on_boundary, outside, pairs_of, places_of
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons.geometry import TOLERANCE, beside, close_pairs, cross, outlines, overlapping_boxes, rounding
from vemcvx.meshes.polygons.topology import (
    cell_of_corner,
    directed_edges,
    edge_keys,
    offsets_of,
    positions,
    shared_edges,
    smallest_linked,
)
from vemcvx.meshes.tessellation import Tessellation


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Several bodies, which share no node.

    Attributes
    ----------
    names : tuple of str
        Names of the bodies.
    points : (n, 2) float
    offsets, vertices : (n_cells + 1,) int, (n_corners,) int
        As of a `PolygonMesh`, cells of the bodies one after the other.
    body : (n,) int
        The body of each node.
    """

    names: tuple[str, ...]
    points: Floats
    offsets: Ints
    vertices: Ints
    body: Ints

    @classmethod
    def of(cls, meshes: Mapping[str, Tessellation]) -> SideBySide:
        """Lay meshes side by side: nodes and cells in their order."""
        each = list(meshes.values())
        nodes = np.array([mesh.n_nodes for mesh in each])
        return cls(
            names=tuple(meshes),
            points=np.concatenate([mesh.points for mesh in each]),
            offsets=offsets_of(np.concatenate([np.diff(mesh.offsets) for mesh in each])),
            vertices=np.concatenate([m.vertices + s for m, s in zip(each, offsets_of(nodes), strict=False)]),
            body=np.repeat(np.arange(len(each)), nodes),
        )

    @cached_property
    def corners(self) -> Ints:
        """Corners at which the edges of the boundary start."""
        return shared_edges(self.offsets, self.vertices, len(self.points)).alone

    @cached_property
    def ends(self) -> Ints:
        """The edges of the boundary, as they run in their cells, in the order of these."""
        return directed_edges(self.offsets, self.vertices)[self.corners]

    @property
    def body_of_edge(self) -> Ints:
        """The body of each edge of the boundary."""
        return self.body[self.ends[:, 0]]

    @property
    def body_of_cell(self) -> Ints:
        """The body of each cell."""
        return self.body[self.vertices[self.offsets[:-1]]]

    def with_hanging(self, points: Floats, edge: Ints) -> SideBySide:
        """The bodies with one more node at each of the points: hanging vertices on edges of the boundary, in order."""
        corner = self.corners[edge]
        counts = np.diff(self.offsets) + np.bincount(
            cell_of_corner(self.offsets)[corner], minlength=len(self.offsets) - 1
        )
        return replace(
            self,
            points=np.concatenate([self.points, points]),
            offsets=offsets_of(counts),
            vertices=np.insert(self.vertices, corner + 1, len(self.points) + np.arange(len(points))),
            body=np.concatenate([self.body, self.body_of_edge[edge]]),
        )


def edges_in_one_place(whole: SideBySide, place: Ints) -> tuple[Ints, Ints]:
    """Pairs (q,), (q,) of edges of the boundary between the same places."""
    keys = edge_keys(place[whole.ends], len(place))
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    return order[same], order[same + 1]


def interfaces_of(
    whole: SideBySide, place: Ints, interfaces: Mapping[str, tuple[str, str]] | None
) -> dict[str, Interface]:
    """The interfaces of bodies that share the places of nodes, under the given names or "first|second"."""
    named = _check_names(interfaces, whole.names)
    one, other = edges_in_one_place(whole, place)
    first, second = whole.body_of_edge[one], whole.body_of_edge[other]
    backwards = first > second
    one, other = np.where(backwards, other, one), np.where(backwards, one, other)
    found = {}
    for a, b in np.unique(np.sort(np.column_stack([first, second]), axis=1), axis=0):
        here = (whole.body_of_edge[one] == a) & (whole.body_of_edge[other] == b)
        edges, partners = whole.ends[one[here]], whole.ends[other[here]][:, ::-1]
        pair = whole.names[a], whole.names[b]
        name = named.get(pair, named.get(pair[::-1], "|".join(pair)))
        if pair[::-1] in named:
            pair, edges, partners = pair[::-1], partners[:, ::-1], edges[:, ::-1]
        found[name] = Interface(pair, edges, partners)
    missing = [pair for pair, name in named.items() if name not in found]
    if missing:
        (a, b), there = missing[0], ", ".join(repr("|".join(interface.bodies)) for interface in found.values())
        raise MeshError(
            f"bodies: interface {named[a, b]!r} is to be between {a!r} and {b!r}, whose boundaries nowhere coincide; "
            f"there are {there or 'none'}. Bring the bodies together, or give a larger tolerance=."
        )
    return found


def _check_names(
    interfaces: Mapping[str, tuple[str, str]] | None, known: tuple[str, ...]
) -> dict[tuple[str, str], str]:
    """(first body, second body) -> name of their interface, as far as given."""
    interfaces = {} if interfaces is None else interfaces
    if not isinstance(interfaces, Mapping):
        raise MeshError(f"bodies: interfaces must map names to pairs of bodies; got {brief(interfaces)}.")
    named: dict[tuple[str, str], str] = {}
    for name, pair in interfaces.items():
        check_name(name)
        given = tuple(pair) if isinstance(pair, (tuple, list)) else ()
        if len(given) != 2 or not all(isinstance(one, str) and one in known for one in given) or given[0] == given[1]:
            raise MeshError(
                f"bodies: interface {name!r} must be between two of the bodies {', '.join(map(repr, known))}; got "
                f"{brief(pair)}."
            )
        if given in named or given[::-1] in named:
            raise MeshError(f"bodies: {given[0]!r} and {given[1]!r} are named twice in interfaces; they have one.")
        named[given] = name
    return named


class Coincidence(NamedTuple):
    """Nodes in the same places, and nodes to insert."""

    points: Floats
    """(n, 2) the points moved into their places"""
    place: Ints
    """(n,) the first of the nodes in the place of each node"""
    edge: Ints
    """(q,) edges (numbers of rows of ``ends``) with nodes to insert, in their order along each edge"""
    node: Ints
    """(q,) these nodes"""


def coincidence_of(bodies: SideBySide, tolerance: float) -> Coincidence:
    """Find the coinciding nodes and edges of the boundaries of several bodies."""
    nodes = np.unique(bodies.ends)
    place = _same_places(bodies, nodes, tolerance)
    points = bodies.points[place]
    leaders = np.unique(place[nodes])
    node, edge, distance = _near_edges(bodies, points, place, nodes=leaders, tolerance=tolerance)
    points = _moved(bodies, points, place, node=node, edge=edge, distance=distance)
    a, b = points[bodies.ends[edge, 0]], points[bodies.ends[edge, 1]]
    along = np.einsum("ij,ij->i", points[node] - a, b - a) / np.einsum("ij,ij->i", b - a, b - a)
    order = np.lexsort((along, edge))
    return Coincidence(points, place, edge[order], node[order])


def _same_places(bodies: SideBySide, nodes: Ints, tolerance: float) -> Ints:
    """For each node the first of those in its place; MeshError if a body has two of them."""
    pairs = nodes[close_pairs(bodies.points[nodes], tolerance)]
    pairs = pairs[bodies.body[pairs[:, 0]] != bodies.body[pairs[:, 1]]]
    place = smallest_linked(pairs, len(bodies.points))
    together = np.unique(pairs)
    key = place[together] * len(bodies.names) + bodies.body[together]
    _, index, counts = np.unique(key, return_index=True, return_counts=True)
    if (counts > 1).any():
        node = together[index[counts > 1][0]]
        raise MeshError(
            f"bodies: two nodes of {bodies.names[bodies.body[node]]!r} near {_at(bodies.points[node])} would come to "
            f"one place: the tolerance {tolerance:.3g} must be well below the edges. Give a smaller tolerance=."
        )
    return place


def _near_edges(
    bodies: SideBySide, points: Floats, place: Ints, *, nodes: Ints, tolerance: float
) -> tuple[Ints, Ints, Floats]:
    """Nodes, edges of bodies that have no node there, and distances, (q,) each: the nearest edge of each such body."""
    a, b = points[bodies.ends[:, 0]], points[bodies.ends[:, 1]]
    at = points[nodes]
    low, high = np.minimum(a, b), np.maximum(a, b)
    number, edge = overlapping_boxes(at - tolerance, at + tolerance, low, high)
    node = nodes[number]
    other = bodies.body_of_edge[edge]
    count = len(bodies.names)
    there = ~np.isin(node * count + other, place * count + bodies.body)
    node, edge, other = node[there], edge[there], other[there]
    distance = beside(points[node], a[edge], b[edge])[0]
    near = distance <= tolerance
    node, edge, other, distance = node[near], edge[near], other[near], distance[near]
    order = np.lexsort((distance, other, node))
    nearest = order[np.unique((node * count + other)[order], return_index=True)[1]]
    return node[nearest], edge[nearest], distance[nearest]


def _moved(bodies: SideBySide, points: Floats, place: Ints, *, node: Ints, edge: Ints, distance: Floats) -> Floats:
    """Points with the nodes of later bodies on the edges of the first body that they are near to."""
    a, b = points[bodies.ends[edge, 0]], points[bodies.ends[edge, 1]]
    other = bodies.body_of_edge[edge]
    off = np.flatnonzero((other < bodies.body[node]) & (distance > rounding(points[node], a, b)))
    off = off[np.unique(node[off], return_index=True)[1]]  # of several bodies, the first
    chord = b[off] - a[off]
    part = np.einsum("ij,ij->i", points[node[off]] - a[off], chord) / np.einsum("ij,ij->i", chord, chord)
    moved = points.copy()
    moved[node[off]] = a[off] + np.clip(part, 0.0, 1.0)[:, None] * chord
    return moved[place]


def _at(point: Floats) -> str:
    return f"({point[0]:.6g}, {point[1]:.6g})"


def check_apart(whole: SideBySide, place: Ints, *, moved: bool) -> None:
    """MeshError where bodies that share the places of nodes overlap, or leave a gap that is hardly one.

    If nodes were moved, so are cells, and checked again.
    """
    polygons = outlines(whole.points, whole.offsets, whole.vertices)
    if moved:
        try:
            check_cells(whole.points, whole.offsets, whole.vertices, polygons)
        except MeshError as error:
            raise MeshError(f"bodies: nodes that were moved to an interface spoil a cell; {error}") from None
    one, other = edges_in_one_place(whole, place)
    ends, body = place[whole.ends], whole.body_of_edge
    third = np.flatnonzero(other[:-1] == one[1:])
    first, second = np.concatenate([one, one[third]]), np.concatenate([other, other[third + 1]])
    same_side = np.flatnonzero(ends[first, 0] == ends[second, 0])
    if len(same_side):
        edge, another = first[same_side[0]], second[same_side[0]]
        raise MeshError(_overlap(whole, body[[edge, another]], whole.points[ends[edge]].mean(axis=0)))
    free = np.setdiff1d(np.arange(len(ends)), np.concatenate([one, other]))
    shortest = shortest_edges(whole.points, place[directed_edges(whole.offsets, whole.vertices)])
    ends, body = ends[free], body[free]
    misfit = misfit_of(whole.points, ends, shortest, bodies=body)
    if misfit:
        raise MeshError(_sentence(whole, misfit, ends, body))
    covered = covering(whole.points, ends, cell_of_corner(whole.offsets)[whole.corners[free]], polygons)
    if covered:
        pair = np.array([body[covered[0]], whole.body_of_cell[covered[1]]])
        raise MeshError(_overlap(whole, pair, whole.points[ends[covered[0]]].mean(axis=0)))


def check_points_of_contact(whole: SideBySide, place: Ints, interfaces: Mapping[str, Interface]) -> None:
    """MeshError where bodies share a place of nodes, but no interface goes there."""
    joined = places_of(pairs_of(interfaces), whole.points)
    alone = np.flatnonzero(joined != place)
    if len(alone):
        node = alone[0]
        a, b = (whole.names[number] for number in sorted(whole.body[[place[node], node]]))
        raise MeshError(
            f"bodies: {a!r} and {b!r} touch only in the point {_at(whole.points[node])}, which is no interface. Leave "
            "a gap there, or let them share an edge."
        )


def _sentence(whole: SideBySide, misfit: Misfit, ends: Ints, body: Ints) -> str:
    """A misfit of edges (as places) of the given bodies in words."""
    if misfit.kind == "crossing":
        (a, b), (c, d) = whole.points[ends[[misfit.edge, misfit.other]]]
        at = a + cross(c - a, d - c) / cross(b - a, d - c) * (b - a)
        return _overlap(whole, body[[misfit.edge, misfit.other]], at)
    names = " and ".join(repr(whole.names[k]) for k in body[[misfit.edge, misfit.other]])
    return (
        f"bodies: {names} are apart by {misfit.distance:.3g} near {_at(whole.points[misfit.node])}, less than "
        f"{NARROW_BETWEEN_BODIES:g} of the edges there, and without an interface never in contact. Bring them together "
        "(tolerance= matches what is farther apart than rounding; a clearance is the gap= of a contact), or leave a "
        "larger gap."
    )


def _overlap(whole: SideBySide, pair: Ints, at: Floats) -> str:
    a, b = (whole.names[number] for number in np.sort(pair))
    return (
        f"bodies: {a!r} and {b!r} overlap near {_at(at)}. Move one of them; if their boundaries are two polygons of "
        "one curve, give tolerance=, the largest distance between these."
    )


BODY = "body"
SIGNS = (".", "|")


def bodies(
    meshes: Mapping[str, PolygonMesh],
    interfaces: Mapping[str, tuple[str, str]] | None = None,
    *,
    tolerance: float | None = None,
) -> PolygonMesh:
    """Join the meshes of several bodies to one, with an interface wherever boundaries of two of them coincide.

    Along an interface each body takes the nodes of the other as hanging vertices of its cells, so that both
    have the same; nodes in one place stay double. Bodies need not touch, but must neither overlap nor nearly touch.

    Parameters
    ----------
    meshes : mapping of str to PolygonMesh
        The bodies by name.
    interfaces : mapping of str to (str, str), optional
        Names of interfaces: name -> (first body, second body). Otherwise an interface is called "first|second", in the
        order of the bodies.
    tolerance : float, optional
        Boundaries coincide where they are no farther apart than this length; by default 1e-9 of the extent
        of all bodies. Of two boundaries that do not coincide to rounding, such as two polygons of one circle (which are
        up to h^2 / (8 R) apart, with edges of length h), the later body takes the shape of the earlier one: its nodes
        move to the nearest points of the other's.

    Returns
    -------
    PolygonMesh
        Cells of the bodies one after the other; their nodes likewise, and then the new hanging ones.
        ``mesh.interfaces`` has an `Interface` a name; ``mesh.boundaries`` has its edges of the first body, and
        "lower.left" for what is left of the boundary "left" of "lower" without the interfaces (no such name if nothing
        is). Cell data are those of the bodies, zero on the others; "body" is the number of the body, and a datum of
        the name of each body is 1 on it and 0 elsewhere, so that ``Elasticity(..., on="lower")`` means its cells.

    Raises
    ------
    MeshError
        Bodies overlap, touch in a point only, or leave a gap above the tolerance that is hardly one; an interface is
        named that is none; names clash.
    """
    _check_meshes(meshes)
    apart = SideBySide.of(meshes)
    found = coincidence_of(apart, _check_tolerance(tolerance, apart.points))
    whole = replace(apart, points=found.points).with_hanging(found.points[found.node], found.edge)
    place = np.concatenate([found.place, found.place[found.node]])
    check_apart(whole, place, moved=not np.array_equal(found.points, apart.points))
    matched = on_boundary(interfaces_of(whole, place, interfaces), whole.ends, len(whole.points))
    check_points_of_contact(whole, place, matched)
    origin = np.repeat(np.arange(len(apart.ends)), 1 + np.bincount(found.edge, minlength=len(apart.ends)))
    sides = _sides(meshes, apart, whole, origin=origin, interfaces=matched)
    mesh = PolygonMesh.unchecked(whole.points, whole.offsets, whole.vertices)
    return mesh._replace(
        interfaces=MappingProxyType(matched),
        _named=check_boundaries(sides, whole.ends, mesh.n_nodes, None),
        cell_data=MappingProxyType(check_cell_data(_data(meshes, whole.body_of_cell), mesh.n_cells)),
    )


def _sides(
    meshes: Mapping[str, PolygonMesh],
    apart: SideBySide,
    whole: SideBySide,
    *,
    origin: Ints,
    interfaces: Mapping[str, Interface],
) -> dict[str, Ints]:
    """The named boundaries without the interfaces; `origin` (e,): the former edge that each edge is part of."""
    free = outside(interfaces, whole.ends, len(whole.points))
    sides = {}
    for start, (body, mesh) in zip(np.searchsorted(apart.body, np.arange(len(meshes))), meshes.items(), strict=True):
        for name, edges in mesh.boundaries.items():
            of_name = np.zeros(len(apart.ends), dtype=bool)
            of_name[positions(edges + start, apart.ends, len(apart.points))] = True
            left = whole.ends[free & of_name[origin]]
            if name != WHOLE and len(left):
                sides[f"{body}.{name}"] = left
    return sides


def _data(meshes: Mapping[str, PolygonMesh], body: Ints) -> dict[str, NDArray[Any]]:
    """Cell data of all bodies, zero where a body has none, the number of the body, and where each body is."""
    data: dict[str, NDArray[Any]] = {}
    for number, mesh in enumerate(meshes.values()):
        for name, values in mesh.cell_data.items():
            known = data.setdefault(name, np.zeros((len(body), *values.shape[1:]), dtype=values.dtype))
            if known.shape[1:] != values.shape[1:]:
                raise MeshError(f"bodies: the cell datum {name!r} has rows of different shapes on different bodies.")
            data[name] = known = known.astype(np.result_type(known, values))
            known[body == number] = values
    taken = [name for name in (BODY, *meshes) if name in data]
    if taken:
        raise MeshError(
            f"bodies: a mesh has the cell datum {taken[0]!r}, which is to tell the bodies. Name it otherwise."
        )
    return data | {BODY: body} | {name: (body == number).astype(np.uint8) for number, name in enumerate(meshes)}


def _check_meshes(meshes: Mapping[str, PolygonMesh]) -> None:
    if not isinstance(meshes, Mapping) or len(meshes) < 2:
        raise MeshError(
            f"bodies: wanted is a mapping of names to the meshes of two bodies or more; got {brief(meshes)}."
        )
    for name, mesh in meshes.items():
        if not isinstance(name, str) or not name or any(sign in name for sign in SIGNS) or name == BODY:
            raise MeshError(
                f"bodies: a body's name is a string without {' and '.join(SIGNS)}, not {BODY!r}; got {brief(name)}."
            )
        if not isinstance(mesh, Tessellation):
            raise MeshError(f"bodies: found {brief(mesh)} for {name!r} where a PolygonMesh is wanted.")
        if mesh.interfaces:
            raise MeshError(f"bodies: {name!r} has interfaces itself; give all bodies at once, each with its own mesh.")


def _check_tolerance(tolerance: float | None, points: Floats) -> float:
    extent = float(np.ptp(points, axis=0).max())
    if tolerance is None:
        # Well above the digits that files print, well below any edge.
        return max(1e-9 * extent, TOLERANCE * float(np.abs(points).max()))
    if not is_real(tolerance) or not 0.0 <= tolerance < extent:
        raise MeshError(
            f"bodies: tolerance must be a length below the extent {extent:.3g} of the bodies; got {brief(tolerance)}."
        )
    return float(tolerance)
