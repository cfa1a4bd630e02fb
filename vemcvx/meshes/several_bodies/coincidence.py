"""Where boundaries of bodies coincide within a tolerance, and the nodes that one body lends to the other there.

Nodes of different bodies within the tolerance of each other are in one place: that of the node of the first body. A
node within the tolerance of an edge of another body becomes a hanging vertex of it, where the node is; but a node of a
later body that is off an edge of an earlier one, by more than rounding, first moves to the nearest point of it. So the
earlier body keeps its outline, the later one takes it, and both have the same nodes along the common part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.polygons.search import close_pairs
from vemcvx.meshes.polygons.segments import beside, overlapping_boxes, rounding
from vemcvx.meshes.polygons.topology import smallest_linked
from vemcvx.meshes.several_bodies.side_by_side import SideBySide


@dataclass(frozen=True, eq=False)
class Coincidence:
    """Nodes in the same places, and nodes to insert.

    Attributes
    ----------
    points : (n, 2) float
        The points moved into their places.
    place : (n,) int
        The first of the nodes in the place of each node.
    edge, node : (q,) int
        Edges (numbers of rows of ``ends``) and the nodes to insert there, in their order along each edge.
    """

    points: Floats
    place: Ints
    edge: Ints
    node: Ints


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
